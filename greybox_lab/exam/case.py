"""A case of an examination: draws of a vehicle and of withheld effects, until these are detectable."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable, Mapping
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from greybox_id.base.errors import BadInput
from greybox_id.datasets.recording import Recording

from ..virtual.virtual_vehicle import Tolerances, VirtualCar, vehicle_file_text
from ..virtual.virtual_vehicle.effects import Entry
from .aliases import Cause, indistinguishable
from .answers import Answer, exceeds
from .plan import MANY, Planned
from .replays import Replays

VISIBLE = 1.5
"""Least ratio, in some channel, of an effect to the model error, both after refitting within tolerances, for which the
effect may be withheld."""
OVER_BACKGROUND = (1.15, 3.0)
"""Least and largest ratio, in cases with many effects, of the error with an effect to that without it, after refitting
the other effects and the tolerances, in the channel with the largest ratio. Without it, noise and any model error
remain."""
RESIZED = 4
"""Iterations that adjust magnitudes to this range: the influence of one effect depends on the others."""
AIMED = (1.3, 2.7)
"""Range that is aimed at: driven again, the vehicle moves slightly differently."""


@dataclass(frozen=True)
class MadeCase:
    """A case with its withheld parts.

    Attributes
    ----------
    recording, vehicle_file : handed out.
    held_out, answer : withheld.
    columns : a column map, handed out if it is not the usual one: it states how commands are held between rows.
    """

    recording: Recording
    vehicle_file: str
    held_out: Recording
    answer: Answer
    columns: str = ""


class NotInstalled(BadInput):
    """A simulator is not installed."""


class Draw(ABC):
    """One draw of vehicle, magnitudes and drive.

    Attributes
    ----------
    planned : plan of the case.
    stated : the vehicle that is handed out.
    tolerances : as stated; None if the vehicle that is handed out is exact.
    drawn : magnitudes of the withheld effects.
    effects : those, and effects that accompany them.
    recording : handed out.
    again : simulates the recording again.
    known : entries of the vocabulary that the vehicle may have.
    outside : entries outside the vocabulary.
    nature : see `answers.Answer`.
    """

    planned: Planned
    stated: VirtualCar
    tolerances: Tolerances | None
    drawn: Mapping[str, float]
    effects: Mapping[str, float]
    recording: Recording
    again: Replays
    known: Mapping[str, Entry]
    outside: Mapping[str, Entry]
    nature: tuple[str, ...] = ()

    def __init__(self, planned: Planned, attempt: int) -> None:
        self.planned = planned
        self.rng = np.random.default_rng((planned.seed, attempt, 1153))

    @property
    def fair(self) -> bool:
        """Whether withheld effects are detectable, and one outside the vocabulary resembles none in it."""
        return self.shows and not (self.planned.kind == "outside" and any(self.aliases.values()))

    def resize(self) -> None:
        """Adjust magnitudes of many effects until each is detectable given the others, and none dominates; an effect
        that is not detectable at any size, since the others replace it, is dropped.
        """
        least, most = np.log(AIMED)
        aims = dict(zip(self.drawn, np.exp(self.rng.uniform(least, most, len(self.drawn))), strict=True))
        size, kind, drawn = self.sized.size, self.sized.kind, dict(self.drawn)
        for step in range(RESIZED + len(drawn)):
            over = self.over_background
            if all(AIMED[0] <= item <= AIMED[1] for item in over.values()):
                return
            weakest = min(over, key=lambda name: over[name])
            if step >= RESIZED // 2 and over[weakest] < AIMED[0] and len(drawn) > MANY[0]:
                del drawn[weakest]
            else:
                for name, item in over.items():
                    if not AIMED[0] <= item <= AIMED[1]:
                        factor = np.sqrt((aims[name] ** 2 - 1.0) / max(item**2 - 1.0, 1e-4))
                        drawn[name] = self.known[name].scaled(drawn[name], float(np.clip(factor, 0.2, 5.0)), size, kind)
            rest = {name: effect for name, effect in self.effects.items() if name not in self.drawn}
            self.drawn, self.effects = dict(drawn), {**rest, **drawn}

    @property
    def over_background(self) -> dict[str, float]:
        """Effect -> ratio of the error with it to that without it, see `OVER_BACKGROUND`."""
        again = self.again
        full = again.readings(self.effects)
        parts = {name: full - again.readings({k: v for k, v in self.effects.items() if k != name})
                 for name in self.drawn}  # fmt: skip
        nothing = dict.fromkeys(again.noise, 0.0)
        hidden = nothing if again.form is None else again.beside_tolerances(again.form)
        result = {}
        for name, part in parts.items():
            left = again.beside_tolerances(part, [part for other, part in parts.items() if other != name])
            result[name] = max(float(np.hypot(1.0, left[c] / np.hypot(1.0, hidden[c]))) for c in left)
        return result

    @cached_property
    def shows(self) -> bool:
        """Whether each effect, given the others, makes a gap that must be detected and is not hidden by model error."""
        if self.planned.kind == "many":
            least, most = OVER_BACKGROUND
            return all(least <= item <= most for item in self.over_background.values())
        rests = [{other: effect for other, effect in self.effects.items() if other != name} for name in self.drawn]
        if not all(exceeds(self.again.size(self.effects, rest)) for rest in rests):
            return False  # avoids the simulations of all tolerances, which take far longer
        if not rests or self.again.form is None:
            return all(exceeds(self.again.left(self.effects, rest)) for rest in rests)
        hidden = self.again.beside_tolerances(self.again.form)
        lefts = [self.again.left(self.effects, rest) for rest in rests]
        return all(exceeds(left) and any(left[c] >= VISIBLE * hidden[c] for c in left) for left in lefts)

    @cached_property
    def aliases(self) -> dict[str, tuple[str, ...]]:
        """Effects that the recording cannot distinguish."""
        if not self.drawn:
            return {}
        car = self.sized
        causes = {
            name: Cause(entry.null, entry.at, entry.sizes(car.size, car.kind)[0], entry.sides)
            for name, entry in self.known.items()
            if name != "velocity_lever_arm" or car.measures_v_y
        }
        alike = [other for name in self.drawn if name in self.outside for other in self.outside[name].resembles]
        return indistinguishable(self.drawn, causes, self.again.views(), alike)

    @property
    def sized(self) -> VirtualCar:
        """The vehicle that determines typical sizes of effects."""
        return self.stated

    @abstractmethod
    def made(self) -> MadeCase:
        """The case with its answer."""

    def case(
        self, held_out: Recording, withheld: Mapping[str, float], car: dict[str, Any], about: dict[str, Any],
        more: dict[str, Any], columns: str = "",
    ) -> MadeCase:  # fmt: skip
        """The case with an answer of these true effects; `about` and `more` are for people."""
        answer = Answer(
            case=self.planned.case,
            kind=self.planned.kind,
            tier=self.planned.tier,
            effects=dict(withheld),
            nulls={name: {**self.known, **self.outside}[name].null for name in self.drawn},
            aliases=self.aliases if self.shows else {},
            size=self.again.size(self.effects, {}),
            left=self.again.left(self.effects, {}),
            nature=self.nature,
            seed=self.planned.seed,
            car=car,
            about={**about, "rows": len(self.recording), "held_out_rows": len(held_out), "drawn": self.effects, **more},
        )
        return MadeCase(self.recording, vehicle_file_text(self.stated, self.tolerances), held_out, answer, columns)


LATER = 5
"""Factor on the number of attempts if none could be driven: one foreign vehicle of each class, and the first class
again. A single track describes about one in twenty trucks with suspension."""


def fair_case(draw: Callable[[int], Draw], attempts: int, words: str) -> MadeCase:
    """The first fair draw; if none is, the last one that can be driven, or the first such one of further attempts.

    Parameters
    ----------
    draw : number of the attempt -> a draw.
    words : what is drawn, for messages.

    Raises
    ------
    BadInput : if none can be simulated, or the simulator is not installed.
    """
    last: Draw | None = None
    for attempt in range(LATER * attempts):
        if last is not None and attempt >= attempts:
            break
        try:
            one = draw(attempt)
            if one.fair:
                return one.made()
        except NotInstalled:
            raise
        except BadInput:  # the simulation diverged
            continue
        last = one
    if last is not None:
        with suppress(BadInput):
            return last.made()
    raise BadInput(f"None of {LATER * attempts} {words} can be driven; take another ‹seed›.")


def with_lateral_velocity(car: VirtualCar, effects: Iterable[str]) -> VirtualCar:
    """A vehicle with measured lateral velocity if an effect acts on that reading only."""
    if "velocity_lever_arm" not in effects or car.measures_v_y:
        return car
    return replace(car, noise={**car.noise, "v_y": car.noise["v_x"]})
