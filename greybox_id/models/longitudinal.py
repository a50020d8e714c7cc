"""Longitudinal model: Newton's law along the vehicle, with wheel inertia and a first-order actuator lag.

State v_x [m/s]; inputs drive (N, m/s^2 or A, whichever is recorded; negative brakes) and road_slope [rad], uphill
positive. The four wheels' inertia I_w adds 4 I_w / wheel_radius^2 to the accelerated mass, but not to the weight. If
the friction is stated, it limits the longitudinal force to friction times the weight. a_x is the reading of an
accelerometer: dv_x/dt + g sin(road_slope).
Source: Mungiello et al., "Vehicle dynamics learning from physics priors with model-structured neural networks",
Eq. 8-12, with c_0 = m g c_r, c_1 = c_l, c_2 = k_a, and one wheel inertia.
"""

from __future__ import annotations

from collections.abc import Mapping

import casadi as cs

from ..base.signals import DRIVE_SIGNALS
from .effects.elements import lag
from .model import Combination, Namespace, Symbol
from .motion_model import MotionModel, Quantities, State
from .parameter import Parameter
from .single_track import BODY, BRAKE, DRIVE, MOTOR, G, motor_force, not_usual
from .smooth import sign_of_motion, within_limit

WHEELS = (
    Parameter(
        "I_w", "kg m^2", 1.0, (0.0, 100.0), fixed=True, about="inertia of one wheel and all parts that turn with it"
    ),
    Parameter("wheel_radius", "m", 0.32, (0.01, 2.0), fixed=True, about="rolling radius of the wheels"),
)
"""Wheels of a mid-size car, used unless a vehicle is stated."""

ENDLESS = 1e6
"""A friction coefficient that no vehicle's force reaches."""
PARAMETERS = (
    *(parameter for parameter in BODY if parameter.name == "m"),
    *WHEELS,
    *(parameter for parameter in DRIVE if parameter.name in ("c_0", "c_1", "c_2", "force_per_unit")),
    Parameter(
        "brake_gain",
        "1",
        1.0,
        (0.0, 10.0),
        fixed=True,
        about="braking force per unit divided by driving force per unit",
    ),
    Parameter(
        "friction",
        "1",
        ENDLESS,
        (0.01, ENDLESS),
        fixed=True,
        about="largest longitudinal force divided by the weight (friction of the road); unlimited unless stated",
    ),
    Parameter("drive_lag", "s", 0.05, (0.0, 2.0), about="first-order time constant of drive and brakes"),
)


def longitudinal(drive: str = "linear", brake: str = "drive") -> MotionModel:
    """Longitudinal model with one degree of freedom; drive and brake as in `single_track`."""
    separate = ("brake",) if brake == "separate" else ()

    def dynamics(x: Namespace, u: Namespace, p: Namespace, q: Quantities) -> Mapping[str, Symbol]:
        moving = sign_of_motion(x.v_x)  # zero at rest: brakes and rolling resistance do not accelerate a vehicle

        pedal = cs.fmax(u.drive, 0) if brake == "negative" else u.drive
        q.drive_force = p.force_per_unit * pedal if drive == "linear" else motor_force(pedal, x.v_x, p)
        requested = cs.fmax(q.drive_force, 0) + p.brake_gain * cs.fmin(q.drive_force, 0) * moving
        if brake != "drive":
            q.brake_force = p.brake_per_unit * cs.fmax(-u.drive if brake == "negative" else u.brake, 0)
            requested = requested - q.brake_force * moving
        q.road_limit = p.friction * p.m * G
        q.F_x = requested * within_limit(cs.fabs(requested) / q.road_limit)
        q.F_drag = (p.c_0 * cs.cos(u.road_slope) + p.c_1 * cs.fabs(x.v_x) + p.c_2 * x.v_x**2) * moving

        q.gravity_x = G * cs.sin(u.road_slope)
        turning = 4 * p.I_w / p.wheel_radius**2
        acceleration = (q.F_x - q.F_drag - p.m * q.gravity_x) / (p.m + turning)
        q.a_x = acceleration + q.gravity_x
        return {"v_x": q.a_x - q.gravity_x}

    return MotionModel(
        name="longitudinal",
        about="vehicle along a straight road, one degree of freedom",
        states=(State("v_x", "m/s", 1.0),),
        inputs=("drive", *separate, "road_slope"),
        commands=("drive", *separate),
        aliases={"drive": DRIVE_SIGNALS},
        defaults={"road_slope": 0.0},
        outputs=("v_x", "a_x"),
        parameters=(*PARAMETERS, *(MOTOR if drive == "motor" else ()), *(BRAKE if brake != "drive" else ())),
        quantities=(
            "drive_force",
            *(("brake_force",) if brake != "drive" else ()),
            "road_limit",
            "F_x",
            "F_drag",
            "gravity_x",
            "a_x",
        ),
        dynamics=dynamics,
        settings=not_usual(drive, brake),
        actuators=(lag("drive", "drive_lag_state", lambda p: p.drive_lag),),
        combinations=(
            Combination("m_eff", "kg", effective_mass, "vehicle mass plus the equivalent mass of the wheels' inertia"),
            Combination("c_0 / m_eff", "m/s^2", lambda p: p.c_0 / effective_mass(p), "rolling resistance per mass"),
            Combination("c_2 / m_eff", "1/m", lambda p: p.c_2 / effective_mass(p), "aerodynamic drag per mass"),
            Combination(
                name="force_per_unit / m_eff",
                unit="m/s^2/unit",
                of=lambda p: p.force_per_unit / effective_mass(p),
                about="acceleration per unit of the drive signal",
            ),
        ),
    )


def effective_mass(p: Namespace) -> Symbol:
    """Mass accelerated by a longitudinal force, including the wheels' inertia [kg]."""
    return p.m + 4 * p.I_w / p.wheel_radius**2
