"""One case made: a vehicle drawn, driven twice, and what its recording can tell."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, replace
from functools import cached_property
from typing import Any, get_args

import numpy as np

from ..datasets.virtual_vehicle import (
    EFFECTS,
    OUTSIDE,
    Forms,
    Truth,
    VirtualCar,
    drive,
    random_vehicle,
    replay,
    toleranced,
    tolerances,
    vehicle_file_text,
)
from ..datasets.virtual_vehicle.entries import Kind as Class
from ..errors import BadInput
from ..parameter import Array
from ..recording import Recording
from .aliases import Cause, indistinguishable
from .answers import Answer, exceeds
from .plan import Planned
from .replays import Replays

PERIODS = (0.010, 0.012, 0.015, 0.016, 0.020)
"""Between rows, s."""
DURATION, HELD_OUT = (60.0, 120.0), (40.0, 60.0)
COLOUR, OUTLIERS = (0.2, 0.6), (0.001, 0.004)
"""Of the workshop's noise: share that is correlated, share of readings that are far off."""
DRAWS = 20
"""Draws of magnitudes and vehicle until every effect shows: what does not cannot be asked for."""


@dataclass(frozen=True)
class MadeCase:
    """A case as it is handed out, and what is kept back.

    Attributes
    ----------
    recording, vehicle_file : handed out.
    held_out, answer : kept back.
    columns : a column map, handed out where it is not the usual one: it says how commands run between rows.
    """

    recording: Recording
    vehicle_file: str
    held_out: Recording
    answer: Answer
    columns: str = ""


def made(planned: Planned) -> MadeCase:
    """Make a case; it is drawn anew while an effect does not show, or one outside looks like one of the vocabulary.

    Raises
    ------
    BadInput : none of the draws can be simulated.
    """
    last: _Case | None = None
    for attempt in range(DRAWS):
        try:
            case = _Case(planned, attempt)
            fair = case.shows and not (planned.kind == "outside" and any(case.aliases.values()))
        except BadInput:  # beyond all bounds
            if last is None and attempt == DRAWS - 1:
                raise
            continue
        last = case
        if fair:
            break
    assert last is not None
    return last.made()


class _Case:
    """One draw of vehicle, magnitudes and drive."""

    def __init__(self, planned: Planned, attempt: int) -> None:
        self.planned = planned
        self.rng = rng = np.random.default_rng((planned.seed, attempt, 1153))
        kinds: tuple[Class, ...] = get_args(Class)
        drawn = random_vehicle(int(rng.integers(2**31)), kinds[planned.number % len(kinds)])
        self.stated = replace(drawn, name=drawn.kind)  # its own name tells the seed
        if "velocity_lever_arm" in planned.effects and not self.stated.measures_v_y:
            self.stated = replace(self.stated, noise={**self.stated.noise, "v_y": self.stated.noise["v_x"]})
        workshop = planned.tier == "workshop"
        self.tolerances = tolerances(self.stated) if workshop else None
        self.car = toleranced(self.stated, rng) if workshop else self.stated
        self.drawn = {name: self.stated.magnitude(name, rng) for name in planned.effects}
        self.rate = 1.0 / float(rng.choice(PERIODS))
        self.spoilt = {}
        if workshop:
            self.spoilt = {"colour": float(rng.uniform(*COLOUR)), "outliers": float(rng.uniform(*OUTLIERS))}
        seed, self.other_seed = (int(own) for own in rng.choice(2**31 - 1, 2, replace=False))
        forms = "other" if workshop else "nominal"
        self.recording, self.truth = self._driven(DURATION, self.drawn, forms, seed)
        wind = {name: own for name, own in self.truth.effects.items() if name == "wind_direction"}
        self.effects = {**self.drawn, **wind}
        self.seed = seed
        period = self.recording.sample_time
        self.again = Replays(self._driven_again, self.car.noise, len(self.recording), period, self.tolerances)

    def _driven_again(self, effects: Mapping[str, float], rows: int, beyond: str) -> Mapping[str, Array]:
        """The recording's commands driven by another vehicle, see `replays.Drive`."""
        car, known = self.car, self.tolerances
        if beyond and known is not None:
            if beyond in known.parameters:
                moved = car.parameters[beyond] + known.parameters[beyond]
                car = replace(car, parameters={**car.parameters, beyond: moved})
            else:
                null = 1.0 if beyond == "steering_ratio" else 0.0
                moved = car.small.get(beyond, null) + known.effects[beyond]
                car = replace(car, small={**car.small, beyond: moved})
        commands = self.recording.rows(0, rows) if rows < len(self.recording) else self.recording
        start = {name: float(self.truth.states[name][0]) for name in ("v_x", "v_y", "yaw_rate")}
        found, _ = replay(car, commands, start, effects, self.truth.forms, self.seed)
        return found.signals

    def _driven(
        self, duration: tuple[float, float], effects: Mapping[str, float], forms: str | Forms, seed: int
    ) -> tuple[Recording, Truth]:
        seconds = float(self.rng.uniform(*duration))
        return drive(self.car, "mixed", seconds, self.rate, effects, forms, seed, **self.spoilt)

    def made(self) -> MadeCase:
        """The case with its answer."""
        held_out, _ = self._driven(HELD_OUT, self.effects, self.truth.forms, self.other_seed)
        answer = Answer(
            case=self.planned.case,
            kind=self.planned.kind,
            tier=self.planned.tier,
            effects={name: self.truth.effects.get(name, own) for name, own in self.drawn.items()},
            nulls={name: {**EFFECTS, **OUTSIDE}[name].null for name in self.drawn},
            aliases=self.aliases if self.shows else {},
            size=self.again.size(self.effects, {}),
            left=self.again.left(self.effects, {}),
            seed=self.planned.seed,
            car=_plain(self.car),
            about={
                "rate": self.rate,
                "rows": len(self.recording),
                "held_out_rows": len(held_out),
                "drawn": self.effects,
                "forms": asdict(self.truth.forms),
                **self.spoilt,
            },
        )
        return MadeCase(self.recording, vehicle_file_text(self.stated, self.tolerances), held_out, answer)

    @cached_property
    def shows(self) -> bool:
        """Whether every effect makes a gap beside the others that must be detected."""
        for name in self.drawn:
            rest = {other: own for other, own in self.effects.items() if other != name}
            if not exceeds(self.again.size(self.effects, rest)) or not exceeds(self.again.left(self.effects, rest)):
                return False
        return True

    @cached_property
    def aliases(self) -> dict[str, tuple[str, ...]]:
        """What the recording cannot tell apart."""
        if not self.drawn:
            return {}
        causes = {
            name: Cause(entry.null, entry.at, entry.sizes(self.car.size, self.car.kind)[0], entry.sides)
            for name, entry in EFFECTS.items()
            if name != "velocity_lever_arm" or self.car.measures_v_y
        }
        alike = [other for name in self.drawn if name in OUTSIDE for other in OUTSIDE[name].resembles]
        return indistinguishable(self.drawn, causes, self.again.views(), alike)


def _plain(car: VirtualCar) -> dict[str, Any]:
    body = {name: getattr(car, name) for name in ("kind", "drive_channel", "steer_max", "top_speed")}
    return body | {name: dict(getattr(car, name)) for name in ("parameters", "noise", "small")}
