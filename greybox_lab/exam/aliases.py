"""Effects that a recording cannot distinguish, known beforehand or found by simulating the other cause."""

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
"""Pairs that no recording of these vehicles can distinguish."""
ONE_CAUSE = (("steering_lag", "steering_bandwidth"),)
"""Forms of one cause: a lag of a foreign vehicle is a second-order servo. Readings may distinguish them."""

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
"""Effects that recordings with little excitation may not distinguish."""

_GROUP = {name: group for group, names in GROUPS.items() for name in names}


def group_of(effect: str) -> str:
    """The part that an effect acts on; the effect's name if unknown."""
    return _GROUP.get(effect, effect)


def always_alike(effect: str) -> tuple[str, ...]:
    """Effects that no recording can distinguish from this one, or that are another form of it."""
    return tuple(other for pair in (*ALWAYS_ALIKE, *ONE_CAUSE) if effect in pair for other in pair if other != effect)


def partners(effect: str) -> tuple[str, ...]:
    """Effects that some recordings cannot distinguish from this one."""
    result = [other for some in _CONFUSABLE if effect in some for other in some]
    return tuple(dict.fromkeys(other for other in result if other != effect and other not in always_alike(effect)))


DISTINGUISHABLE = 4.0
"""Least sum of squared differences, in noise variances, with which a recording distinguishes two causes."""
HOPELESS = 400.0
"""Sum of squared differences after the first simulation above which the search for a magnitude is given up."""
STEPS = 3
"""Most simulations in the search for the partner's best magnitude."""


@dataclass(frozen=True)
class View:
    """A recording, or a part of it that may exclude a cause before the whole is simulated.

    Attributes
    ----------
    simulate : effects -> noise-free readings in noise sds; deterministic.
    product : inner product of two changes of readings, without the part that parameters within tolerances can explain.
    threshold : least sum of squared differences, in noise variances, with which it distinguishes two causes.
    """

    simulate: Callable[[Mapping[str, float]], Array]
    product: Callable[[Array, Array], float]
    threshold: float = DISTINGUISHABLE


@dataclass(frozen=True)
class Cause:
    """An effect as a possible cause.

    Attributes
    ----------
    null : magnitude of the absent effect.
    at : deviation from null -> magnitude.
    probe : a deviation with a visible effect.
    sides : "up", "down" or "both": signs of possible deviations.
    """

    null: float
    at: Callable[[float], float]
    probe: float
    sides: str


def indistinguishable(
    present: Mapping[str, float], causes: Mapping[str, Cause], views: Sequence[View], also: Sequence[str] = ()
) -> dict[str, tuple[str, ...]]:
    """Present effect -> effects that explain the recording as well in its place.

    Those of `ALWAYS_ALIKE` and `ONE_CAUSE` are included without a test. For the others, the readings' change is
    projected on the partner's sensitivity, and the partner is simulated at the magnitude that results.

    Parameters
    ----------
    present : magnitudes of the present effects.
    causes : the effects that may take their place, by name.
    views : of the recording; a partner must explain each of them.
    also : partners to try in addition to the usual ones.
    """
    result = {}
    for name in present:
        rest = {other: value for other, value in present.items() if other != name}
        tried = [p for p in dict.fromkeys((*partners(name), *also)) if p in causes and p not in present]
        alike = [
            p for p in tried
            if isfinite(causes[p].null)
            and all(_left(p, causes[p], rest, present, view) < view.threshold for view in views)
        ]  # fmt: skip
        result[name] = (*(p for p in always_alike(name) if p not in present), *alike)
    return result


def _left(partner: str, cause: Cause, rest: Mapping[str, float], present: Mapping[str, float], view: View) -> float:
    """Sum of squared differences that a partner at its best magnitude leaves."""
    without = view.simulate(rest)
    change = view.simulate(present) - without
    all_of_it = view.product(change, change)
    hopeless = max(HOPELESS, 4.0 * view.threshold)
    best, tried = inf, cause.probe if cause.sides != "down" else -cause.probe
    for step in range(STEPS + 1):
        try:
            moved = view.simulate({**rest, partner: cause.at(tried)}) - without
        except BadInput:  # the simulation diverged
            return best
        value, both = view.product(moved, moved), view.product(moved, change)
        if step > 0:
            best = min(best, all_of_it - 2.0 * both + value)
        if best < view.threshold or value <= 0.0 or (step > 1 and best > hopeless):
            break
        if step == 0 and all_of_it - both**2 / value > max(hopeless, 0.2 * all_of_it):
            break
        tried *= both / value
        if (tried < 0 and cause.sides == "up") or (tried > 0 and cause.sides == "down"):
            break
    return best
