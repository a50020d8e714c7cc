"""What a recording cannot tell apart, known beforehand or found by simulating the other cause under its commands."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from math import inf, isfinite

from greybox_id.base.errors import BadInput
from greybox_id.base.shorthands import Array

GROUPS: dict[str, tuple[str, ...]] = {
    "tyres": (
        *("grip_scale", "front_stiffness", "rear_stiffness", "tyre_relaxation", "combined_slip", "tyre_temperature"),
        *("load_sensitivity", "longitudinal_load_transfer", "downforce"),
    ),
    "body": ("mass_change", "cog_shift", "yaw_inertia", "roll_dynamics"),
    "steering": (
        *("steering_delay", "steering_lag", "steering_rate_limit", "steering_offset", "steering_ratio"),
        "steering_backlash",
    ),
    "drive": ("motor_lag", "motor_saturation", "motor_gain", "brake_bias"),
    "surroundings": ("aero_drag", "rolling_resistance", "road_slope", "road_bank", "wind_gust"),
    "sensors": (
        *("yaw_rate_bias", "yaw_rate_scale", "accel_bias_x", "accel_bias_y", "imu_mount_pitch", "imu_mount_roll"),
        *("imu_mount_yaw", "imu_lever_arm", "velocity_lever_arm", "wheel_speed_scale", "sensor_latency_yaw"),
        *("sensor_latency_vx", "sensor_latency_imu", "timestamp_jitter", "dropped_samples"),
    ),
}

ALWAYS_ALIKE = (("imu_mount_pitch", "accel_bias_x"), ("imu_mount_roll", "accel_bias_y"))
"""Nothing that these vehicles record tells one from the other."""
ONE_CAUSE = (("steering_lag", "steering_bandwidth"),)
"""A lag of a foreign vehicle is a servo of second order: forms of one cause, which readings may tell apart."""

_CONFUSABLE = (
    ("steering_delay", "steering_lag", "steering_rate_limit", "tyre_relaxation", "yaw_inertia"),
    ("steering_delay", "steering_lag", "sensor_latency_yaw", "sensor_latency_imu"),
    ("sensor_latency_vx", "motor_lag"),
    ("mass_change", "motor_gain", "yaw_inertia", "cog_shift"),
    ("mass_change", "grip_scale", "front_stiffness", "rear_stiffness"),
    ("grip_scale", "load_sensitivity", "downforce", "tyre_temperature", "combined_slip"),
    ("combined_slip", "longitudinal_load_transfer", "brake_bias"),
    ("road_slope", "rolling_resistance", "wind_gust", "accel_bias_x", "imu_mount_pitch"),
    ("aero_drag", "wind_gust", "rolling_resistance", "motor_gain", "motor_saturation"),
    ("front_stiffness", "rear_stiffness", "cog_shift", "steering_ratio"),
    ("yaw_rate_scale", "steering_ratio", "wheel_speed_scale"),
    ("yaw_rate_bias", "steering_offset", "road_bank", "accel_bias_y", "imu_mount_roll"),
    ("imu_lever_arm", "imu_mount_yaw", "velocity_lever_arm", "roll_dynamics"),
)
"""Effects that recordings with little excitation may not tell apart."""

_GROUP = {name: group for group, names in GROUPS.items() for name in names}


def group_of(effect: str) -> str:
    """What an effect acts on; its own name where that is not known."""
    return _GROUP.get(effect, effect)


def always_alike(effect: str) -> tuple[str, ...]:
    """Effects that no recording tells from this one, or that are another form of it."""
    return tuple(other for pair in (*ALWAYS_ALIKE, *ONE_CAUSE) if effect in pair for other in pair if other != effect)


def partners(effect: str) -> tuple[str, ...]:
    """Effects that some recordings do not tell from this one."""
    result = [other for some in _CONFUSABLE if effect in some for other in some]
    return tuple(dict.fromkeys(other for other in result if other != effect and other not in always_alike(effect)))


TELLS = 4.0
"""Squared differences, in noise variances, from which on a recording tells two causes apart."""
HOPELESS = 400.0
"""What a first look leaves above this, no better magnitude brings below `TELLS`."""
STEPS = 3
"""Simulations in search of the partner's best magnitude."""


@dataclass(frozen=True)
class View:
    """A recording, or a part of it that may rule a cause out before all of it is looked at.

    Attributes
    ----------
    simulate : effects -> noise-free readings in noise sds; deterministic.
    product : inner product of two changes of readings; what tolerances would take up does not count.
    tells : squared differences, in noise variances, from which on it tells two causes apart.
    """

    simulate: Callable[[Mapping[str, float]], Array]
    product: Callable[[Array, Array], float]
    tells: float = TELLS


@dataclass(frozen=True)
class Cause:
    """An effect as a possible cause.

    Attributes
    ----------
    null : its magnitude where it is not there.
    at : deviation from null -> magnitude.
    probe : a deviation that shows.
    sides : "up", "down" or "both": deviations it may have.
    """

    null: float
    at: Callable[[float], float]
    probe: float
    sides: str


def indistinguishable(
    present: Mapping[str, float], causes: Mapping[str, Cause], views: Sequence[View], also: Sequence[str] = ()
) -> dict[str, tuple[str, ...]]:
    """Effect that is there -> effects that explain the recording as well, in its place.

    Those of `vocabulary.ALWAYS_ALIKE` are named without a look. For the others the readings' change is projected on
    the partner's sensitivity, and the partner simulated where that puts it.

    Parameters
    ----------
    present : magnitudes of what is there.
    causes : the effects that may take its place, by name.
    views : of the recording; a partner must explain each of them.
    also : partners to try besides the usual ones.
    """
    result = {}
    for name in present:
        rest = {other: value for other, value in present.items() if other != name}
        tried = [p for p in dict.fromkeys((*partners(name), *also)) if p in causes and p not in present]
        alike = [
            p for p in tried
            if isfinite(causes[p].null) and all(_left(p, causes[p], rest, present, view) < view.tells for view in views)
        ]  # fmt: skip
        result[name] = (*(p for p in always_alike(name) if p not in present), *alike)
    return result


def _left(partner: str, cause: Cause, rest: Mapping[str, float], present: Mapping[str, float], view: View) -> float:
    """Squared differences that a partner at its best magnitude leaves."""
    without = view.simulate(rest)
    change = view.simulate(present) - without
    all_of_it = view.product(change, change)
    hopeless = max(HOPELESS, 4.0 * view.tells)
    best, tried = inf, cause.probe if cause.sides != "down" else -cause.probe
    for step in range(STEPS + 1):
        try:
            moved = view.simulate({**rest, partner: cause.at(tried)}) - without
        except BadInput:  # the motion blew up
            return best
        value, both = view.product(moved, moved), view.product(moved, change)
        if step > 0:
            best = min(best, all_of_it - 2.0 * both + value)
        if best < view.tells or value <= 0.0 or (step > 1 and best > hopeless):
            break
        if step == 0 and all_of_it - both**2 / value > max(hopeless, 0.2 * all_of_it):
            break
        tried *= both / value
        if (tried < 0 and cause.sides == "up") or (tried > 0 and cause.sides == "down"):
            break
    return best
