"""A foreign vehicle driven, and what sensors make of its motion."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from math import ceil

import numpy as np
from numpy.typing import NDArray

from greybox_id.base.errors import BadInput
from greybox_id.datasets.recording import Recording

from ...virtual.virtual_vehicle import VirtualCar
from ...virtual.virtual_vehicle.driver import driver
from ...virtual.virtual_vehicle.effects import OF_THE_SENSORS, complete
from ...virtual.virtual_vehicle.layout import OPEN_DRIVE, READABLE, ROAD, TURN, Grid, Row
from ...virtual.virtual_vehicle.loop import STEP
from ...virtual.virtual_vehicle.manoeuvres import closed_road, planned, robot
from ...virtual.virtual_vehicle.sensors import Motion, hung, instants, noisy, read
from .vehicles import Reality, Task

RUN_IN = 3.0
"""Time, s, that a driver drives straight on before the first row."""
MOST = 1e3
"""Speeds and rates beyond this are no motion of a vehicle."""


@dataclass(frozen=True)
class Ride:
    """A vehicle's motion under commands.

    Attributes
    ----------
    commands : (rows, 2) steering, rad, and drive, in the unit of its channel.
    motion : as sensors could read it, from the first row on.
    period : between rows, s.
    linear_hold : whether commands run straight from row to row; else they are held.
    """

    commands: Grid
    motion: Motion
    period: float
    linear_hold: bool

    def arriving(self, column: int, share: float) -> Row:
        """A command, that share of a period after each row, (rows,); simulators take it in the middle of a step."""
        here = self.commands[:, column]
        after = np.append(here[1:], here[-1])
        share = share + 0.5 * STEP / self.period
        return np.asarray(here + share * (after - here) if self.linear_hold else here)

    @property
    def start(self) -> dict[str, float]:
        """v_x, v_y, yaw_rate at the first row."""
        first = self.motion.readable[self.motion.first, 0]
        return dict(zip(("v_x", "v_y", "yaw_rate"), map(float, first[:3]), strict=True))

    def truth(self, after: float = 0.0) -> dict[str, Row]:
        """What was readable so many seconds after each row's commands, by name of `layout.READABLE`."""
        hold, first = round(self.period / STEP), self.motion.first + round(after / STEP)
        now = self.motion.readable[first : first + len(self.commands) * hold : hold, 0]
        return {name: now[:, k] for k, name in enumerate(READABLE)}


def driven(reality: Reality, car: VirtualCar, seconds: float, rate: float, seed: int, manoeuvre: str = "mixed") -> Ride:
    """A driver, who knows the vehicle as a single track, drives a reality.

    Raises
    ------
    BadInput : the motion blew up.
    """
    plans, roads = np.random.default_rng((seed, 1, 4099)), np.random.default_rng((seed, 0, 4099))
    size, rows, run_in = car.size, max(int(round(seconds * rate)), 2), ceil(RUN_IN * rate)
    road, spacing = closed_road(size, float(plans.uniform(0.6, 0.88)), roads)
    plan = planned(manoeuvre, size, rows, run_in, rate, float(road[0, 4]), plans)
    return _carried_out(reality, car, plan, road, spacing, run_in, (float(plan[0, 2]), 0.0, 0.0), 1.0 / rate)


def replayed(reality: Reality, car: VirtualCar, commands: Grid, period: float, start: Mapping[str, float]) -> Ride:
    """The same commands once more, with no driver; those of the first row were in force for ever before."""
    begin = tuple(start[name] for name in ("v_x", "v_y", "yaw_rate"))
    plan = robot(commands[:, 0], commands[:, 1])
    return _carried_out(reality, car, plan, np.zeros((8, ROAD)), 1.0, 0, begin, period)


def _carried_out(
    reality: Reality, car: VirtualCar, plan: Grid, road: Grid, spacing: float, run_in: int,
    start: tuple[float, ...], period: float,
) -> Ride:  # fmt: skip
    hold, rows = round(period / STEP), len(plan)
    task = Task(driver(car), road, spacing, plan, hold, period)
    commands = np.array(plan[:, [TURN, OPEN_DRIVE]]) if task.by_robot else np.zeros((rows, 2))
    readable: NDArray[np.float64] = np.zeros(((rows + 1) * hold, 2, len(READABLE)))
    reality.carry_out(task, start, commands, readable[: rows * hold])
    if not np.all(np.abs(readable[:, :, :3]) < MOST):
        raise BadInput("The simulated motion blew up; the vehicle or its effects are beyond all bounds.")
    readable[rows * hold :] = readable[rows * hold - 1, 1]
    return Ride(commands[run_in:], Motion(readable, run_in * hold), period, reality.linear_hold)


def readings(ride: Ride, car: VirtualCar, effects: Mapping[str, float], seed: int) -> dict[str, Row]:
    """What sensors read without noise, name -> (rows,)."""
    return hung(_clean(ride, car, effects, seed), _time(ride), _all(car, effects), _rng(seed, 6))


def recorded(ride: Ride, car: VirtualCar, effects: Mapping[str, float], seed: int, name: str) -> Recording:
    """A recording with the noise that is stated; where sensors hang, they repeat their noise as well."""
    seen = noisy(_clean(ride, car, effects, seed), car.noise, ride.period, 0.0, 0.0, 0.0, _rng(seed, 5))
    signals = hung(seen, _time(ride), _all(car, effects), _rng(seed, 6))
    signals |= {"steer": ride.commands[:, 0], car.drive_channel: ride.commands[:, 1]}
    return Recording(name, _time(ride), signals)


def _clean(ride: Ride, car: VirtualCar, effects: Mapping[str, float], seed: int) -> dict[str, Row]:
    """Readings without noise, and before any of them hangs."""
    everything, known = _all(car, effects), {**car.parameters, "top_speed": car.size.top_speed}
    when = instants(_time(ride), everything, False, _rng(seed, 3))
    return read(ride.motion, when, everything, known, _rng(seed, 4))


def _all(car: VirtualCar, effects: Mapping[str, float]) -> dict[str, float]:
    """Magnitudes of all that sensors may have."""
    return complete({name: effect for name, effect in effects.items() if name in OF_THE_SENSORS}, car.size)


def _time(ride: Ride) -> Row:
    return np.linspace(0.0, ride.period * (len(ride.commands) - 1), len(ride.commands), dtype=np.float64)


def _rng(seed: int, stream: int) -> np.random.Generator:
    """Randomness by purpose, so that what one draws does not change the others."""
    return np.random.default_rng((seed, stream, 4099))
