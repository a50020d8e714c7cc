"""Driving the virtual vehicle: a recording of what its sensors read, and the truth beside it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from math import ceil
from types import MappingProxyType

import numpy as np

from ...errors import BadInput
from ...recording import Recording
from .car import VirtualCar
from .compiled import Grid, Row
from .driver import driver
from .effects import ALL, complete
from .forms import NOMINAL, Forms, other
from .layout import READABLE, ROAD, ROW_TRUTH
from .loop import STEP, simulator
from .manoeuvres import planned, robot, steering_robot
from .record import record
from .road import closed_road
from .sensors import Motion, hung, instants, noisy, read

RUN_IN = 3.0
"""Time, s, that a driver drives straight on before the first row."""
_STREAMS = ("road", "plan", "forms", "when", "sensors", "noise", "drops", "gusts", "wind")


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


def drive(
    car: VirtualCar,
    manoeuvre: str = "mixed",
    duration: float = 90.0,
    rate: float = 100.0,
    effects: Mapping[str, float] = MappingProxyType({}),
    forms: str | Forms = "nominal",
    seed: int = 0,
    *,
    noise: float = 1.0,
    colour: float = 0.0,
    outliers: float = 0.0,
    quantisation: float = 0.0,
) -> tuple[Recording, Truth]:
    """Let a driver drive a vehicle, and record it.

    Row k's commands are applied at its time and held until the next row's; row k is read just after.

    Parameters
    ----------
    car : the vehicle; its small effects act together with `effects`.
    manoeuvre : one of `manoeuvres.MANOEUVRES`.
    duration : s.
    rate : rows a second; a whole number of simulation steps of 1 ms lies between rows.
    effects : magnitudes by name, of the vocabulary or outside it, and second parameters; the direction of a wind is
        drawn where it is not given.
    forms : "nominal", those of models; "other", another one of everything, drawn; or chosen ones.
    seed : draws all that is random.
    noise : sd of the sensors over that of `car.noise`.
    colour : share of the noise's variance that is correlated over 0.08 s.
    outliers : share of readings that are off by 5 to 10 sd.
    quantisation : step of readings over their sd.

    Raises
    ------
    BadInput : an effect, a manoeuvre, a form or the rate is not known.
    """
    hold = _hold(rate)
    size, rows = car.size, max(int(round(duration * rate)), 2)
    run_in = ceil(RUN_IN * rate)
    rng = _streams(seed)
    road, spacing = closed_road(size, float(rng["plan"].uniform(0.6, 0.88)), rng["road"])
    plan = planned(manoeuvre, size, rows, run_in, rate, float(road[0, 4]), rng["plan"])
    start = np.array([plan[0, 2], 0.0, 0.0])
    made = _Made(car, effects, _forms(forms, rng["forms"]), rng, hold)
    name = f"{car.name}, {manoeuvre} {seed}"
    return made.recorded(name, plan, road, spacing, run_in, start, (noise, colour, outliers, quantisation))


def replay(
    car: VirtualCar,
    commands: Recording,
    start: Mapping[str, float],
    effects: Mapping[str, float] = MappingProxyType({}),
    forms: str | Forms = "nominal",
    seed: int = 0,
    *,
    noise: float = 0.0,
    colour: float = 0.0,
    outliers: float = 0.0,
    quantisation: float = 0.0,
) -> tuple[Recording, Truth]:
    """Drive a vehicle by commands as they stand in a recording, with no driver.

    Parameters
    ----------
    commands : one run with steer and the drive channel of the car, equally spaced.
    start : v_x, v_y [m/s] and yaw_rate [rad/s] at the first row; its commands were in force for ever before.

    Other parameters, what is raised : as for `drive`.
    """
    hold = _hold(1.0 / commands.sample_time)
    rng = _streams(seed)
    made = _Made(car, effects, _forms(forms, rng["forms"]), rng, hold)
    begin = np.array([start.get(name, 0.0) for name in ("v_x", "v_y", "yaw_rate")])
    plan = robot(commands["steer"], commands[car.drive_channel])
    nowhere = np.zeros((8, ROAD))
    return made.recorded(commands.name, plan, nowhere, 1.0, 0, begin, (noise, colour, outliers, quantisation))


def steered(
    car: VirtualCar,
    name: str,
    steer: Row,
    speed: Row,
    rate: float = 100.0,
    effects: Mapping[str, float] = MappingProxyType({}),
    forms: str | Forms = "nominal",
    seed: int = 0,
    *,
    noise: float = 1.0,
    colour: float = 0.0,
) -> tuple[Recording, Truth]:
    """Let a robot steer as told while a driver keeps a speed, as on a proving ground; straight on before.

    Parameters
    ----------
    name : of the recording.
    steer : (n,) road-wheel angle, rad, of every row.
    speed : (n,) m/s, that the driver keeps as well as the vehicle lets him; it starts at the first one.

    Other parameters, what is raised : as for `drive`.
    """
    hold = _hold(rate)
    rng = _streams(seed)
    made = _Made(car, effects, _forms(forms, rng["forms"]), rng, hold)
    begin = np.array([speed[0], 0.0, 0.0])
    plan = steering_robot(steer, speed)
    return made.recorded(name, plan, np.zeros((8, ROAD)), 1.0, 0, begin, (noise, colour, 0.0, 0.0))


@dataclass(frozen=True)
class _Made:
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
        asked = combined(car.small, self.effects)
        if asked.get("wind_gust", 0.0) != 0.0 and "wind_direction" not in asked:
            asked["wind_direction"] = float(self.rng["wind"].uniform(-np.pi, np.pi))
        all_effects = complete(asked, size)
        period, rows = self.hold * STEP, len(plan) - run_in
        steps = len(plan) * self.hold + ceil(8.0 * all_effects["timestamp_jitter"] / STEP) + 1
        commands, readable, truth = simulator()(
            record(car, all_effects, self.forms), driver(car), road, spacing, plan, run_in, self.hold, steps, start,
            self._gusts(all_effects["side_gusts"], steps),
        )  # fmt: skip
        if not np.all(np.isfinite(readable)):
            raise BadInput(f"{name}: the simulated motion blew up; the vehicle or its effects are beyond all bounds.")

        time = np.asarray(period * np.arange(rows), float)
        motion = Motion(readable, run_in * self.hold)
        when = instants(time, all_effects, self.forms.latency == "jittering", self.rng["when"])
        known = {**car.parameters, "top_speed": size.top_speed}
        clean = read(motion, when, all_effects, known, self.rng["sensors"])
        sd = {signal: spoilt[0] * own for signal, own in car.noise.items()}
        read_ones = noisy(clean, sd, period, *spoilt[1:], self.rng["noise"])
        read_ones = hung(read_ones, time, all_effects, self.rng["drops"])

        signals = {**read_ones, "steer": commands[run_in:, 0], car.drive_channel: commands[run_in:, 1]}
        now = readable[run_in * self.hold : len(plan) * self.hold : self.hold, 0]
        states = {signal: now[:, k] for k, signal in enumerate(READABLE)}
        states |= {signal: truth[run_in:, k] for k, signal in enumerate(ROW_TRUTH)}
        there = {key: value for key, value in asked.items() if key not in ALL or value != ALL[key].null}
        return Recording(name, time, signals), Truth(car, there, self.forms, states, clean)

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
