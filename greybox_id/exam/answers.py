"""What is sealed about a case: what is really the matter with the vehicle, and what a recording can tell of it."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal, get_args

from ..errors import BadInput
from ..files import write_atomically
from ..json_data import read_json, without_nan
from .aliases import always_alike

Kind = Literal["null", "single", "double", "outside", "real"]
"""No gap; one or two effects of the vocabulary; one outside it; a real vehicle, of which nobody knows the answer."""

Tier = Literal["clean", "workshop", "foreign", "injected", "real"]
"""Exact vehicle file, nominal forms, white noise; tolerances, other forms, coloured noise, outliers; vehicles of
foreign simulators, identified as single tracks; real recordings, altered; or real ones as they are."""

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
    seed : of everything random in it.
    car : the true vehicle as plain data.
    about : rate, duration and so on, for people.
    """

    case: str
    kind: Kind
    tier: Tier
    effects: Mapping[str, float]
    nulls: Mapping[str, float] = field(default_factory=dict)
    aliases: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    size: Mapping[str, float] = field(default_factory=dict)
    left: Mapping[str, float] = field(default_factory=dict)
    seed: int = 0
    car: Mapping[str, Any] = field(default_factory=dict)
    about: Mapping[str, Any] = field(default_factory=dict)

    @property
    def largest(self) -> float:
        """Size of the gap in the channel that shows it best, in noise sds."""
        return max(self.size.values(), default=0.0)

    @property
    def sizable(self) -> bool:
        """Whether there is a gap that must be detected."""
        return self.kind not in ("null", "real") and exceeds(self.left)

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
    plain = {name: dict(own) if isinstance(own, Mapping) else own for name, own in vars(answer).items()}
    return write_atomically(file, json.dumps(without_nan(plain), indent=1) + "\n")


def read_answer(file: Path) -> Answer:
    """Read an answer. Raises `BadInput` where the file is none."""
    body = read_json(file)
    try:
        answer = Answer(**{**body, "aliases": {name: tuple(own) for name, own in body["aliases"].items()}})
    except (TypeError, KeyError, AttributeError) as error:
        raise BadInput(f"{file} is no answer of an examination; restore it, or make the examination again.") from error
    if answer.kind not in get_args(Kind):
        raise BadInput(f'{file}: there is no kind of case "{answer.kind}".')
    return answer
