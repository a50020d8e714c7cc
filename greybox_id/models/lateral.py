"""Lateral single-track model, two degrees of freedom: v_y and yaw rate at a measured speed.

ISO 8855 axes. States v_y [m/s], yaw_rate [rad/s]; inputs steer [rad] at the road wheels and v_x [m/s]. F_z is the
static load of an axle. Longitudinal forces are left out: the speed is given.
Source: Rajamani, Vehicle Dynamics and Control, 2nd ed., Sec. 2.3, with nonlinear tyres.
"""

from __future__ import annotations

from collections.abc import Mapping

import casadi as cs

from .model import Namespace, Symbol
from .motion_model import MotionModel, Quantities, State
from .single_track import BODY, G, combinations
from .smooth import SLIPPING, forward_speed, steer_slip
from .tyres import Tyre, axle, pacejka

STATES = (
    State("v_y", "m/s", 0.3, start=lambda x, u, p: p.l_r * x.yaw_rate),  # rear wheels that do not slip
    State("yaw_rate", "rad/s", 0.1),
)


def lateral(tyre: Tyre = pacejka) -> MotionModel:
    """Lateral single-track model with two degrees of freedom.

    Parameters
    ----------
    tyre : lateral force over slip angle and load.
    """

    def dynamics(x: Namespace, u: Namespace, p: Namespace, q: Quantities) -> Mapping[str, Symbol]:
        L = p.l_f + p.l_r
        v_x = forward_speed(u.v_x)

        q.alpha_f = steer_slip(u.steer, u.v_x) - cs.atan2(x.v_y + p.l_f * x.yaw_rate, v_x)
        q.alpha_r = -cs.atan2(x.v_y - p.l_r * x.yaw_rate, v_x)
        q.F_zf = p.m * G * p.l_r / L
        q.F_zr = p.m * G * p.l_f / L
        q.grip_f = q.grip_r = q.stiffness_f = q.stiffness_r = 1.0
        q.peak_f = tyre.peak(q.F_zf, axle(p, "f"), q.grip_f)
        q.peak_r = tyre.peak(q.F_zr, axle(p, "r"), q.grip_r)

        q.F_yf = tyre.force(q.alpha_f, q.F_zf, axle(p, "f"), q.grip_f, q.stiffness_f)
        q.F_yr = tyre.force(q.alpha_r, q.F_zr, axle(p, "r"), q.grip_r, q.stiffness_r)

        q.gravity_y = 0.0
        q.a_y = (q.F_yf * cs.cos(u.steer) + q.F_yr) / p.m
        q.M_z = p.l_f * q.F_yf * cs.cos(u.steer) - p.l_r * q.F_yr
        return {
            "v_y": q.a_y - q.gravity_y - x.yaw_rate * u.v_x,
            "yaw_rate": q.M_z / p.I_z,
        }

    return MotionModel(
        name="lateral",
        about="single-track vehicle at a measured speed, two degrees of freedom",
        states=STATES,
        inputs=("steer", "v_x"),
        commands=("steer",),
        outputs=("v_y", "yaw_rate", "a_y"),
        parameters=(*BODY, *tyre.parameters("f"), *tyre.parameters("r")),
        quantities=(
            *("alpha_f", "alpha_r", "F_zf", "F_zr", "grip_f", "grip_r", "stiffness_f", "stiffness_r"),
            *("peak_f", "peak_r", "F_yf", "F_yr", "gravity_y", "a_y", "M_z"),
        ),
        dynamics=dynamics,
        combinations=combinations(tyre),
        settings={"tyre": tyre.name},
        validity=SLIPPING,
    )
