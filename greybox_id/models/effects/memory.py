"""Effects on models with memory, whose time is discrete."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from math import ceil

import casadi as cs

from ..memory_model import MemoryModel, SampledActuator, SampledSensor
from ..model import Namespace, Symbol
from ..parameter import Parameter, Prior

LATEST = (0.0, 0.5)
"""Bounds of a latency, s."""

LATENCY_PER_RUN = Parameter(
    "sensor_latency_imu", "s", 0.0, LATEST, Prior(0.03, mean=0.04), scope="run",
    about="delay of the time stamps of yaw rate and accelerations after those of commands, per run",
)  # fmt: skip


def limit_steering_rate(model: MemoryModel) -> MemoryModel:
    """The road-wheel angle follows its command no faster than `steering_rate_limit`."""

    def step(angle: Symbol, command: Symbol, p: Namespace, sample_time: float) -> tuple[Symbol, Symbol]:
        reach = p.steering_rate_limit * sample_time
        moved = angle + cs.fmax(-reach, cs.fmin(reach, command - angle))
        return moved, moved

    return model.with_actuator(SampledActuator("steer", step))


def _static(signal: str, seen: Callable[[Symbol, Namespace], Symbol]) -> Callable[[MemoryModel], MemoryModel]:
    """A static transform of a command, as an actuator without state."""

    def step(state: Symbol, command: Symbol, p: Namespace, sample_time: float) -> tuple[Symbol, Symbol]:
        del state, sample_time
        return command, seen(command, p)

    return lambda model: model.with_actuator(SampledActuator(signal, step))


scale_steering = _static("steer", lambda steer, p: steer * p.steering_ratio)
"""The road-wheel angle is `steering_ratio` times the command."""
shift_steering = _static("steer", lambda steer, p: steer + p.steering_offset)
"""`steering_offset` is added to the road-wheel angle."""
scale_motor = _static("motor_current", lambda current, p: current * p.motor_gain)
"""The motor current acts as if it were `motor_gain` times its reading."""


def delay_imu(model: MemoryModel) -> MemoryModel:
    """Delay the readings of yaw rate and accelerations by `sensor_latency_imu`."""

    def weights(p: Namespace, sample_time: float) -> Sequence[Symbol]:
        """Linear interpolation between samples, exact for signals that are linear between them."""
        lag = p.sensor_latency_imu / sample_time
        longest = max(1, ceil(LATENCY_PER_RUN.bounds[1] / sample_time - 1e-9))
        whole = cs.fmin(cs.floor(lag), longest - 1)  # at whole samples the derivative is the one towards larger lags
        share = lag - whole
        return [(whole == k) * (1 - share) + (whole + 1 == k) * share for k in range(longest + 1)]

    for signal in ("yaw_rate", "a_x", "a_y"):
        if signal in model.outputs:
            model = model.with_sensor(SampledSensor(signal, weights))
    return model
