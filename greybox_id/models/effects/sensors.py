"""Effects on sensor readings: biases, gains, and mounting position and angle."""

from __future__ import annotations

import casadi as cs

from ..model import Namespace, Symbol
from ..motion_model import MotionModel, Quantities
from ..single_track import G
from .stating import effect, reading, speed

GROUP = "sensors"


def _wheel_speed(model: MotionModel) -> MotionModel:
    """If speed is an input, the same sensor read it: the true speed is the input over the gain."""
    if "v_x" in model.inputs:
        return model.altered(v_x=lambda v_x, q: v_x / q.p.wheel_speed_scale)
    return model.sensed(lambda read, q: {"v_x": read.v_x * q.p.wheel_speed_scale})


def _turned(read: Namespace, q: Quantities) -> tuple[Symbol, Symbol]:
    """Accelerations along the axes of a sensor that is rotated to the left."""
    c, s = cs.cos(q.p.imu_mount_yaw), cs.sin(q.p.imu_mount_yaw)
    return c * read.a_x + s * read.a_y, c * read.a_y - s * read.a_x


yaw_rate_bias = reading(
    GROUP, "yaw_rate_bias", "rad/s", 0.0, (-0.2, 0.2), "offset of the yaw rate reading",
    typical=0.02, yaw_rate=lambda read, q: read.yaw_rate + q.p.yaw_rate_bias,
)  # fmt: skip

yaw_rate_scale = reading(
    GROUP, "yaw_rate_scale", "1", 1.0, (0.5, 2.0), "gain on the yaw rate",
    typical=1.05, yaw_rate=lambda read, q: read.yaw_rate * q.p.yaw_rate_scale,
)  # fmt: skip

accel_bias_x = reading(
    GROUP, "accel_bias_x", "m/s^2", 0.0, (-3.0, 3.0), "offset of the longitudinal acceleration reading",
    typical=0.3, a_x=lambda read, q: read.a_x + q.p.accel_bias_x,
)  # fmt: skip

accel_bias_y = reading(
    GROUP, "accel_bias_y", "m/s^2", 0.0, (-3.0, 3.0), "offset of the lateral acceleration reading",
    typical=0.3, a_y=lambda read, q: read.a_y + q.p.accel_bias_y,
)  # fmt: skip

imu_mount_pitch = reading(
    GROUP, "imu_mount_pitch", "rad", 0.0, (-0.3, 0.3), "pitch of the accelerometer, which adds -g sin(pitch) to a_x",
    typical=0.03, a_x=lambda read, q: read.a_x - G * cs.sin(q.p.imu_mount_pitch),
)  # fmt: skip

imu_mount_roll = reading(
    GROUP, "imu_mount_roll", "rad", 0.0, (-0.3, 0.3), "roll of the accelerometer, which adds g sin(roll) to a_y",
    typical=0.03, a_y=lambda read, q: read.a_y + G * cs.sin(q.p.imu_mount_roll),
)  # fmt: skip

imu_mount_yaw = reading(
    GROUP, "imu_mount_yaw", "rad", 0.0, (-1.6, 1.6), "angle by which the accelerometer is turned to the left",
    typical=0.1, needs=("a_x", "a_y"),
    a_x=lambda read, q: _turned(read, q)[0],
    a_y=lambda read, q: _turned(read, q)[1],
)  # fmt: skip

imu_lever_arm = reading(
    GROUP, "imu_lever_arm", "m", 0.0, (-3.0, 3.0), "distance of the accelerometer ahead of the centre of gravity",
    typical=0.3, needs=("yaw_rate",),
    a_x=lambda read, q: read.a_x - q.x.yaw_rate**2 * q.p.imu_lever_arm,
    a_y=lambda read, q: read.a_y + q.rates.yaw_rate * q.p.imu_lever_arm,
)  # fmt: skip

velocity_lever_arm = reading(
    GROUP, "velocity_lever_arm", "m", 0.0, (-8.0, 8.0), "distance of the point where v_y is measured ahead of the "
                                                        "centre of gravity",
    typical=0.5, needs=("yaw_rate",), v_y=lambda read, q: read.v_y + q.x.yaw_rate * q.p.velocity_lever_arm,
)  # fmt: skip

# by name only: on recordings with v_y, tyres that differ between left and right mimic it
velocity_mount_yaw = reading(
    GROUP, "velocity_mount_yaw", "rad", 0.0, (-0.3, 0.3), "angle by which the sensor of v_y is turned to the left",
    typical=0.02, needs=("v_x",), by_name=True,
    v_y=lambda read, q: cs.cos(q.p.velocity_mount_yaw) * read.v_y - cs.sin(q.p.velocity_mount_yaw) * speed(q),
)  # fmt: skip

wheel_speed_scale = effect(
    GROUP, "wheel_speed_scale", "1", 1.0, (0.5, 2.0), "gain of the speed reading, as from a wrong wheel radius",
    touches=("v_x",), apply=_wheel_speed, typical=1.05, reads_only=True,
)  # fmt: skip

ALL = (
    yaw_rate_bias, yaw_rate_scale, accel_bias_x, accel_bias_y, imu_mount_pitch, imu_mount_roll, imu_mount_yaw,
    imu_lever_arm, velocity_lever_arm, velocity_mount_yaw, wheel_speed_scale,
)  # fmt: skip
