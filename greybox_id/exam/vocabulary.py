"""What an examiner knows of the effects: what they act on, and which of them one recording may not tell apart."""

from __future__ import annotations

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
    """Effects that no recording tells from this one."""
    return tuple(other for pair in ALWAYS_ALIKE if effect in pair for other in pair if other != effect)


def partners(effect: str) -> tuple[str, ...]:
    """Effects that some recordings do not tell from this one."""
    found = [other for some in _CONFUSABLE if effect in some for other in some]
    return tuple(dict.fromkeys(other for other in found if other != effect and other not in always_alike(effect)))
