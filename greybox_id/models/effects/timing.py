"""Effects on the time at which sensors read, and on time stamps."""

from __future__ import annotations

from ..motion_model import MotionModel
from .memory import LATENCY_PER_RUN, LATEST, delay_imu
from .stating import effect

GROUP = "timing"


def _late_speed(model: MotionModel) -> MotionModel:
    """If speed is an input, the same sensor read it late: the input is advanced."""
    if "v_x" in model.inputs:
        return model.delayed("v_x", lambda p: -p.sensor_latency_vx)
    return model.late(lambda p: p.sensor_latency_vx, "v_x")


def _only_the_recording(model: MotionModel) -> MotionModel:
    """The expected readings are unchanged."""
    return model


sensor_latency_yaw = effect(
    GROUP, "sensor_latency_yaw", "s", 0.0, LATEST, "latency of the yaw rate reading",
    touches=("yaw_rate",), typical=0.03, reads_only=True,
    apply=lambda model: model.late(lambda p: p.sensor_latency_yaw, "yaw_rate"),
)  # fmt: skip

sensor_latency_vx = effect(
    GROUP, "sensor_latency_vx", "s", 0.0, LATEST, "latency of the speed reading",
    touches=("v_x",), apply=_late_speed, typical=0.05, reads_only=True,
)  # fmt: skip

sensor_latency_imu = effect(
    GROUP, "sensor_latency_imu", "s", 0.0, LATEST, "latency of the readings of yaw rate and accelerations",
    touches=("yaw_rate", "a_x", "a_y"), typical=0.03, reads_only=True,
    apply=lambda model: model.late(lambda p: p.sensor_latency_imu, "yaw_rate", "a_x", "a_y"),
    apply_to_memory=delay_imu, memory_parameter=LATENCY_PER_RUN,
)  # fmt: skip

timestamp_jitter = effect(
    GROUP, "timestamp_jitter", "s", 0.0, (0.0, 0.05), "standard deviation of the difference between the time of a "
    "reading and its stamp",
    touches=("v_x", "v_y", "yaw_rate", "a_x", "a_y"), apply=_only_the_recording, typical=0.003, reads_only=True,
)  # fmt: skip
"""Leaves expected readings unchanged and scatters readings by their rate of change times this value. It is recognised
by residuals whose variance grows with the squared rate of the signal, which the diagnosis tests."""

dropped_samples = effect(
    GROUP, "dropped_samples", "1", 0.0, (0.0, 0.9), "share of the rows in which sensors repeat their last reading",
    touches=("v_x", "v_y", "yaw_rate", "a_x", "a_y"), apply=_only_the_recording, typical=0.1, reads_only=True,
)  # fmt: skip
"""A property of the recording, not of the motion. It is recognised by rows that repeat the previous one exactly, which
the diagnosis counts."""

ALL = (sensor_latency_yaw, sensor_latency_vx, sensor_latency_imu, timestamp_jitter, dropped_samples)
