"""Effects that models of this package may lack."""

from __future__ import annotations

from collections.abc import Sequence
from math import ceil, inf

import casadi as cs

from ..effect import Effect
from ..model import Actuator, Model, Namespace, Sensor, Symbol
from ..parameter import Parameter, Prior

_STEERING_RATE_LIMIT = Parameter(
    "steering_rate_limit", "rad/s", inf, (0.1, inf), about="largest rate of the road-wheel angle"
)
_SENSOR_LATENCY_IMU = Parameter(
    "sensor_latency_imu", "s", 0.0, (0.0, 0.2), Prior(0.03, mean=0.04), scope="run",
    about="how much later than the commands yaw rate and accelerations are stamped, per run",
)  # fmt: skip


def _limit_steering_rate(model: Model) -> Model:
    def step(angle: Symbol, command: Symbol, p: Namespace, sample_time: float) -> tuple[Symbol, Symbol]:
        reach = p.steering_rate_limit * sample_time
        moved = angle + cs.fmax(-reach, cs.fmin(reach, command - angle))
        return moved, moved

    return model.with_actuator(Actuator("steer", step))


def _delay_imu(model: Model) -> Model:
    def weights(p: Namespace, sample_time: float) -> Sequence[Symbol]:
        """Linear interpolation between samples, exact for signals that are straight between them."""
        lag = p.sensor_latency_imu / sample_time
        longest = max(1, ceil(_SENSOR_LATENCY_IMU.bounds[1] / sample_time - 1e-9))
        whole = cs.fmin(cs.floor(lag), longest - 1)  # at a whole sample the slope is that towards later, not a kink's
        share = lag - whole
        return [(whole == k) * (1 - share) + (whole + 1 == k) * share for k in range(longest + 1)]

    for signal in ("yaw_rate", "a_x", "a_y"):
        if signal in model.outputs:
            model = model.with_sensor(Sensor(signal, weights))
    return model


steering_rate_limit = Effect("steering_rate_limit", _STEERING_RATE_LIMIT, ("steer",), _limit_steering_rate)
sensor_latency_imu = Effect("sensor_latency_imu", _SENSOR_LATENCY_IMU, ("yaw_rate", "a_x", "a_y"), _delay_imu)
