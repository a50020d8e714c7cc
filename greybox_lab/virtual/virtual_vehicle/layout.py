"""Indices into the arrays of the simulator."""

from __future__ import annotations

from hashlib import sha256
from pathlib import Path
from typing import Any, TypeAlias

from numpy import dtype, float64, ndarray

Row = ndarray[tuple[int], dtype[float64]]
"""(n,) numbers."""
Grid = ndarray[tuple[int, int], dtype[float64]]
"""(n, k) numbers."""

Car: TypeAlias = Any
"""A numpy record with the fields of `record.FIELDS`, which compiled code accesses by name."""


def source() -> str:
    """A hash of all files of the simulator in their present version."""
    files = sorted(Path(__file__).parent.glob("*.py"))
    return sha256(b"\0".join(file.read_bytes() for file in files)).hexdigest()


V_X, V_Y, YAW_RATE, X, Y, YAW = 0, 1, 2, 3, 4, 5
LAGGED, HEAT_F, HEAT_R, ROLL, ROLL_RATE, BRAKE_HEAT, SLOSH, SLOSH_RATE = 6, 10, 11, 12, 13, 14, 15, 16
STATES = 17
"""State: motion; relaxed slip or force of the four tyres, from LAGGED on; heat of front and rear tyres; roll; heat of
the brakes; lateral acceleration of the sloshing load and its rate."""

A_X, A_Y, YAW_ACCELERATION, ROLL_ACCELERATION, F_YF, F_YR, FRICTION = 0, 1, 2, 3, 4, 5, 6
SEEN = 7
"""Observed motion: specific forces, accelerations, lateral forces of the axles, friction relative to the stated one."""

LOAD, ALONG, ANGLE, ACROSS, ROLLING = 0, 1, 2, 3, 4
WHEEL = 5
"""Observed at a wheel: load, longitudinal force, slip angle, lateral force, speed of its centre in its direction."""

STEER, FORCE, GUST, MASS, TIME = 0, 1, 2, 3, 4
GIVEN = 5
"""Inputs of the motion: road-wheel angle, driving force, crosswind, mass relative to the stated one, time since row
one."""

FOLLOW, TURN, SPEED, OPEN_DRIVE = 0, 1, 2, 3
PLAN = 4
"""A row of a manoeuvre: FOLLOW is 1 if the driver follows the road; TURN is the lateral acceleration to steer for, in
addition to following; SPEED is the speed, or NaN if the road determines it or, off the road, OPEN_DRIVE is the command
of the drive channel. If FOLLOW is negative, a robot steers by the angle in TURN, rad, with the drive command in
OPEN_DRIVE or, if SPEED is given, one that keeps it."""

ROAD_X, ROAD_Y, ROAD_YAW, ROAD_CURVATURE, ROAD_SPEED = 0, 1, 2, 3, 4
ROAD = 5
"""Data of a point of the road."""

READABLE = ("v_x", "v_y", "yaw_rate", "a_x", "a_y", "yaw_acceleration", "roll", "roll_acceleration")
"""Quantities that sensors read, at the beginning and the end of every step."""
ROW_TRUTH = (
    *("x", "y", "yaw", "steer", "force", "F_yf", "F_yr", "friction", "deviation", "mass"),
    *(
        f"{what}_{wheel}"
        for what in ("F_z", "F_x", "alpha", "F_y", "wheel_speed")
        for wheel in ("fl", "fr", "rl", "rr")
    ),
)
"""Further true quantities of each row: pose; road-wheel angle; driving force; lateral forces of the axles; friction and
mass relative to the stated ones; distance from the followed line, NaN if there is none; quantities of each wheel."""
