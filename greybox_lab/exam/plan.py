"""Plan of an examination's cases, with effects dealt out as evenly as possible."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from greybox_id.base.errors import BadInput

from .aliases import always_alike, group_of
from .answers import Kind, Tier

SINGLE, OUTSIDE = 0.57, 0.18
"""Shares of the cases that are not nulls; the rest are doubles."""
SAME_GROUP = 0.15
"""Share of doubles whose effects may act on the same part."""
MANY = (3, 6)
"""Least and most effects of a case with many."""
OF_A_GROUP = 2
"""Most of these that act on the same part."""


@dataclass(frozen=True)
class Planned:
    """A case to be made.

    Attributes
    ----------
    case : name of its folder, without information on the case.
    kind, tier : see `answers`.
    effects : names of its effects.
    number : its index in the plan among cases of its kind.
    seed : of its random numbers.
    family : of foreign vehicles, the simulator; otherwise "".
    """

    case: str
    kind: Kind
    tier: Tier
    effects: tuple[str, ...]
    number: int
    seed: int
    family: str = ""


def plan(
    cases: int, nulls: int, tier: Tier, seed: int, vocabulary: Sequence[str], outside: Sequence[str]
) -> tuple[Planned, ...]:
    """Cases of an examination in the order of their names.

    Parameters
    ----------
    cases, nulls : number of cases with and without effects.
    tier : of all of them.
    seed : of the plan.
    vocabulary, outside : names of effects that diagnoses know and do not know.

    Raises
    ------
    BadInput : if there would be no case.
    """
    if cases < 0 or nulls < 0 or cases + nulls == 0:
        raise BadInput("An examination needs at least one case; ask for some with ‹cases› or ‹nulls›.")
    singles, others = round(SINGLE * cases), round(OUTSIDE * cases)
    return dealt(Counts(nulls, singles, cases - singles - others, others), tier, seed, vocabulary, outside)


@dataclass(frozen=True)
class Counts:
    """Number of cases without effects, with one, two and many effects of the vocabulary, and with one outside it."""

    nulls: int
    singles: int
    pairs: int
    outside: int
    many: int = 0


def dealt(
    counts: Counts, tier: Tier, seed: int, vocabulary: Sequence[str], outside: Sequence[str]
) -> tuple[Planned, ...]:
    """Cases of an examination in the order of their names, with a number of each kind; parameters as in `plan`."""
    if min(vars(counts).values()) < 0 or sum(vars(counts).values()) == 0:
        raise BadInput("An examination needs at least one case; ask for some, as with ‹nulls› or ‹singles›.")
    rng = np.random.default_rng((seed, 40427))
    known, unknown = _dealt(vocabulary, rng), _dealt(outside, rng)
    drawn: list[tuple[Kind, tuple[str, ...], int]] = []
    drawn += [("single", (next(known),), k) for k in range(counts.singles)]
    drawn += [("outside", (next(unknown),), k) for k in range(counts.outside)]
    drawn += [("double", _pair(known, rng), k) for k in range(counts.pairs)]
    drawn += [("many", _several(known, rng), k) for k in range(counts.many)]
    drawn += [("null", (), k) for k in range(counts.nulls)]
    order, digits = rng.permutation(len(drawn)), max(3, len(str(len(drawn))))
    seeds = rng.integers(1, 2**31 - 1, len(drawn))
    return tuple(
        Planned(f"case_{place:0{digits}d}", kind, tier, effects, number, int(seeds[place]))
        for place, (kind, effects, number) in enumerate(drawn[k] for k in order)
    )


def _dealt(names: Sequence[str], rng: np.random.Generator) -> Iterator[str]:
    """All names in random order, repeatedly."""
    while True:
        for k in rng.permutation(len(names)):
            yield names[k]


def _several(deck: Iterator[str], rng: np.random.Generator) -> tuple[str, ...]:
    """Three to six effects, at most two per part, none always indistinguishable from another."""
    chosen: list[str] = []
    count = int(rng.integers(MANY[0], MANY[1] + 1))
    while len(chosen) < count:
        name = next(deck)
        mates = [item for item in chosen if group_of(item) == group_of(name)]
        if name not in chosen and len(mates) < OF_A_GROUP and not set(always_alike(name)) & set(chosen):
            chosen.append(name)
    return tuple(chosen)


def _pair(deck: Iterator[str], rng: np.random.Generator) -> tuple[str, str]:
    """Two effects, mostly on different parts, never always indistinguishable."""
    first = next(deck)
    mixed = rng.random() > SAME_GROUP
    while True:
        second = next(deck)
        if second == first or second in always_alike(first):
            continue
        if not mixed or group_of(second) != group_of(first):
            return first, second
