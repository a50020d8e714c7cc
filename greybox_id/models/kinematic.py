"""Kinematic single-track model: yaw rate from geometry and speed, with an understeer gradient and a lag.

    yaw_rate = v_x tan(steer_gain steer) / (L + K_us v_x^2),   L = l_f + l_r

is where the yaw rate settles; it gets there with the time constant yaw_lag. State yaw_rate [rad/s]; inputs steer [rad]
and v_x [m/s]. Rear wheels do not slip, so v_y = l_r yaw_rate. With K_us = 0 it is the purely kinematic model. Below
zero the vehicle oversteers, up to a critical speed at which the equation ends: L + K_us v_x^2 stays above a tenth of L.
Source: Rajamani, Vehicle Dynamics and Control, 2nd ed., Sec. 2.2 and 3.3.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass

import casadi as cs

from .model import Combination, Namespace, Symbol
from .motion_model import MotionModel, Quantities, State
from .parameter import Parameter
from .single_track import BODY

LEAST_SHARE = 0.1
"""L + K_us v_x^2 is not less than this share of L."""


@dataclass(frozen=True)
class KinematicSettings:
    """What of the kinematic model is there.

    Attributes
    ----------
    understeer : whether there is an understeer gradient K_us; without one the model is purely kinematic.
    """

    understeer: bool = True


def kinematic(settings: KinematicSettings | None = None) -> MotionModel:
    """Kinematic single-track model with one state."""
    chosen = settings or KinematicSettings()
    parameters: tuple[Parameter, ...] = (
        *(parameter for parameter in BODY if parameter.name in ("l_f", "l_r")),
        Parameter("steer_gain", "1", 1.0, (0.005, 5.0), fixed=True, about="road-wheel angle over the steer signal"),
        Parameter("yaw_lag", "s", 0.1, (0.005, 2.0), about="time constant of the yaw rate"),
        *((Parameter("K_us", "rad s^2/m", 0.0, (-0.05, 0.2), about="understeer gradient"),) * chosen.understeer),
    )

    def dynamics(x: Namespace, u: Namespace, p: Namespace, q: Quantities) -> Mapping[str, Symbol]:
        L = p.l_f + p.l_r
        effective_wheelbase = cs.fmax(L + p.K_us * u.v_x**2, LEAST_SHARE * L) if chosen.understeer else L
        q.yaw_rate_settled = u.v_x * cs.tan(p.steer_gain * u.steer) / effective_wheelbase
        yaw_acceleration = (q.yaw_rate_settled - x.yaw_rate) / p.yaw_lag
        q.a_y = u.v_x * x.yaw_rate + p.l_r * yaw_acceleration
        return {"yaw_rate": yaw_acceleration}

    return MotionModel(
        name="kinematic",
        about="kinematic single-track vehicle with an understeer gradient",
        states=(State("yaw_rate", "rad/s", 0.1),),
        inputs=("steer", "v_x"),
        commands=("steer",),
        outputs=("yaw_rate", "a_y"),
        parameters=parameters,
        quantities=("yaw_rate_settled", "a_y"),
        dynamics=dynamics,
        combinations=(Combination("l_f + l_r", "m", lambda p: p.l_f + p.l_r, "wheelbase"),),
        settings=asdict(chosen),
    )
