"""A vehicle made ready to be simulated, and a recording made of its simulation."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from math import ceil

import numpy as np

from ...errors import BadInput
from ...recording import Recording
from .car import VirtualCar
from .compiled import Car, Grid, Row
from .driver import Driver, driver
from .effects import ALL, complete
from .forms import NOMINAL, Forms, other
from .layout import READABLE, ROW_TRUTH
from .loop import STEP, first_moment, simulator
from .record import record
from .sensors import Motion, hung, instants, noisy, read

_STREAMS = ("road", "plan", "forms", "when", "sensors", "noise", "drops", "gusts", "wind")


class Simulation:
    """A vehicle that carries out a plan; parameters as of `loop.simulator`.

    Parameters
    ----------
    steps : how many there can be.
    start : (3,) v_x, v_y, yaw_rate at the first row.

    Attributes
    ----------
    done : steps that were taken.
    state : (STATES,) as it is now.
    commands, readable, truth : (rows, 2), (steps, 2, k) and (rows, k), as of `loop.simulator`; zero from `done` on.
    """

    def __init__(
        self, car: Car, knows: Driver, road: Grid, spacing: float, plan: Grid, first: int, hold: int, steps: int,
        start: Row, gusts: Row,
    ) -> None:  # fmt: skip
        self._given = (car, knows, road, spacing, plan, first, hold, gusts)
        self._now = first_moment(car, start)
        self.state = self._now.s
        self.plan, self.steps, self.done = plan, steps, 0
        self.commands, self.truth = np.zeros((len(plan), 2)), np.zeros((len(plan), len(ROW_TRUTH)))
        self.readable = np.zeros((steps, 2, len(READABLE)))

    def advance(self, to: int) -> None:
        """Take steps until so many are done."""
        simulator()(*self._given, self._now, self.done, to, self.commands, self.readable, self.truth)
        self.done = to


@dataclass(frozen=True)
class Truth:
    """What really happened in a recording.

    Attributes
    ----------
    car : that was driven.
    effects : magnitudes of all effects that were not at their null, small ones of the car included, and the second
        parameters that were given or drawn.
    forms : mathematical forms.
    states : name -> (n,) just after every row's time: v_x, v_y, yaw_rate, a_x, a_y at the centre of gravity,
        yaw_acceleration, roll, roll_acceleration and `layout.ROW_TRUTH`; SI units.
    readings : name -> (n,) what sensors read without noise, and before readings hang.
    """

    car: VirtualCar
    effects: Mapping[str, float]
    forms: Forms
    states: Mapping[str, Row]
    readings: Mapping[str, Row]


@dataclass(frozen=True)
class MadeRecording:
    """A vehicle in the form in which it is simulated."""

    car: VirtualCar
    effects: Mapping[str, float]
    forms: Forms
    rng: Mapping[str, np.random.Generator]
    hold: int

    def recorded(
        self, name: str, plan: Grid, road: Grid, spacing: float, run_in: int, start: Row,
        spoilt: tuple[float, float, float, float],
    ) -> tuple[Recording, Truth]:  # fmt: skip
        """Carry out a plan; spoilt: noise, colour, outliers, quantisation."""
        car, size = self.car, self.car.size
        ridden = self.simulation(plan, road, spacing, run_in, start)
        ridden.advance(ridden.steps)
        commands, readable, truth = ridden.commands, ridden.readable, ridden.truth
        if not np.all(np.isfinite(readable)):
            raise BadInput(f"{name}: the simulated motion blew up; the vehicle or its effects are beyond all bounds.")

        period, rows = self.hold * STEP, len(plan) - run_in
        time = np.asarray(period * np.arange(rows), float)
        motion = Motion(readable, run_in * self.hold)
        when = instants(time, self._complete, self.forms.latency == "jittering", self.rng["when"])
        known = {**car.parameters, "top_speed": size.top_speed}
        clean = read(motion, when, self._complete, known, self.rng["sensors"])
        sd = {signal: spoilt[0] * own for signal, own in car.noise.items()}
        read_ones = noisy(clean, sd, period, *spoilt[1:], self.rng["noise"])
        read_ones = hung(read_ones, time, self._complete, self.rng["drops"])

        signals = {**read_ones, "steer": commands[run_in:, 0], car.drive_channel: commands[run_in:, 1]}
        now = readable[run_in * self.hold : len(plan) * self.hold : self.hold, 0]
        states = {signal: now[:, k] for k, signal in enumerate(READABLE)}
        states |= {signal: truth[run_in:, k] for k, signal in enumerate(ROW_TRUTH)}
        there = {key: value for key, value in self._asked.items() if key not in ALL or value != ALL[key].null}
        return Recording(name, time, signals), Truth(car, there, self.forms, states, clean)

    def simulation(self, plan: Grid, road: Grid, spacing: float, run_in: int, start: Row) -> Simulation:
        """The vehicle before the first row of a plan."""
        effects = self._complete
        steps = len(plan) * self.hold + ceil(8.0 * effects["timestamp_jitter"] / STEP) + 1
        gusts = self._gusts(effects["side_gusts"], steps)
        own = record(self.car, effects, self.forms)
        return Simulation(own, driver(self.car), road, spacing, plan, run_in, self.hold, steps, start, gusts)

    @cached_property
    def _asked(self) -> dict[str, float]:
        """Effects, small ones included; the direction of a wind is drawn where it is not given."""
        asked = combined(self.car.small, self.effects)
        if asked.get("wind_gust", 0.0) != 0.0 and "wind_direction" not in asked:
            asked["wind_direction"] = float(self.rng["wind"].uniform(-np.pi, np.pi))
        return asked

    @cached_property
    def _complete(self) -> dict[str, float]:
        return complete(self._asked, self.car.size)

    def _gusts(self, sd: float, steps: int) -> Row:
        """Wind across, m/s, that changes within a second by scale."""
        if sd == 0.0:
            return np.zeros(1)
        coarse = 20
        n, keeps = steps // coarse + 2, np.exp(-coarse * STEP / (0.8 * self.car.size.time))
        shocks, values = self.rng["gusts"].standard_normal(n), np.zeros(n)
        for k in range(1, n):
            values[k] = keeps * values[k - 1] + np.sqrt(1.0 - keeps**2) * shocks[k]
        return np.asarray(sd * np.interp(np.arange(steps) / coarse, np.arange(n), values))


def made(car: VirtualCar, effects: Mapping[str, float], forms: str | Forms, seed: int, rate: float) -> MadeRecording:
    """A vehicle with effects in its forms, with all that is random drawn by a seed; parameters as for `drive.drive`."""
    hold, rng = _hold(rate), _streams(seed)
    return MadeRecording(car, effects, _forms(forms, rng["forms"]), rng, hold)


def combined(*several: Mapping[str, float]) -> dict[str, float]:
    """Effects acting together: factors multiply, what is added adds, of limits the smallest holds."""
    total: dict[str, float] = {}
    for effects in several:
        for name, value in effects.items():
            null = ALL[name].null if name in ALL else None
            if name not in total or null is None:
                total[name] = value
            elif null == 0.0:
                total[name] += value
            elif null == 1.0:
                total[name] *= value
            else:
                total[name] = min(total[name], value)
    return total


def _hold(rate: float) -> int:
    """Steps of the simulation between rows."""
    hold = int(round(1.0 / (rate * STEP)))
    if hold < 1 or abs(hold * STEP * rate - 1.0) > 1e-6:
        raise BadInput(f"At {rate:g} rows a second no whole number of milliseconds lies between rows; take 50 or 100.")
    return hold


def _forms(forms: str | Forms, rng: np.random.Generator) -> Forms:
    if isinstance(forms, Forms):
        return forms
    if forms not in ("nominal", "other"):
        raise BadInput(f'Forms are "nominal", "other" or chosen one by one, not "{forms}".')
    return NOMINAL if forms == "nominal" else other(rng)


def _streams(seed: int) -> dict[str, np.random.Generator]:
    """Randomness by purpose, so that what one draws does not change the others."""
    return {name: np.random.default_rng((seed, k, 4099)) for k, name in enumerate(_STREAMS)}
