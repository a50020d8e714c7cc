"""What stands where in the arrays the simulator works on."""

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
"""A numpy record with the fields of `record.FIELDS`, which compiled code reads by name."""


def source() -> str:
    """What all files of the simulator are at this moment, as a hash."""
    files = sorted(Path(__file__).parent.glob("*.py"))
    return sha256(b"\0".join(file.read_bytes() for file in files)).hexdigest()


V_X, V_Y, YAW_RATE, X, Y, YAW = 0, 1, 2, 3, 4, 5
LAGGED, HEAT_F, HEAT_R, ROLL, ROLL_RATE, BRAKE_HEAT, SLOSH, SLOSH_RATE = 6, 10, 11, 12, 13, 14, 15, 16
STATES = 17
"""State: motion; what lags behind in the four tyres, from LAGGED on; heat of front and rear tyres; roll; heat of the
brakes; lateral acceleration of what sloshes."""

A_X, A_Y, YAW_ACCELERATION, ROLL_ACCELERATION, F_YF, F_YR, FRICTION = 0, 1, 2, 3, 4, 5, 6
SEEN = 7
"""What is seen of the motion: specific forces, accelerations, lateral forces of axles, friction over that stated."""

LOAD, ALONG, ANGLE, ACROSS, ROLLING = 0, 1, 2, 3, 4
WHEEL = 5
"""What is seen of a wheel: load, longitudinal force, slip angle, lateral force, speed of its centre along it."""

STEER, FORCE, GUST, MASS, TIME = 0, 1, 2, 3, 4
GIVEN = 5
"""What the motion is given: road-wheel angle, driving force, gust across, mass over that stated, time since row one."""

FOLLOW, TURN, SPEED, OPEN_DRIVE = 0, 1, 2, 3
PLAN = 4
"""What a row of a manoeuvre asks of the driver: 1 to follow the road; lateral acceleration to steer for, on top of that
of following; speed, or not a number where the road says it or, off the road, where the drive channel is commanded as it
stands in the last column. Below zero, FOLLOW makes the driver a robot: steering, rad, as it stands in the column
TURN, and drive as it stands in OPEN_DRIVE or, where a speed is asked for, such as keeps it."""

ROAD_X, ROAD_Y, ROAD_YAW, ROAD_CURVATURE, ROAD_SPEED = 0, 1, 2, 3, 4
ROAD = 5
"""What is known of a point of the road."""

READABLE = ("v_x", "v_y", "yaw_rate", "a_x", "a_y", "yaw_acceleration", "roll", "roll_acceleration")
"""What sensors read, at the beginning and the end of every step."""
ROW_TRUTH = (
    *("x", "y", "yaw", "steer", "force", "F_yf", "F_yr", "friction", "deviation", "mass"),
    *(
        f"{what}_{wheel}"
        for what in ("F_z", "F_x", "alpha", "F_y", "wheel_speed")
        for wheel in ("fl", "fr", "rl", "rr")
    ),
)
"""What else is known of every row: pose; road-wheel angle; driving force; lateral forces of axles; friction and mass
over those stated; distance from the line that is followed, not a number where none is; what is known of each wheel."""
