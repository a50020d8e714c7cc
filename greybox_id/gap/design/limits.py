"""Limits of a manoeuvre: actuators, friction, sideslip, speed."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from math import sqrt
from pathlib import Path

import numpy as np

from ...base.errors import BadInput, near_or_all
from ...base.toml_file import read_toml
from ...models.motion_model import MotionModel
from ...models.single_track import G

CAR = 2.76
"""Wheelbase, m, of the full-size car to which times are scaled (Froude: root of the length)."""
STEER_MAX = 0.45
"""Largest angle of road wheels, rad, unless stated: stops of steerings are at 0.4 to 0.65."""
STEER_RATE = 0.7
"""Fastest steering of a full-size car at the road wheels, rad/s: 650 deg/s at a wheel of ratio 16, as test drivers
reach in a double lane change (ISO 3888)."""
DRIVE, BRAKE = 0.3, 0.5
"""Largest accelerations, of gravity, unless stated; both less than half of what tyres give."""
HALF_WIDTH = 0.5
"""Half a vehicle's width over its track, mirrors left out; a tenth of it is added as margin."""


@dataclass(frozen=True)
class DriveLimits:
    """Limits of a manoeuvre, SI units.

    Attributes
    ----------
    steer_max, steer_rate : of the road wheels, rad and rad/s.
    drive_max, brake_max : largest planned accelerations, m/s^2.
    speed_min, speed_max : m/s, of the plan.
    grip : largest share of an axle's friction that is used.
    sideslip_max : rad, at the centre of gravity.
    margin : m, from the path of the centre of gravity to the arena's edge: half the vehicle's width and a tenth of it.
    """

    steer_max: float
    steer_rate: float
    drive_max: float
    brake_max: float
    speed_min: float
    speed_max: float
    grip: float = 0.85
    sideslip_max: float = 0.2
    margin: float = 1.0


RANGE: Mapping[str, tuple[float, float]] = {
    "steer_max": (0.005, 1.5), "steer_rate": (0.01, 50.0), "drive_max": (0.05, 50.0), "brake_max": (0.05, 50.0),
    "speed_min": (0.1, 100.0), "speed_max": (0.2, 120.0), "grip": (0.05, 1.0), "sideslip_max": (0.005, 1.0),
    "margin": (0.0, 100.0),
}  # fmt: skip
"""Least and greatest value that a limit may have."""


def number(model: MotionModel, name: str, otherwise: float) -> float:
    """A number of the model, by name."""
    return float(model[name].array) if name in model and model[name].shape == () else otherwise


def usual_limits(model: MotionModel, room: tuple[float, float]) -> DriveLimits:
    """Limits of a vehicle of this size unless others are stated.

    Parameters
    ----------
    room : length of the arena, and the diameter of the largest circle in it, m.
    """
    L = number(model, "l_f", 1.3) + number(model, "l_r", 1.46)
    pace = sqrt(L / CAR)
    friction = min(number(model, "D_f", 0.9), number(model, "D_r", 0.9))
    track = max(number(model, "track_f", 0.56 * L), number(model, "track_r", 0.56 * L))
    turning = sqrt(0.8 * friction * G * max(0.5 * room[1], L))
    braking = sqrt(2.0 * room[0] / (1.0 / (DRIVE * G) + 1.0 / (BRAKE * G)))
    slowest = 3.0 * sqrt(L / CAR)
    return DriveLimits(
        steer_max=STEER_MAX,
        steer_rate=STEER_RATE / pace,
        drive_max=DRIVE * G,
        brake_max=BRAKE * G,
        speed_min=slowest,
        speed_max=max(min(max(turning, 0.8 * braking), 45.0 * pace), 1.5 * slowest),
        margin=1.1 * HALF_WIDTH * track,
    )


def stated(limits: DriveLimits, more: Mapping[str, object], where: str) -> DriveLimits:
    """Limits with some of them stated. Raises `BadInput` where one is unknown or no number that can be meant."""
    result: dict[str, float] = {}
    for name, value in more.items():
        if name not in RANGE:
            raise BadInput(f"{where}: there is no limit {name!r:.40}.{near_or_all(name, RANGE)}")
        low, high = RANGE[name]
        if isinstance(value, bool) or not isinstance(value, int | float) or not low <= value <= high:
            raise BadInput(f"{where}: {name} must be a number between {low:g} and {high:g}, not {value!r:.40}.")
        result[name] = float(value)
    new = replace(limits, **result)
    if "speed_min" not in result and new.speed_min >= new.speed_max:
        new = replace(new, speed_min=0.5 * new.speed_max)
    if "speed_max" not in result and new.speed_min >= new.speed_max:
        new = replace(new, speed_max=2.0 * new.speed_min)
    return new


def must_agree(limits: DriveLimits) -> DriveLimits:
    """The limits, if a manoeuvre within them is possible. Raises `BadInput` where they contradict each other."""
    if limits.speed_min >= limits.speed_max:
        raise BadInput(
            f"The limits contradict each other: speed_min = {limits.speed_min:g} m/s is not below "
            f"speed_max = {limits.speed_max:g} m/s. Raise one (‹speed_max›) or lower the other (‹limits›)."
        )
    return limits


def read_limits(path: str | Path) -> dict[str, object]:
    """Limits from a TOML file. Raises `BadInput` where it cannot be read, or is no such file."""
    result = read_toml(path, "file of limits")
    for name, value in result.items():
        if isinstance(value, float) and not np.isfinite(value):
            raise BadInput(f"‹limits› {path}: {name} is not finite.")
    return result
