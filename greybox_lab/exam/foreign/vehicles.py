"""Foreign vehicles: random typical numbers of their class, each in the form of its simulator."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import cache
from typing import Any, Protocol

import numpy as np

from greybox_id.base.machine_code import kept

from ...virtual.virtual_vehicle import EFFECTS, VirtualCar, random_vehicle
from ...virtual.virtual_vehicle.driver import DEVIATION, MIND, Driver, decide
from ...virtual.virtual_vehicle.effects import Kind
from ...virtual.virtual_vehicle.layout import FOLLOW, STATES, Grid, Row, source


@dataclass(frozen=True)
class Task:
    """Task of a driver; see `virtual.virtual_vehicle.driver`.

    Attributes
    ----------
    knows : what the driver knows of the vehicle.
    road, spacing, plan : as in `driver.decide`; the plan of a robot contains its commands.
    hold, period : steps of 1 ms between rows, and time between them, s.
    """

    knows: Driver
    road: Grid
    spacing: float
    plan: Grid
    hold: int
    period: float

    @property
    def by_robot(self) -> bool:
        """Whether the plan contains the commands."""
        return bool(self.plan[0, FOLLOW] < 0.0)


class Reality(Protocol):
    """A simulator with a vehicle.

    Attributes
    ----------
    linear_hold : whether commands are linear between rows; otherwise they are held.
    """

    linear_hold: bool

    def carry_out(self, task: Task, start: tuple[float, ...], commands: Grid, out: Any) -> None:
        """Carry out a task from an initial v_x, v_y, yaw_rate, with constant commands before.

        Parameters
        ----------
        commands : (rows, 2) steering and drive, as in a robot's plan; decisions of a driver are written here. Commands
            that are linear between rows are decided one row ahead.
        out : (rows * hold, 2, 8) motion at the beginning and the end of each step, as in `layout.READABLE`.
        """


class Stepwise:
    """A simulator that is called once per row."""

    linear_hold = True
    state: Row

    def begin(self, start: tuple[float, ...], steer: float, drive: float) -> None:
        """Start in motion, with constant commands before."""
        raise NotImplementedError

    def advance(self, commands: Grid, row: int, steps: int, period: float, out: Any) -> None:
        """Simulate one row with its commands; leaves v_x, v_y, yaw_rate, x, y, yaw in `state`."""
        raise NotImplementedError

    def carry_out(self, task: Task, start: tuple[float, ...], commands: Grid, out: Any) -> None:
        """See `Reality`."""
        seen, mind, ahead = np.zeros(STATES), np.zeros(MIND), int(self.linear_hold)
        mind[DEVIATION] = np.nan
        self.begin(start, float(commands[0, 0]), float(commands[0, 1]))
        for row in range(len(commands)):
            if not task.by_robot and row + ahead < len(commands):
                seen[:6] = self.state[:6]
                requested = decider()(task.knows, task.road, task.spacing, task.plan, row, seen, mind, task.period)
                commands[row + ahead] = requested
            self.advance(commands, row, task.hold, task.period, out[row * task.hold : (row + 1) * task.hold])


@cache
def decider() -> Any:
    """The driver in machine code, which is cached."""
    key = source()

    def decided(
        knows: Driver, road: Grid, spacing: float, plan: Grid, row: int, s: Row, mind: Row, period: float
    ) -> tuple[float, float]:
        assert key
        return decide(knows, road, spacing, plan, row, s, mind, period)

    return kept(decided)


@dataclass(frozen=True)
class ForeignVehicle:
    """A vehicle of a foreign simulator.

    Attributes
    ----------
    family : the simulator, see `families`.
    numbers : mass, geometry, tyres, resistance and drive as in `double_track.CHASSIS`, and those of the simulator.
    about : approximately the same vehicle as a single track, for its scale, sensors, driver and drive channel.
    """

    family: str
    numbers: Mapping[str, float]
    about: VirtualCar


Draw = Callable[[np.random.Generator, int], ForeignVehicle]

TRACE = 0.1
"""Largest size of an effect in vehicles without withheld effects, relative to the least magnitude that is withheld: to
name it is wrong at this size."""
KINDS: tuple[Kind, ...] = ("car", "racer", "sports", "truck")


def chassis(car: VirtualCar) -> dict[str, float]:
    """Numbers of `double_track.CHASSIS` for a vehicle: stiffness and friction of its tyres, and others unchanged."""
    p = car.parameters
    result = {name: p[name] for name in ("m", "I_z", "l_f", "l_r", "h_cg", "track_f", "track_r", "c_0", "c_1", "c_2")}
    result |= {name: p[name] for name in ("drive_split_front", "brake_split_front", "force_per_unit", "wheel_radius")}
    for axle in "fr":
        result[f"slope_{axle}"] = p[f"B_{axle}"] * p[f"C_{axle}"] * p[f"D_{axle}"]
        result[f"mu_{axle}"] = p[f"D_{axle}"]
    return result


def drawn_car(rng: np.random.Generator, kind: Kind) -> VirtualCar:
    """A random vehicle of a class, whose name does not reveal its seed."""
    car = random_vehicle(int(rng.integers(2**31)), kind)
    return replace(car, name=car.kind)


def single_track(car: VirtualCar, linear_hold: bool) -> dict[str, float]:
    """The stated vehicle as numbers of `double_track`: no width and no height, tyres by the magic formula."""
    p = car.parameters
    flat = {"h_cg": 0.0, "track_f": 1e-6, "track_r": 1e-6, "tyre": 5.0, "linear_hold": float(linear_hold)}
    return {**chassis(car), **flat, **{f"{name}_{axle}": p[f"{name}_{axle}"] for name in "CE" for axle in "fr"}}


def _trace(effect: str, rng: np.random.Generator) -> float:
    """Size of an effect in every vehicle, whether it is withheld or not."""
    return float(rng.uniform(0.0, TRACE * EFFECTS[effect].low))


def drawn_double_track(tyre: int, family: str) -> Draw:
    """Draws double tracks with tyres of one shape; other forms are random and small relative to withheld effects."""

    def draw(rng: np.random.Generator, number: int) -> ForeignVehicle:
        car = drawn_car(rng, KINDS[number % len(KINDS)])
        size = car.size
        smooth = number // len(KINDS) % 2 == 1  # commands with jumps have no lags, linear ones have small lags
        forms = {
            "linear_hold": float(smooth),
            "tyre": float(tyre),
            "ackermann": float(rng.uniform(0.0, 1.0)),
            "roll_share": float(rng.uniform(0.48, 0.62)),
            "load_exponent": _trace("load_sensitivity", rng),
            "height": _trace("longitudinal_load_transfer", rng),
            "ellipse": _trace("combined_slip", rng),
            "relaxation": smooth * max(float(rng.uniform(0.006, 0.012)) * size.length, 6e-4 * size.top_speed),
            "steer_time": smooth * float(rng.uniform(0.0, 0.002)),
            "drive_time": smooth * float(rng.uniform(0.0, 0.004)),
            "peak_place": float(rng.uniform(2.5, 3.4)),
            "drag_power": float(rng.uniform(1.9, 2.0)),
            "drag_speed": 0.6 * size.top_speed,
        }
        return ForeignVehicle(family, {**chassis(car), **forms}, car)

    return draw


_RIDE = {"car": (1.1, 1.7), "racer": (3.5, 6.0), "sports": (1.8, 2.8), "truck": (1.2, 1.9)}
_HOP = {"car": (10.0, 13.0), "racer": (18.0, 26.0), "sports": (12.0, 16.0), "truck": (9.0, 11.0)}
"""Frequencies of ride and wheel hop by class, Hz (Milliken & Milliken, Race Car Vehicle Dynamics, ch. 16)."""


def drawn_suspended(rng: np.random.Generator, number: int) -> ForeignVehicle:
    """Draws cars with suspension; their inherent effects are as large as on real cars."""
    kind = KINDS[number % len(KINDS)]
    car = drawn_car(rng, kind)
    forms = {
        "ride": float(rng.uniform(*_RIDE[kind])),
        "hop": float(rng.uniform(*_HOP[kind])),
        "damping": float(rng.uniform(0.25, 0.45)),
        "gradient": float(rng.uniform(0.003, 0.008)),
        "roll_share": float(rng.uniform(0.48, 0.62)),
        "roll_centre": float(rng.uniform(0.05, 0.35)),
        "anti_dive": float(rng.uniform(0.0, 0.4)),
        "fall": float(rng.uniform(0.06, 0.16)),
        "past_peak": float(rng.uniform(0.05, 0.15)),
        "unsprung": float(rng.uniform(0.09, 0.15)),
        "deflection": float(rng.uniform(0.03, 0.06)) * car.size.length,
        "bump_steer": float(rng.uniform(-0.02, 0.02)) / car.size.length,
        "linear_hold": 1.0,
    }
    return ForeignVehicle("suspended", {**chassis(car), **forms}, car)


def drawn_slipx(rng: np.random.Generator, number: int) -> ForeignVehicle:
    """Draws a 1:10 car for SlipX, which brakes by its motor and has no drag proportional to speed."""
    car = drawn_car(rng, "racer")
    split = car.parameters["drive_split_front"]
    car = replace(car, parameters={**car.parameters, "brake_split_front": split, "c_1": 0.0})
    forms = {
        "linear_hold": 1.0,
        "shape_c": float(rng.uniform(1.5, 1.75)),
        "curvature_e": float(rng.uniform(0.2, 0.5)),
        "load_exponent": _trace("load_sensitivity", rng),
        "height": _trace("longitudinal_load_transfer", rng),
        "ellipse": _trace("combined_slip", rng),
        "top_speed": car.top_speed,
    }
    return ForeignVehicle("slipx", {**chassis(car), **forms}, car)
