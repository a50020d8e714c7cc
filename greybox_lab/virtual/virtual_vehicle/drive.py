"""Driving of the virtual vehicle: a recording of its sensors with the truth, or step by step."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from math import ceil
from types import MappingProxyType

import numpy as np

from greybox_id.base.errors import BadInput
from greybox_id.datasets.recording import Recording

from .car import VirtualCar
from .driver import Driver, driver
from .effects import ALL, complete
from .layout import OPEN_DRIVE, READABLE, ROAD, ROW_TRUTH, TURN, YAW, Car, Grid, Row, X, Y
from .loop import STEP, first_moment, simulator
from .manoeuvres import closed_road, planned, robot, steering_robot
from .record import NOMINAL, Forms, other, record
from .sensors import Motion, hung, instants, noisy, read

_STREAMS = ("road", "plan", "forms", "when", "sensors", "noise", "drops", "gusts", "wind")


class Simulation:
    """A vehicle that carries out a plan; parameters as in `loop.simulator`.

    Parameters
    ----------
    steps : largest number of steps.
    start : (3,) v_x, v_y, yaw_rate at the first row.

    Attributes
    ----------
    done : number of steps so far.
    state : (STATES,) at present.
    commands, readable, truth : (rows, 2), (steps, 2, k) and (rows, k), as in `loop.simulator`; zero from `done` on.
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
        """Simulate up to step `to`."""
        simulator()(*self._given, self._now, self.done, to, self.commands, self.readable, self.truth)
        self.done = to


@dataclass(frozen=True)
class Truth:
    """The truth about a recording.

    Attributes
    ----------
    car : that was driven.
    effects : magnitudes of all effects that differ from their null, including small ones of the car, and given or drawn
        further parameters of effects.
    forms : mathematical forms.
    states : name -> (n,) just after each row's time: v_x, v_y, yaw_rate, a_x, a_y at the centre of gravity,
        yaw_acceleration, roll, roll_acceleration and `layout.ROW_TRUTH`; SI units.
    readings : name -> (n,) noise-free readings, before repeated ones.
    """

    car: VirtualCar
    effects: Mapping[str, float]
    forms: Forms
    states: Mapping[str, Row]
    readings: Mapping[str, Row]


@dataclass(frozen=True)
class MadeRecording:
    """A vehicle ready for simulation."""

    car: VirtualCar
    effects: Mapping[str, float]
    forms: Forms
    rng: Mapping[str, np.random.Generator]
    hold: int

    def recorded(
        self, name: str, plan: Grid, road: Grid, spacing: float, run_in: int, start: Row,
        spoilt: tuple[float, float, float, float],
    ) -> tuple[Recording, Truth]:  # fmt: skip
        """Carry out a plan and record it; spoilt: noise, colour, outliers, quantisation."""
        car, size = self.car, self.car.size
        ridden = self.simulation(plan, road, spacing, run_in, start)
        ridden.advance(ridden.steps)
        commands, readable, truth = ridden.commands, ridden.readable, ridden.truth
        if not np.all(np.isfinite(readable)):
            raise BadInput(f"{name}: the simulation diverged; the vehicle or its effects are implausibly large.")

        period, rows = self.hold * STEP, len(plan) - run_in
        time = np.asarray(period * np.arange(rows), float)
        motion = Motion(readable, run_in * self.hold)
        when = instants(time, self._complete, self.forms.latency == "jittering", self.rng["when"])
        known = {**car.parameters, "top_speed": size.top_speed}
        clean = read(motion, when, self._complete, known, self.rng["sensors"])
        sd = {signal: spoilt[0] * item for signal, item in car.noise.items()}
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
        value = record(self.car, effects, self.forms)
        return Simulation(value, driver(self.car), road, spacing, plan, run_in, self.hold, steps, start, gusts)

    @cached_property
    def _asked(self) -> dict[str, float]:
        """Effects including small ones; the wind's direction is drawn unless given."""
        requested = combined(self.car.small, self.effects)
        if requested.get("wind_gust", 0.0) != 0.0 and "wind_direction" not in requested:
            requested["wind_direction"] = float(self.rng["wind"].uniform(-np.pi, np.pi))
        return requested

    @cached_property
    def _complete(self) -> dict[str, float]:
        return complete(self._asked, self.car.size)

    def _gusts(self, sd: float, steps: int) -> Row:
        """Crosswind, m/s, with a correlation time of 0.8 s for a full-size car."""
        if sd == 0.0:
            return np.zeros(1)
        coarse = 20
        n, keeps = steps // coarse + 2, np.exp(-coarse * STEP / (0.8 * self.car.size.time))
        shocks, values = self.rng["gusts"].standard_normal(n), np.zeros(n)
        for k in range(1, n):
            values[k] = keeps * values[k - 1] + np.sqrt(1.0 - keeps**2) * shocks[k]
        return np.asarray(sd * np.interp(np.arange(steps) / coarse, np.arange(n), values))


