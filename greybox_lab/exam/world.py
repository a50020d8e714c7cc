"""A case of the virtual vehicle: of any class, known exactly or within tolerances, driven twice."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, replace
from functools import partial
from typing import Any, get_args

from greybox_id.base.json_data import attributes
from greybox_id.base.shorthands import Array
from greybox_id.datasets.recording import Recording

from ..virtual.virtual_vehicle import (
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
)
from ..virtual.virtual_vehicle.effects import ALL
from ..virtual.virtual_vehicle.effects import Kind as Class
from .case import Draw, MadeCase, fair_case, with_lateral_velocity
from .plan import Planned
from .replays import Replays

PERIODS = (0.010, 0.012, 0.015, 0.016, 0.020)
"""Sample times, s."""
DURATION, HELD_OUT = (60.0, 120.0), (40.0, 60.0)
COLOUR, OUTLIERS = (0.2, 0.6), (0.001, 0.004)
"""Noise of tier workshop: share that is correlated, and share of outliers."""
BEYOND = 2.0
"""Least deviation of a small effect, in standard deviations of its tolerance, from which naming it is right: 19 in 20
vehicles deviate less."""
DRAWS = 20
"""Most draws of magnitudes and vehicle until every effect is detectable."""


def made(planned: Planned) -> MadeCase:
    """Make a case; see `fair_case`."""
    return fair_case(partial(_VirtualCase, planned), DRAWS, "vehicles")


class _VirtualCase(Draw):
    known, outside = EFFECTS, OUTSIDE

    def __init__(self, planned: Planned, attempt: int) -> None:
        super().__init__(planned, attempt)
        rng = self.rng
        kinds: tuple[Class, ...] = get_args(Class)
        drawn = random_vehicle(int(rng.integers(2**31)), kinds[planned.number % len(kinds)])
        named = replace(drawn, name=drawn.kind)  # its own name would reveal the seed
        self.stated = with_lateral_velocity(named, planned.effects)
        workshop = planned.tier != "clean"
        self.tolerances = tolerances(self.stated) if workshop else None
        self.car = toleranced(self.stated, rng) if workshop else self.stated
        self.drawn = {name: self.stated.magnitude(name, rng) for name in planned.effects}
        self.rate = 1.0 / float(rng.choice(PERIODS))
        self.spoilt = {}
        if workshop:
            self.spoilt = {"colour": float(rng.uniform(*COLOUR)), "outliers": float(rng.uniform(*OUTLIERS))}
        seed, self.other_seed = (int(item) for item in rng.choice(2**31 - 1, 2, replace=False))
        self.effects, self.seed = self.drawn, seed
        self._drive("other" if workshop else "nominal")
        if planned.kind == "many":
            self.resize()
            self._drive(self.truth.forms)

    def _drive(self, forms: str | Forms) -> None:
        self.recording, self.truth = self._driven(DURATION, self.effects, forms, self.seed)
        wind = {name: effect for name, effect in self.truth.effects.items() if name == "wind_direction"}
        self.effects = {**self.drawn, **wind}
        period = self.recording.sample_time
        self.again = Replays(self._driven_again, self.car.noise, len(self.recording), period, self.tolerances)

    def _driven_again(self, effects: Mapping[str, float], rows: int, beyond: str) -> Mapping[str, Array]:
        """Simulation of another vehicle with the recording's commands, see `replays.Drive`."""
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
        result, _ = replay(car, commands, start, effects, self.truth.forms, self.seed)
        return result.signals

    def _driven(
        self, duration: tuple[float, float], effects: Mapping[str, float], forms: str | Forms, seed: int
    ) -> tuple[Recording, Truth]:
        seconds = float(self.rng.uniform(*duration))
        return drive(self.car, "mixed", seconds, self.rate, effects, forms, seed, **self.spoilt)

    @property
    def sized(self) -> VirtualCar:
        """The true vehicle."""
        return self.car

    def made(self) -> MadeCase:
        """The case with its answer."""
        held_out, _ = self._driven(HELD_OUT, self.effects, self.truth.forms, self.other_seed)
        self.nature = self._nature()
        withheld = {name: self.truth.effects.get(name, item) for name, item in self.drawn.items()}
        more = {"forms": asdict(self.truth.forms), **self.spoilt}
        return self.case(held_out, withheld, _plain(self.car), {"rate": self.rate}, more)

    def _nature(self) -> tuple[str, ...]:
        """Small effects beyond their tolerances, and the lag of a steering play with elastic stops."""
        far = [
            name for name, sd in (self.tolerances.effects if self.tolerances else {}).items()
            if abs(self.car.small[name] - ALL[name].null) > BEYOND * sd
        ]  # fmt: skip
        soft = "steering_backlash" in self.effects and self.truth.forms.backlash == "soft_play"
        return tuple(dict.fromkeys([*far, *(["steering_lag"] if soft else [])]))


def _plain(car: VirtualCar) -> dict[str, Any]:
    body = attributes(car, "kind", "drive_channel", "steer_max", "top_speed")
    return body | {name: dict(getattr(car, name)) for name in ("parameters", "noise", "small")}
