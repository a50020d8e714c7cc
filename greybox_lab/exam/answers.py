"""Sealed answers of cases: the true effects in a vehicle, and what a recording can determine about them."""

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
"""No gap; one, two, or three to six effects of the vocabulary; one outside it; a real change of known effect, whose
size is measured independently, or NaN."""

Tier = Literal["clean", "workshop", "foreign", "many", "rough", "injected", "changed"]
"""Exact vehicle file, nominal model forms, white noise; tolerances, other forms, coloured noise, outliers; vehicles of
foreign simulators, identified as single tracks; vehicles of either with many effects at once; cars with suspension
whose file has larger errors than stated; altered real recordings; a real vehicle that was changed."""

ABOVE = 4.0
"""Least size of a fault that counts as above the scatter between unaltered recordings of a vehicle, in standard
deviations: by chance, one of ten numbers of a hundred recordings is that far off once in sixteen examinations."""

SIZABLE = 0.1
"""Least gap that must be detected, relative to the noise: excess of some channel's mean square error over that of its
noise, divided by the latter, after parameters were refitted within their tolerances."""


@dataclass(frozen=True)
class Answer:
    """The answer to one case.

    case : name of its folder.
    kind, tier : see `Kind`, `Tier`.
    effects : effect -> magnitude, including a tolerated small effect of the same name; empty for a null.
    nulls : effect -> magnitude of the absent effect.
    aliases : effect of the vocabulary -> others that cannot be distinguished from it on this recording.
    size : channel -> root mean square of the effects' influence on noise-free readings, in noise sds.
    left : likewise, after parameters were refitted within their tolerances.
    scatter : effect -> standard deviation of its magnitude between recordings without it, if the vehicle's recordings
        determine it, relative for factors; measured before any diagnosis.
    seed : of its random numbers.
    car : the true vehicle as plain data.
    about : rate, duration and so on, for people.
    nature : further effects that are inherent to the vehicle or equivalent to errors of its file: naming them is
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
        """Size of the gap in the channel with the largest one, in noise sds."""
        return max(self.size.values(), default=0.0)

    @property
    def sizable(self) -> bool:
        """Whether there is a gap that must be detected."""
        return self.kind not in ("null", "changed") and exceeds(self.left)

    @property
    def above(self) -> bool:
        """Whether every effect is above the scatter between recordings, if that is known."""
        return all(self._away(name) >= ABOVE * sd for name, sd in self.scatter.items())

    def _away(self, name: str) -> float:
        """Distance of a magnitude from its null, relative for factors."""
        size, null = self.effects[name], self.nulls[name]
        return abs(log(size / null)) if null == 1.0 else abs(size - null)

    def alike(self, effect: str) -> frozenset[str]:
        """The effect and all effects that cannot be distinguished from it on this recording."""
        return frozenset((effect, *always_alike(effect), *self.aliases.get(effect, ())))


def exceeds(left: Mapping[str, float]) -> bool:
    """Whether a gap exceeds a share of the noise in some channel.

    Parameters
    ----------
    left : channel -> root mean square of the gap after refitting within tolerances, in noise sds.
    """
    return max(left.values(), default=0.0) ** 2 > SIZABLE


def write_answer(answer: Answer, file: Path) -> Path:
    """Write an answer as JSON."""
    plain = {name: dict(var) if isinstance(var, Mapping) else var for name, var in vars(answer).items()}
    return write_atomically(file, json.dumps(without_nan(plain), indent=1) + "\n")


def read_answer(file: Path) -> Answer:
    """Read an answer. Raises `BadInput` if the file is not one."""
    body = read_json(file)
    try:
        return cast(Answer, of_plain(Answer, body, "answer", null=nan))
    except TypeError as error:
        raise BadInput(
            f"{file} is not an answer of an examination; restore it, or make the examination again."
        ) from error
