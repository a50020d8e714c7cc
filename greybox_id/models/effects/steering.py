"""Effects between the steering command and the road wheels.

The chain is delay, then play, rate limit, lag and servo in the order in which they were added, then ratio and offset.
The place of a delay, a lag, a servo or an offset in the chain makes no difference; a ratio other than one also scales
the play and the rate limit before it. Quantisation by the angle sensor and compliance of the wheels come last.
"""

from __future__ import annotations

from math import inf, pi

import casadi as cs

from ..model import Namespace, Symbol
from ..motion_model import MotionModel, Quantities
from ..parameter import Parameter
from ..smooth import forward_speed
from .elements import lag, play, rate_limit, servo
from .memory import limit_steering_rate, scale_steering, shift_steering
from .stating import alteration, effect

GROUP = "steering"
LEAST_STEP = 1e-6
"""Smallest quantisation step of a sensor, rad; smaller ones are treated as none."""
NO_JERK_LIMIT = 1e15
"""Largest jerk limit, m/s^3: for an infinite one, derivatives by the wheelbase stay finite."""
SHARPNESS = 0.9999
"""Sharpness of the staircase: corners are rounded over a ten-thousandth of a step."""
LEAST_LOAD = 1e-9
"""N, added to the load: before the first pass both load and force are zero."""


def _servo(model: MotionModel) -> MotionModel:
    both = servo("steer", "steering_bandwidth", lambda p: p.steering_bandwidth, lambda p: p.steering_damping)
    return model.actuated(both[0]).actuated(both[1])


def _jerk_limit(model: MotionModel) -> MotionModel:
    """Limit of the steering rate: at speed v, a rate d'(t) changes the lateral acceleration by v^2 / L d'(t)."""

    def limit(p: Namespace) -> Symbol:
        v = forward_speed(sum(p.inputs["v_x"]) / 2)
        return cs.fmin(p.steering_jerk_limit, NO_JERK_LIMIT) * (p.l_f + p.l_r) / v**2

    return model.actuated(rate_limit("steer", "steering_jerk_limit_state", limit))


def _in_steps(steer: Symbol, q: Quantities) -> Symbol:
    """Angle rounded to a whole step: less the sawtooth of the rest, by its Fourier series, Im log(1 + s exp(i t))."""
    step = q.p.sensor_quantisation
    turn = 2 * pi * steer / cs.fmax(step, LEAST_STEP)
    return steer - step / pi * cs.atan2(SHARPNESS * cs.sin(turn), 1 + SHARPNESS * cs.cos(turn))


def _given_way(steer: Symbol, q: Quantities) -> Symbol:
    """Angle less the compliance under the tyre's force and trail, with the force of the previous pass."""
    return steer - q.p.steering_compliance * q.before.F_yf / (cs.fabs(q.before.F_zf) + LEAST_LOAD)


steering_delay = effect(
    GROUP, "steering_delay", "s", 0.0, (0.0, 0.5), "pure delay of the steering command",
    touches=("steer",), apply=lambda model: model.delayed("steer", lambda p: p.steering_delay), typical=0.03,
)  # fmt: skip

steering_lag = effect(
    GROUP, "steering_lag", "s", 0.0, (0.0, 0.5), "first-order time constant of the steering",
    touches=("steer",), typical=0.03, gradual=False,
    apply=lambda model: model.actuated(lag("steer", "steering_lag_state", lambda p: p.steering_lag)),
)  # fmt: skip

steering_rate_limit = effect(
    GROUP, "steering_rate_limit", "rad/s", inf, (0.1, inf), "largest rate of the road-wheel angle",
    touches=("steer",), apply_to_memory=limit_steering_rate, typical=0.5, gradual=False,
    apply=lambda model: model.actuated(
        rate_limit("steer", "steering_rate_limit_state", lambda p: p.steering_rate_limit)
    ),
)  # fmt: skip

steering_backlash = effect(
    GROUP, "steering_backlash", "rad", 0.0, (0.0, 0.1), "half width of the play, at the road wheels",
    touches=("steer",), typical=0.01, gradual=False,
    apply=lambda model: model.actuated(play("steer", "steering_backlash_state", lambda p: p.steering_backlash)),
)  # fmt: skip

steering_offset = alteration(
    GROUP, "steering_offset", "rad", 0.0, (-0.2, 0.2), "offset of the road-wheel angle",
    typical=0.01, apply_to_memory=shift_steering, steer=lambda steer, q: steer + q.p.steering_offset,
)  # fmt: skip

steering_ratio = alteration(
    GROUP, "steering_ratio", "1", 1.0, (0.3, 3.0), "ratio of the road-wheel angle to the commanded angle",
    typical=1.1, apply_to_memory=scale_steering, steer=lambda steer, q: steer * q.p.steering_ratio,
)  # fmt: skip

steering_bandwidth = effect(
    GROUP, "steering_bandwidth", "Hz", inf, (0.5, inf), "natural frequency of the steering, a servo of second order",
    touches=("steer",), apply=_servo, typical=5.0, gradual=False, instead_of=("steering_lag",),
    others=(Parameter("steering_damping", "1", 0.7, (0.2, 0.98), fixed=True, about="damping ratio of the steering"),),
)  # fmt: skip

steering_jerk_limit = effect(
    GROUP, "steering_jerk_limit", "m/s^3", inf, (0.1, inf),
    "limit of a driver assistance on the lateral jerk v² dδ/dt / L",
    touches=("steer",), needs=("v_x", "l_f", "l_r"), driven_by=("v_x",), apply=_jerk_limit, typical=5.0, gradual=False,
    by_name=True,
)  # fmt: skip
"""Lane-keeping systems are allowed 5 m/s^3 (ISO 11270:2014)."""

sensor_quantisation = alteration(
    GROUP, "sensor_quantisation", "rad", 0.0, (0.0, 0.05), (
        "resolution of the angle sensor in the steering's control loop"
    ),
    typical=0.01, gradual=False, by_name=True, rounds="steer", steer=_in_steps,
)  # fmt: skip

steering_compliance = alteration(
    GROUP, "steering_compliance", "rad", 0.0, (0.0, 0.03),
    "angle by which the front wheels yield if the lateral force equals their load",
    typical=0.01, passes=4, needs=("F_yf", "F_zf"), by_name=True, steer=_given_way,
)  # fmt: skip

ALL = (
    steering_delay, steering_lag, steering_bandwidth, steering_rate_limit, steering_backlash, steering_offset,
    steering_ratio, steering_jerk_limit, sensor_quantisation, steering_compliance,
)  # fmt: skip
