"""Steering actuator: the road-wheel angle follows its command with a first-order lag, a gain and an offset.

    d(steer_measured)/dt = (gain steer + offset - steer_measured) / lag

State steer_measured [rad]; input steer [rad], the command. A delay, a rate limit or play are effects.
The first-order system is the textbook model of a position-controlled drive whose dominant pole is real.
"""

from __future__ import annotations

from collections.abc import Mapping

from .model import Namespace, Symbol
from .motion_model import MotionModel, Quantities, State
from .parameter import Parameter


def steering() -> MotionModel:
    """Steering actuator with one state."""

    def dynamics(x: Namespace, u: Namespace, p: Namespace, q: Quantities) -> Mapping[str, Symbol]:
        return {"steer_measured": (p.gain * u.steer + p.offset - x.steer_measured) / p.lag}

    return MotionModel(
        name="steering",
        about="steering actuator: road-wheel angle that lags its command",
        states=(State("steer_measured", "rad", 0.1),),
        inputs=("steer",),
        commands=("steer",),
        outputs=("steer_measured",),
        parameters=(
            Parameter("lag", "s", 0.03, (1e-3, 0.5), about="time constant"),
            Parameter("gain", "1", 1.0, (0.5, 1.5), about="measured over commanded"),
            Parameter("offset", "rad", 0.0, (-0.05, 0.05), about="measured less commanded"),
        ),
        dynamics=dynamics,
    )
