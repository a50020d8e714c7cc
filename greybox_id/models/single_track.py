"""Single-track models: three degrees of freedom, lateral at a measured speed, kinematic; optionally with body roll.

ISO 8855 axes. `single_track` has the states v_x, v_y [m/s] and yaw_rate [rad/s]; inputs steer [rad] at the road wheels
and drive (N, m/s^2, A or a throttle, whichever is recorded). F_z is the static load of an axle; c_0 + c_1 v_x + c_2
v_x^2 resists the motion. `lateral` takes the speed as an input and omits longitudinal forces.
Source: Rajamani, Vehicle Dynamics and Control, 2nd ed., Sec. 2.3 and 4.1, with nonlinear tyres.

The body may roll on its springs: roll angle and roll rate, which a gyro reads, follow from

    (I_x + m h_cg^2) roll'' = m h_cg (a_y + g roll) - roll_stiffness roll - roll_damper roll'

about an axis on the road, positive if the left side rises, as in a left turn. Springs are stated in N m/rad, so that
amplitude and frequency of roll identify the mass, which lateral motion alone identifies only in combination with the
tyres' forces. An accelerometer on the body reads a_y + g roll - h_cg roll'', as with the effect `roll_dynamics`, which
parametrises the same body by its roll gradient and natural frequency. Source: Rajamani, Sec. 15.2.

In `kinematic`, whose rear wheels do not slip (v_y = l_r yaw_rate), the yaw rate settles at

    yaw_rate = v_x tan(steer_gain steer) / (L + K_us v_x^2),   L = l_f + l_r

with the time constant yaw_lag. With K_us = 0 it is the purely kinematic model. With K_us < 0 the vehicle oversteers and
has a critical speed, which the equation does not reach: L + K_us v_x^2 is at least a tenth of L. Source: Rajamani,
Sec. 2.2, 3.3.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, replace

import casadi as cs

from ..base.errors import BadInput
from ..base.numbers import quantity
from ..base.signals import DRIVE_SIGNALS
from .model import Combination, Model, Namespace, Symbol
from .motion_model import MotionModel, Quantities, State
from .parameter import Parameter
from .smooth import SLIPPING, forward_speed, sign_of_motion, steer_slip
from .tyres import Tyre, axle, pacejka

G = 9.81
"""Gravity, m/s^2."""

BODY = (
    Parameter("m", "kg", 1450.0, (0.5, 60000.0), fixed=True, about="vehicle mass"),
    Parameter("I_z", "kg m^2", 2270.0, (1e-3, 500000.0), about="yaw inertia"),
    Parameter("l_f", "m", 1.30, (0.05, 8.0), fixed=True, about="front axle to centre of gravity"),
    Parameter("l_r", "m", 1.46, (0.05, 8.0), fixed=True, about="rear axle to centre of gravity"),
    Parameter("h_cg", "m", 0.55, (0.01, 2.5), fixed=True, about="height of the centre of gravity"),
    Parameter("track_f", "m", 1.55, (0.05, 3.0), fixed=True, about="track width, front"),
    Parameter("track_r", "m", 1.55, (0.05, 3.0), fixed=True, about="track width, rear"),
)

DRIVE = (
    Parameter("c_0", "N", 200.0, (0.0, 5000.0), about="rolling resistance"),
    Parameter("c_1", "N s/m", 0.0, (0.0, 500.0), fixed=True, about="resistance per speed"),
    Parameter("c_2", "N s^2/m^2", 0.45, (0.0, 10.0), about="aerodynamic drag"),
    Parameter("drive_split_front", "1", 0.0, (0.0, 1.0), fixed=True, about="front axle's share of the driving force"),
    Parameter("brake_split_front", "1", 0.62, (0.0, 1.0), fixed=True, about="front axle's share of the braking force"),
    Parameter("force_per_unit", "N/unit", 1450.0, (0.0, 1e5), about="force at the wheels per unit of the drive signal"),
)

MOTOR = (
    Parameter("dead_band", "1", 0.0, (0.0, 1.0), about="drive signal below which the motor gives no force"),
    Parameter(
        "motor_damping", "N s/m", 0.0, (0.0, 1e5), about="loss of force at full drive per unit of speed (back-EMF)"
    ),
)
"""Additional parameters of the drive "motor"."""
BRAKE = (Parameter("brake_per_unit", "N/unit", 3000.0, (0.0, 1e6), about="braking force per unit of the brake signal"),)
"""Additional parameter of a brake separate from the drive."""
DRIVES = ("linear", "motor")
BRAKES = ("drive", "negative", "separate")

STATES = (
    State("v_x", "m/s", 1.0),
    State("v_y", "m/s", 0.3, start=lambda x, u, p: p.l_r * x.yaw_rate),  # no slip at the rear wheels
    State("yaw_rate", "rad/s", 0.1),
)


def single_track(tyre: Tyre = pacejka, drive: str = "linear", brake: str = "drive") -> MotionModel:
    """Single-track model with three degrees of freedom.

    Parameters
    ----------
    tyre : lateral force over slip angle and load.
    drive : "linear", a force proportional to the drive signal; "motor", see `motor_force`.
    brake : "drive", negative drive brakes as strongly as positive drive pulls; "negative", it brakes with a separate
        gain; "separate", the brake is a further input.
    """

    def dynamics(x: Namespace, u: Namespace, p: Namespace, q: Quantities) -> Mapping[str, Symbol]:
        c, s = cs.cos(u.steer), cs.sin(u.steer)

        _slip(q, x, u.steer, x.v_x, p, tyre)

        pedal = cs.fmax(u.drive, 0) if brake == "negative" else u.drive
        q.drive_force = p.force_per_unit * pedal if drive == "linear" else motor_force(pedal, x.v_x, p)
        driving, braking = cs.fmax(q.drive_force, 0), cs.fmin(q.drive_force, 0)
        if brake != "drive":
            q.brake_force = p.brake_per_unit * cs.fmax(-u.drive if brake == "negative" else u.brake, 0)
            braking = braking - q.brake_force * sign_of_motion(x.v_x)
        q.F_xf = p.drive_split_front * driving + p.brake_split_front * braking
        q.F_xr = (1 - p.drive_split_front) * driving + (1 - p.brake_split_front) * braking
        q.F_yf = tyre.force(q.alpha_f, q.F_zf, axle(p, "f"), q.grip_f, q.stiffness_f)
        q.F_yr = tyre.force(q.alpha_r, q.F_zr, axle(p, "r"), q.grip_r, q.stiffness_r)
        q.F_drag = (p.c_0 + p.c_1 * cs.fabs(x.v_x) + p.c_2 * x.v_x**2) * sign_of_motion(x.v_x)

        q.gravity_x, q.gravity_y = 0.0, 0.0
        q.a_x = (q.F_xr + q.F_xf * c - q.F_yf * s - q.F_drag) / p.m
        q.a_y = (q.F_yr + q.F_yf * c + q.F_xf * s) / p.m
        q.M_z = p.l_f * (q.F_yf * c + q.F_xf * s) - p.l_r * q.F_yr
        return {
            "v_x": q.a_x - q.gravity_x + x.yaw_rate * x.v_y,
            "v_y": q.a_y - q.gravity_y - x.yaw_rate * x.v_x,
            "yaw_rate": q.M_z / p.I_z,
        }

    return MotionModel(
        name="single_track",
        about="single-track vehicle, three degrees of freedom",
        states=STATES,
        inputs=("steer", "drive", *(("brake",) if brake == "separate" else ())),
        commands=("steer", "drive", *(("brake",) if brake == "separate" else ())),
        aliases={"drive": DRIVE_SIGNALS},
        outputs=("v_x", "v_y", "yaw_rate", "a_x", "a_y"),
        parameters=(
            *(*BODY, *DRIVE, *(MOTOR if drive == "motor" else ()), *(BRAKE if brake != "drive" else ())),
            *(*tyre.parameters("f"), *tyre.parameters("r")),
        ),
        quantities=(
            *("alpha_f", "alpha_r", "F_zf", "F_zr"),
            *("grip_f", "grip_r", "stiffness_f", "stiffness_r", "peak_f", "peak_r"),
            *("drive_force", *(("brake_force",) if brake != "drive" else ()), "F_xf", "F_xr", "F_yf", "F_yr", "F_drag"),
            *("gravity_x", "gravity_y", "a_x", "a_y", "M_z"),
        ),
        dynamics=dynamics,
        combinations=combinations(tyre),
        settings={"tyre": tyre.name} | not_usual(drive, brake),
        validity=SLIPPING,
    )


def _slip(q: Quantities, x: Namespace, steer: Symbol, v_x: Symbol, p: Namespace, tyre: Tyre) -> None:
    """Slip angles, static loads and peaks of the tyres of both axles."""
    L, forward = p.l_f + p.l_r, forward_speed(v_x)
    q.alpha_f = steer_slip(steer, v_x) - cs.atan2(x.v_y + p.l_f * x.yaw_rate, forward)
    q.alpha_r = -cs.atan2(x.v_y - p.l_r * x.yaw_rate, forward)
    q.F_zf = p.m * G * p.l_r / L
    q.F_zr = p.m * G * p.l_f / L
    q.grip_f = q.grip_r = q.stiffness_f = q.stiffness_r = 1.0
    q.peak_f = tyre.peak(q.F_zf, axle(p, "f"), q.grip_f)
    q.peak_r = tyre.peak(q.F_zr, axle(p, "r"), q.grip_r)


def not_usual(drive: str, brake: str) -> dict[str, str]:
    """Settings of drive and brake that differ from the default."""
    return ({"drive": drive} if drive != "linear" else {}) | ({"brake": brake} if brake != "drive" else {})


def motor_force(drive: Symbol, v_x: Symbol, p: Namespace) -> Symbol:
    """Force of a motor under a controller of its voltage, N.

    A share u of the full voltage drives a current proportional to u less the induced voltage, for the share of time in
    which the voltage is applied: (force_per_unit - motor_damping |v_x|) u, with u beyond the dead band. Against the
    motion (u < 0) it brakes with force_per_unit alone. Source: Lyons et al., DART, 2024 (motor model).
    """
    beyond = drive - cs.fmin(cs.fmax(drive, -p.dead_band), p.dead_band)
    return p.force_per_unit * beyond - p.motor_damping * cs.fabs(v_x) * cs.fmax(beyond, 0)


def combinations(tyre: Tyre) -> tuple[Combination, ...]:
    """Quantities that lateral motion identifies better than single parameters."""

    def slope(p: Namespace, suffix: str) -> Symbol:
        other = p.l_r if suffix == "f" else p.l_f
        return tyre.slope(p.m * G * other / (p.l_f + p.l_r), axle(p, suffix))

    def understeer(p: Namespace) -> Symbol:
        L, C_f, C_r = p.l_f + p.l_r, slope(p, "f"), slope(p, "r")
        return p.m / L * (p.l_r / C_f - p.l_f / C_r)

    return (
        Combination("l_f + l_r", "m", lambda p: p.l_f + p.l_r, "wheelbase"),
        Combination("C_alpha_f", "N/rad", lambda p: slope(p, "f"), "cornering stiffness, front axle", "stiffness_f"),
        Combination("C_alpha_r", "N/rad", lambda p: slope(p, "r"), "cornering stiffness, rear axle", "stiffness_r"),
        Combination("C_alpha_f / m", "N/(rad kg)", lambda p: slope(p, "f") / p.m, "front stiffness per mass"),
        Combination("C_alpha_r / m", "N/(rad kg)", lambda p: slope(p, "r") / p.m, "rear stiffness per mass"),
        Combination("I_z / m", "m^2", lambda p: p.I_z / p.m, "yaw inertia per mass"),
        Combination("K_us", "rad s^2/m", understeer, "understeer gradient"),
    )


ROLLING = (
    Parameter("I_x", "kg m^2", 550.0, (1e-5, 100000.0), fixed=True, about="roll inertia about the centre of gravity"),
    Parameter("roll_stiffness", "N m/rad", 9e4, (0.1, 5e6), about="moment of springs and stabilisers per roll angle"),
    Parameter("roll_damper", "N m s/rad", 5e3, (1e-3, 5e5), about="moment of the dampers per roll rate"),
)


def with_roll(model: MotionModel) -> MotionModel:
    """The model with a rolling body, and its roll rate as an output.

    Parameters
    ----------
    model : `single_track` or `lateral`.
    """

    def rolling(q: Quantities) -> dict[str, Symbol]:
        moment = q.p.m * q.p.h_cg * (q.a_y + G * q.x.roll)
        back = q.p.roll_stiffness * q.x.roll + q.p.roll_damper * q.x.roll_rate
        return {"roll": q.x.roll_rate, "roll_rate": (moment - back) / (q.p.I_x + q.p.m * q.p.h_cg**2)}

    def on_the_body(read: Namespace, q: Quantities) -> Mapping[str, Symbol]:
        return {"a_y": read.a_y + G * q.x.roll - q.p.h_cg * q.rates.roll_rate}

    def steady(x: Namespace, u: Namespace, p: Namespace) -> Symbol:
        """The roll angle of a steady turn."""
        weight = p.m * p.h_cg
        return weight * x.yaw_rate * (x.v_x if hasattr(x, "v_x") else u.v_x) / (p.roll_stiffness - weight * G)

    states = (State("roll", "rad", 0.03, start=steady), State("roll_rate", "rad/s", 0.05))
    result = model.with_states(rolling, *states).sensed(on_the_body).with_parameters(*ROLLING)
    return replace(result, outputs=(*result.outputs, "roll_rate"), settings=dict(result.settings) | {"body": "rolling"})


def must_stand(model: Model) -> None:
    """Raise `BadInput` if a rolling body has no equilibrium: gravity exceeds the stiffness of the springs."""
    if model.settings.get("body") != "rolling":
        return
    stiffness, m, h_cg = (float(model[name].array) for name in ("roll_stiffness", "m", "h_cg"))
    if stiffness <= m * h_cg * G:
        stiff, weight = quantity(stiffness, "N m/rad"), quantity(m * h_cg * G, "N m/rad")
        raise BadInput(
            f"{model.name}: the body tips over, since roll_stiffness is {stiff}: it must exceed m · h_cg · g = "
            f"{weight}. State a larger roll_stiffness in the vehicle file, or set body=stiff."
        )


def lateral(tyre: Tyre = pacejka) -> MotionModel:
    """Lateral single-track model with two degrees of freedom.

    Parameters
    ----------
    tyre : lateral force over slip angle and load.
    """

    def dynamics(x: Namespace, u: Namespace, p: Namespace, q: Quantities) -> Mapping[str, Symbol]:
        _slip(q, x, u.steer, u.v_x, p, tyre)
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
        states=STATES[1:],
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


LEAST_SHARE = 0.1
"""Lower bound of L + K_us v_x^2 as a share of L."""

TURNING = (
    *(parameter for parameter in BODY if parameter.name in ("l_f", "l_r")),
    Parameter("steer_gain", "1", 1.0, (0.005, 5.0), fixed=True, about="road-wheel angle over the steer signal"),
    Parameter("yaw_lag", "s", 0.1, (0.005, 2.0), about="time constant of the yaw rate"),
    Parameter("K_us", "rad s^2/m", 0.0, (-0.05, 0.2), about="understeer gradient"),
)
"""Parameters of the kinematic model; the last one only with understeer."""


@dataclass(frozen=True)
class KinematicSettings:
    """Hyperparameters of the kinematic model.

    Attributes
    ----------
    understeer : whether there is an understeer gradient K_us; without one the model is purely kinematic.
    """

    understeer: bool = True


def kinematic(settings: KinematicSettings | None = None) -> MotionModel:
    """Kinematic single-track model with one state."""
    chosen = settings or KinematicSettings()

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
        parameters=TURNING if chosen.understeer else TURNING[:-1],
        quantities=("yaw_rate_settled", "a_y"),
        dynamics=dynamics,
        combinations=(Combination("l_f + l_r", "m", lambda p: p.l_f + p.l_r, "wheelbase"),),
        settings=asdict(chosen),
    )