def made(car: VirtualCar, effects: Mapping[str, float], forms: str | Forms, seed: int, rate: float) -> MadeRecording:
    """A vehicle with effects in its forms, with all random numbers from a seed; parameters as in `drive.drive`."""
    hold, rng = _hold(rate), _streams(seed)
    return MadeRecording(car, effects, _forms(forms, rng["forms"]), rng, hold)


def combined(*several: Mapping[str, float]) -> dict[str, float]:
    """Effects acting together: factors are multiplied, offsets added, and of limits the smallest holds."""
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
    """Number of simulation steps between rows."""
    hold = int(round(1.0 / (rate * STEP)))
    if hold < 1 or abs(hold * STEP * rate - 1.0) > 1e-6:
        raise BadInput(
            f"At {rate:g} rows per second the time between rows is not a whole number of milliseconds; use 50 or 100 "
            "rows per second."
        )
    return hold


def _forms(forms: str | Forms, rng: np.random.Generator) -> Forms:
    if isinstance(forms, Forms):
        return forms
    if forms not in ("nominal", "other"):
        raise BadInput(f'Forms are "nominal", "other" or chosen one by one, not "{forms}".')
    return NOMINAL if forms == "nominal" else other(rng)


def _streams(seed: int) -> dict[str, np.random.Generator]:
    """Random generators by purpose, so that draws for one do not change the others."""
    return {name: np.random.default_rng((seed, k, 4099)) for k, name in enumerate(_STREAMS)}


