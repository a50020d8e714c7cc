"""Driving the virtual vehicle: a recording of what its sensors read, and the truth beside it."""

from __future__ import annotations

from collections.abc import Mapping
from math import ceil
from types import MappingProxyType

import numpy as np

from ...recording import Recording
from .car import VirtualCar
from .compiled import Row
from .forms import Forms
from .layout import ROAD
from .made import Truth, made
from .manoeuvres import planned, robot, steering_robot
from .road import closed_road

RUN_IN = 3.0
"""Time, s, that a driver drives straight on before the first row."""


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
    own = made(car, effects, forms, seed, rate)
    size, rows = car.size, max(int(round(duration * rate)), 2)
    run_in = ceil(RUN_IN * rate)
    road, spacing = closed_road(size, float(own.rng["plan"].uniform(0.6, 0.88)), own.rng["road"])
    plan = planned(manoeuvre, size, rows, run_in, rate, float(road[0, 4]), own.rng["plan"])
    start = np.array([plan[0, 2], 0.0, 0.0])
    name = f"{car.name}, {manoeuvre} {seed}"
    return own.recorded(name, plan, road, spacing, run_in, start, (noise, colour, outliers, quantisation))


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
    own = made(car, effects, forms, seed, 1.0 / commands.sample_time)
    begin = np.array([start.get(name, 0.0) for name in ("v_x", "v_y", "yaw_rate")])
    plan = robot(commands["steer"], commands[car.drive_channel])
    nowhere = np.zeros((8, ROAD))
    return own.recorded(commands.name, plan, nowhere, 1.0, 0, begin, (noise, colour, outliers, quantisation))


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
    own = made(car, effects, forms, seed, rate)
    begin = np.array([speed[0], 0.0, 0.0])
    plan = steering_robot(steer, speed)
    return own.recorded(name, plan, np.zeros((8, ROAD)), 1.0, 0, begin, (noise, colour, 0.0, 0.0))
