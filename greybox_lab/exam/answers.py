"""What is sealed about a case: what is really the matter with the vehicle, and what a recording can tell of it."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from math import log, nan
from pathlib import Path
from typing import Any, Literal, cast

from greybox_id.base.declared import of_plain
from greybox_id.base.errors import BadInput
from greybox_id.base.files import write_atomically
from greybox_id.base.json_data import read_json, without_nan

from .aliases import always_alike

Kind = Literal["null", "single", "double", "many", "outside", "changed"]
"""No gap; one, two, or three to six effects of the vocabulary; one outside it; a real change whose name is known, and
whose size is read off otherwise, NaN where it cannot be."""

Tier = Literal["clean", "workshop", "foreign", "many", "rough", "injected", "changed"]
"""Exact vehicle file, nominal forms, white noise; tolerances, other forms, coloured noise, outliers; vehicles of
foreign simulators, identified as single tracks; vehicles of either that lack many things at once; cars on springs whose
file is off by more than it states; real recordings, altered; or a real vehicle that was changed."""

ABOVE = 4.0
"""Standard deviations between unaltered recordings of a vehicle, from which on a fault lies above their scatter: among
ten numbers of a hundred recordings chance puts one so far off in sixteen examinations."""

SIZABLE = 0.1
"""A gap that exceeds this share of the noise floor must be detected: some channel's mean square error over that of its
noise, less one, once tolerances have taken up what they can."""


@dataclass(frozen=True)
class Answer:
    """The answer to one case.

    Attributes
    ----------
    case : name of its folder.
    kind, tier : see `Kind`, `Tier`.
    effects : effect -> magnitude, small ones that are tolerated under the same name included; empty for a null.
    nulls : effect -> the magnitude at which it is not there.
    aliases : effect of the vocabulary -> others that nothing on this recording tells from it.
    size : channel -> root mean square of the difference the effects make to noise-free readings, in noise sds.
    left : the same of what stated tolerances leave of that difference.
    scatter : effect -> standard deviation of its magnitude between recordings in which it is not there, where those of
        the vehicle tell, relative where the effect is a factor; measured before anything is diagnosed.
    seed : of everything random in it.
    car : the true vehicle as plain data.
    about : rate, duration and so on, for people.
    nature : further effects that the vehicle has by its nature, or that its file's errors amount to: to name them is
        neither right nor wrong.
    """

    case: str
    kind: Kind
    tier: Tier
    effects: Mapping[str, float]
    nulls: Mapping[str, float] = field(default_factory=dict)
    aliases: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    size: Mapping[str, float] = field(default_factory=dict)
    left: Mapping[str, float] = field(default_factory=dict)
    scatter: Mapping[str, float] = field(default_factory=dict)
    seed: int = 0
    car: Mapping[str, Any] = field(default_factory=dict)
    about: Mapping[str, Any] = field(default_factory=dict)
    nature: tuple[str, ...] = ()

    @property
    def largest(self) -> float:
        """Size of the gap in the channel that shows it best, in noise sds."""
        return max(self.size.values(), default=0.0)

    @property
    def sizable(self) -> bool:
        """Whether there is a gap that must be detected."""
        return self.kind not in ("null", "changed") and exceeds(self.left)

    @property
    def above(self) -> bool:
        """Whether every effect lies above the scatter between recordings, as far as that is known."""
        return all(self._away(name) >= ABOVE * sd for name, sd in self.scatter.items())

    def _away(self, name: str) -> float:
        """How far a magnitude is from its null, relative where it is a factor."""
        size, null = self.effects[name], self.nulls[name]
        return abs(log(size / null)) if null == 1.0 else abs(size - null)

    def alike(self, effect: str) -> frozenset[str]:
        """The effect and all that this recording cannot tell from it."""
        return frozenset((effect, *always_alike(effect), *self.aliases.get(effect, ())))


def exceeds(left: Mapping[str, float]) -> bool:
    """Whether a gap exceeds a share of the noise floor in some channel.

    Parameters
    ----------
    left : channel -> root mean square of what tolerances leave of it, in noise sds.
    """
    return max(left.values(), default=0.0) ** 2 > SIZABLE


def write_answer(answer: Answer, file: Path) -> Path:
    """Write an answer as JSON."""
    plain = {name: dict(var) if isinstance(var, Mapping) else var for name, var in vars(answer).items()}
    return write_atomically(file, json.dumps(without_nan(plain), indent=1) + "\n")


def read_answer(file: Path) -> Answer:
    """Read an answer. Raises `BadInput` where the file is none."""
    body = read_json(file)
    try:
        return cast(Answer, of_plain(Answer, body, "answer", null=nan))
    except TypeError as error:
        raise BadInput(
            f"{file} is not an answer of an examination; restore it, or make the examination again."
        ) from error