RUN_IN = 3.0
"""Duration of straight driving before the first row, s."""


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

    Row k's commands are applied at its time and held until the next row's; the readings of row k follow just after.

    Parameters
    ----------
    car : the vehicle; its small effects act together with `effects`.
    manoeuvre : one of `manoeuvres.MANOEUVRES`.
    duration : s.
    rate : rows per second; the time between rows must be a whole number of simulation steps of 1 ms.
    effects : magnitudes by name, in or outside the vocabulary, and further parameters of effects; the wind's direction
        is drawn unless given.
    forms : "nominal", as in models; "other", a different one of everything, drawn; or chosen ones.
    seed : of all random numbers.
    noise : sd of the sensors relative to `car.noise`.
    colour : share of the noise's variance that is correlated over 0.08 s.
    outliers : share of readings with errors of 5 to 10 sd.
    quantisation : step of readings relative to their sd.

    Raises
    ------
    BadInput : if an effect, a manoeuvre, a form or the rate is unknown.
    """
    made_recording = made(car, effects, forms, seed, rate)
    size, rows = car.size, max(int(round(duration * rate)), 2)
    run_in = ceil(RUN_IN * rate)
    road, spacing = closed_road(size, float(made_recording.rng["plan"].uniform(0.6, 0.88)), made_recording.rng["road"])
    plan = planned(manoeuvre, size, rows, run_in, rate, float(road[0, 4]), made_recording.rng["plan"])
    start = np.array([plan[0, 2], 0.0, 0.0])
    name = f"{car.name}, {manoeuvre} {seed}"
    return made_recording.recorded(name, plan, road, spacing, run_in, start, (noise, colour, outliers, quantisation))


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
) -> tuple[Recording, Truth]:
    """Simulate a vehicle with the commands of a recording, without a driver.

    Parameters
    ----------
    commands : one run with steer and the car's drive channel, equally spaced.
    start : v_x, v_y [m/s] and yaw_rate [rad/s] at the first row; its commands are assumed constant before.

    Other parameters and errors are as in `drive`.
    """
    made_recording = made(car, effects, forms, seed, 1.0 / commands.sample_time)
    begin = np.array([start.get(name, 0.0) for name in ("v_x", "v_y", "yaw_rate")])
    plan = robot(commands["steer"], commands[car.drive_channel])
    nowhere = np.zeros((8, ROAD))
    return made_recording.recorded(commands.name, plan, nowhere, 1.0, 0, begin, (noise, colour, 0.0, 0.0))


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
    """Let a robot steer as given while a driver keeps a speed, as on a proving ground; straight on before.

    Parameters
    ----------
    name : of the recording.
    steer : (n,) road-wheel angle, rad, of each row.
    speed : (n,) m/s, which the driver keeps as far as possible; the vehicle starts with the first one.

    Other parameters and errors are as in `drive`.
    """
    made_recording = made(car, effects, forms, seed, rate)
    begin = np.array([speed[0], 0.0, 0.0])
    plan = steering_robot(steer, speed)
    return made_recording.recorded(name, plan, np.zeros((8, ROAD)), 1.0, 0, begin, (noise, colour, 0.0, 0.0))


class SteppedCar:
    """A vehicle that is commanded from outside; it starts at x = y = yaw = 0, with zero commands before.

    Parameters
    ----------
    car : the vehicle; its small effects act together with `effects`.
    v_x : initial speed straight ahead, m/s.
    duration : longest time it can be driven, s.
    rate : commands per second; the time between them must be a whole number of simulation steps of 1 ms.
    effects, forms, seed : as in `drive.drive`.

    Raises
    ------
    BadInput : if an effect, a form or the rate is unknown.
    """

    def __init__(
        self,
        car: VirtualCar,
        v_x: float,
        duration: float,
        rate: float = 50.0,
        effects: Mapping[str, float] = MappingProxyType({}),
        forms: str | Forms = "nominal",
        seed: int = 0,
    ) -> None:
        made_recording = made(car, effects, forms, seed, rate)
        nothing = np.zeros(max(int(round(duration * rate)), 1))
        self._hold = made_recording.hold
        start = np.array([v_x, 0.0, 0.0])
        self._simulation = made_recording.simulation(robot(nothing, nothing), np.zeros((8, ROAD)), 1.0, 0, start)

    @property
    def time(self) -> float:
        """Time since the start, s."""
        return self._simulation.done * STEP

    @property
    def motion(self) -> dict[str, float]:
        """True pose and motion: x, y [m], yaw [rad], v_x, v_y [m/s], yaw_rate [rad/s]."""
        s = self._simulation.state
        names = ("v_x", "v_y", "yaw_rate", "x", "y", "yaw")
        return {name: float(s[k]) for name, k in zip(names, (0, 1, 2, X, Y, YAW), strict=True)}

    def step(self, steer: float, drive: float) -> None:
        """Hold a command for a period: steering, rad, and drive, in the unit of the vehicle's channel.

        Raises
        ------
        BadInput : if the duration is over, or the simulation diverged.
        """
        now = self._simulation
        row = now.done // self._hold
        if row >= len(now.plan):
            raise BadInput(f"The drive ended after {self.time:g} s; start it with a longer duration.")
        now.plan[row, TURN], now.plan[row, OPEN_DRIVE] = steer, drive
        now.advance(now.done + self._hold)
        if not np.all(np.isfinite(now.state)):
            raise BadInput(f"The simulation diverged after {self.time:g} s.")

    def truth(self) -> dict[str, Row]:
        """Name -> (rows,) just after each command so far: road-wheel angle, forces, loads and slips, as in `Truth`."""
        rows = self._simulation.done // self._hold
        return {name: self._simulation.truth[:rows, k] for k, name in enumerate(ROW_TRUTH)}
