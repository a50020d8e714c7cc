"""What the report of a diagnosis says: sentences and tables."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from math import inf, isfinite
from typing import Any

from ...gap import Closure, Errors, Gap, Ranked
from ...model import Model
from ...models.effects import EFFECTS
from ...provenance import DataRecord
from ...vehicle import Vehicle
from ..content import recorded_in
from ..document import Table
from ..numbers import capital, listed, number, percent, pretty_unit, rmse, signal_words
from .quantities import interval_words, magnitude_words
from .words import REGIMES, how_far, on_these, probability_words, verdict, whole_percent

LEAST, FIRST = 0.05, 2
"""Effects less probable than this have no sentences of their own unless they are applied or among the first."""
MOST_EVIDENCE, MOST_RANKED = 5, 12
"""Effects that have sentences, and a row in the table."""
ROLES = {"train": "diagnosed", "validate": "held out"}


@dataclass(frozen=True)
class Number:
    """One number as it was stated: `sd` None where it is exact, `value` None for a tolerance about no effect."""

    name: str
    value: float | None
    sd: float | None
    unit: str
    source: str


@dataclass(frozen=True)
class Made:
    """What a diagnosis was made with.

    Attributes
    ----------
    vehicle : its name.
    command : what reproduces it.
    seed, version : of everything random; greybox-id's own.
    data : recordings, those held out in the role "validate".
    settings : from which the model was built.
    effects : of that model, with their magnitudes.
    stated : numbers of the vehicle that the model has, and tolerances on effects.
    """

    vehicle: str
    command: str
    seed: int
    version: str
    data: tuple[DataRecord, ...] = ()
    settings: Mapping[str, Any] = field(default_factory=dict)
    effects: Mapping[str, float] = field(default_factory=dict)
    stated: tuple[Number, ...] = ()


def stated_numbers(vehicle: Vehicle, model: Model) -> tuple[Number, ...]:
    """What is stated of a vehicle that its model has, and tolerances on effects."""
    numbers = [
        Number(name, own.value, own.sd, model[name].unit, own.source)
        for name, own in vehicle.values.items()
        if name in model and model[name].shape == ()
    ]
    tolerances = [
        Number(name, own.value, own.sd, EFFECTS[name].parameter.unit, own.source)
        for name, own in vehicle.effects.items()
        if name in EFFECTS and own.sd is not None
    ]
    return (*numbers, *tolerances)


@dataclass(frozen=True, kw_only=True)
class GapContent:
    """Everything a report of a diagnosis says.

    Attributes
    ----------
    model, about : title, and what is diagnosed.
    verdict : (lead, sentence) pairs.
    doubts : sentences on the data.
    ranking : the effects; evidence : sentences on the likely ones.
    runner_up : a sentence on the likeliest effect that was not applied.
    apart : what could not be told, and the manoeuvre that would tell.
    absorbed : a sentence on what tolerances would take up.
    closures : how far, on which recordings; judged : in a sentence each.
    errors : (title, table) pairs.
    equations, regimes : where.
    recordings, provenance : files, and (what, value) pairs.
    """

    model: str
    about: str
    verdict: tuple[tuple[str, str], ...]
    doubts: tuple[str, ...]
    ranking: Table
    evidence: tuple[tuple[str, str], ...]
    runner_up: str
    apart: tuple[str, ...]
    absorbed: str
    closures: Table
    judged: tuple[str, ...]
    errors: tuple[tuple[str, Table], ...]
    equations: Table
    regimes: Table
    recordings: Table
    provenance: tuple[tuple[str, str], ...]


def gap_content(gap: Gap, made: Made) -> GapContent:
    """What a report of a diagnosis says."""
    both = [(gap.gap, False), *([(gap.held_out, True)] if gap.held_out is not None else [])]
    own = gap.where
    return GapContent(
        model=gap.model,
        about=f"Where the simulation of {made.vehicle} deviates from {listed([*gap.recordings])}, and why",
        verdict=tuple(verdict(gap)),
        doubts=gap.doubts,
        ranking=_ranking(gap),
        evidence=tuple(_evidence(gap)),
        runner_up=_runner_up(gap),
        apart=gap.advice,
        absorbed=_absorbed(gap),
        closures=Table(
            ("recordings", "before", "after", "floor", "closes by"), tuple(_row(*one) for one in both), "Lrrrr"
        ),
        judged=tuple(f"{capital(how_far(gap, *one))}." for one in both),
        errors=tuple(
            (f"{'Held out' if held_out else 'Diagnosed'}: {listed([*one.recordings])}", _errors(one, bool(gap.applied)))
            for one, held_out in reversed(both)
            if one.errors
        ),
        equations=Table(
            ("equation", "share of the gap"),
            tuple((k, percent(v)) for k, v in own.equations.items() if gap.gap_detected),
            "lr",
        ),
        regimes=_regimes(gap),
        recordings=recorded_in(made.data, ROLES),
        provenance=(
            ("version", f"greybox-id {made.version}"),
            ("command", made.command or "not recorded (diagnosed from Python)"),
            ("seed", str(made.seed)),
        ),
    )


def _ranking(gap: Gap) -> Table:
    rows = tuple(
        (
            str(k), own.effect, magnitude_words(own), interval_words(own), probability_words(own.probability),
            number(own.gain), "yes" if own.effect in gap.applied else "",
        )
        for k, own in enumerate(gap.ranking[:MOST_RANKED], 1)
    )  # fmt: skip
    return Table(("", "effect", "magnitude ± sd", "95 % interval", "probability", "gain", "applied"), rows, "rLllrrl")


def likely(gap: Gap) -> list[Ranked]:
    """The effects that have sentences of their own."""
    return [
        own for k, own in enumerate(gap.ranking) if k < FIRST or own.probability >= LEAST or own.effect in gap.applied
    ][:MOST_EVIDENCE]


def _evidence(gap: Gap) -> list[tuple[str, str]]:
    """The likely effects, each with its sentences."""
    best = max((own.gain for own in gap.ranking), default=0.0)
    return [(own.effect, " ".join(_sentences(gap, own, best))) for own in likely(gap)]


def _sentences(gap: Gap, own: Ranked, best: float) -> list[str]:
    known = EFFECTS.get(own.effect)
    about = known.parameter.about if known is not None else ""
    said = [
        f"{capital(about)}: {magnitude_words(own)}." if about else f"{magnitude_words(own)}.",
        f"It belongs to {known.group} and acts on {listed([*known.touches])}." if known is not None else "",
        f"It is there with probability {probability_words(own.probability)}"
        + (" and was applied." if own.effect in gap.applied else "."),
        f"With it the log-likelihood gains {number(own.gain)}"
        + (f", {number(best - own.gain)} less than with the best." if own.gain < best else "."),
    ]
    said = [sentence for sentence in said if sentence]
    if _touches_null(own):
        said.append("Its interval reaches to where it is not there at all.")
    if own.indistinguishable_from:
        said.append(f"It cannot be told from {listed([*own.indistinguishable_from])} on {on_these(gap.recordings)}.")
    return said


def _runner_up(gap: Gap) -> str:
    """The likeliest effect that was not applied, against the likeliest that was."""
    others = [own for own in gap.ranking if own.effect not in gap.applied]
    first = next((own for own in gap.ranking if own.effect in gap.applied), None)
    if not others or first is None:
        return ""
    second = others[0]
    less = first.gain - second.gain
    how = f"{number(less)} less than" if less > 0 else "no less than"
    return (
        f"{second.effect}, {magnitude_words(second)}, with probability {probability_words(second.probability)}; alone "
        f"in its place it would gain {number(second.gain)} of the log-likelihood, {how} {first.effect}."
    )


def _touches_null(own: Ranked) -> bool:
    known = EFFECTS.get(own.effect)
    return known is not None and own.interval[0] <= float(known.parameter.array) <= own.interval[1]


def _regimes(gap: Gap) -> Table:
    """Shares of the time, and of the gap where there is one."""
    head = ("regime", "of the time", *(("of the gap",) if gap.gap_detected else ()))
    rows = tuple(
        (REGIMES.get(k, k), percent(t), *((percent(g),) if gap.gap_detected else ()))
        for k, (t, g) in gap.where.regimes.items()
    )
    return Table(head, rows, "lrr"[: len(head)])


def _absorbed(gap: Gap) -> str:
    if not gap.absorbed:
        return ""
    return f"Stated tolerances or free parameters would take up {listed([*gap.absorbed])}: no gap is left to show it."


def _row(closure: Closure, held_out: bool) -> tuple[str, ...]:
    names = f"{listed([*closure.recordings])} ({'held out' if held_out else 'diagnosed'})"
    low, high = (whole_percent(end) for end in closure.closed_interval)
    share = f"{whole_percent(closure.closed)} % [{low}, {high}]" if isfinite(closure.closed) else "–"
    return (names, number(closure.before), number(closure.after), number(closure.floor), share)


def _errors(closure: Closure, applied: bool) -> Table:
    """Before → after (floor), a row for each channel, a column for each horizon; without effects there is no after."""
    horizons = sorted({own.horizon for own in closure.errors}, key=lambda h: inf if h is None else h)
    by = {(own.channel, own.horizon): own for own in closure.errors}
    rows = []
    for channel in dict.fromkeys(own.channel for own in closure.errors):
        found = [by.get((channel, horizon)) for horizon in horizons]
        unit = next(own.unit for own in found if own is not None)
        cells = ("–" if e is None else _cell(e, applied) for e in found)
        rows.append((f"{signal_words(channel)} [{pretty_unit(unit)}]", *cells))
    return Table(
        ("channel", *("free run" if h is None else f"{h:g} s" for h in horizons)),
        tuple(rows),
        "l" + "R" * len(horizons),
    )


def _cell(error: Errors, applied: bool) -> str:
    after = f" → {rmse(error.after)}" if applied else ""
    return f"{rmse(error.before)}{after} ({number(error.floor, 2)})"
