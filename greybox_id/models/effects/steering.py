"""What may stand between the steering command and the road wheels.

The chain is delay, then play, rate limit, lag and servo in the order in which they were added, then ratio and offset.
For a delay, a lag, a servo and an offset the place in the chain makes no difference; behind a play or a rate limit, a
ratio other than one scales them too.
"""

from __future__ import annotations

from math import inf

from ..motion_model import MotionModel
from ..parameter import Parameter
from .elements import lag, play, rate_limit, servo
from .memory import limit_steering_rate, scale_steering, shift_steering
from .stating import alteration, effect

GROUP = "steering"


def _delay(model: MotionModel) -> MotionModel:
    return model.delayed("steer", lambda p: p.steering_delay)


def _lag(model: MotionModel) -> MotionModel:
    return model.actuated(lag("steer", "steering_lag_state", lambda p: p.steering_lag))


def _rate_limit(model: MotionModel) -> MotionModel:
    return model.actuated(rate_limit("steer", "steering_rate_limit_state", lambda p: p.steering_rate_limit))


def _servo(model: MotionModel) -> MotionModel:
    both = servo("steer", "steering_bandwidth", lambda p: p.steering_bandwidth, lambda p: p.steering_damping)
    return model.actuated(both[0]).actuated(both[1])


def _backlash(model: MotionModel) -> MotionModel:
    return model.actuated(play("steer", "steering_backlash_state", lambda p: p.steering_backlash))


steering_delay = effect(
    GROUP, "steering_delay", "s", 0.0, (0.0, 0.5), "pure delay of the steering command",
    touches=("steer",), apply=_delay, typical=0.03,
)  # fmt: skip

steering_lag = effect(
    GROUP, "steering_lag", "s", 0.0, (0.0, 0.5), "first-order time constant of the steering",
    touches=("steer",), apply=_lag, typical=0.03, gradual=False,
)  # fmt: skip

steering_rate_limit = effect(
    GROUP, "steering_rate_limit", "rad/s", inf, (0.1, inf), "largest rate of the road-wheel angle",
    touches=("steer",), apply=_rate_limit, apply_to_memory=limit_steering_rate, typical=0.5, gradual=False,
)  # fmt: skip

steering_backlash = effect(
    GROUP, "steering_backlash", "rad", 0.0, (0.0, 0.1), "half width of the play, at the road wheels",
    touches=("steer",), apply=_backlash, typical=0.01, gradual=False,
)  # fmt: skip

steering_offset = alteration(
    GROUP, "steering_offset", "rad", 0.0, (-0.2, 0.2), "added to the road-wheel angle",
    typical=0.01, apply_to_memory=shift_steering, steer=lambda steer, q: steer + q.p.steering_offset,
)  # fmt: skip

steering_ratio = alteration(
    GROUP, "steering_ratio", "1", 1.0, (0.3, 3.0), "road-wheel angle over what the command says",
    typical=1.1, apply_to_memory=scale_steering, steer=lambda steer, q: steer * q.p.steering_ratio,
)  # fmt: skip

steering_bandwidth = effect(
    GROUP, "steering_bandwidth", "Hz", inf, (0.5, inf), "natural frequency of the steering, a servo of second order",
    touches=("steer",), apply=_servo, typical=5.0, gradual=False, instead_of=("steering_lag",),
    others=(Parameter("steering_damping", "1", 0.7, (0.2, 0.98), fixed=True, about="damping ratio of the steering"),),
)  # fmt: skip

ALL = (
    steering_delay, steering_lag, steering_bandwidth, steering_rate_limit, steering_backlash, steering_offset,
    steering_ratio,
)  # fmt: skip
