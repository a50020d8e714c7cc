"""Effects of the body beyond fixed mass, inertia, centre of gravity and static loads."""

from __future__ import annotations

from collections.abc import Mapping
from math import pi

from ..model import Namespace, Symbol
from ..motion_model import MotionModel, Quantities, State
from ..parameter import Parameter
from ..single_track import G
from ..smooth import remaining
from .stating import alteration, effect, speed

GROUP = "body"


def _to_rear(q: Quantities) -> Symbol:
    """Load [N] that longitudinal acceleration transfers to the rear axle."""
    return q.p.longitudinal_load_transfer * q.p.m * q.before.a_x * q.p.h_cg / (q.p.l_f + q.p.l_r)


def _downforce(share: Symbol, q: Quantities) -> Symbol:
    return q.p.downforce * speed(q) ** 2 * share / (q.p.l_f + q.p.l_r)


def _swaying(q: Quantities) -> dict[str, Symbol]:
    """Derivatives of roll angle over roll gradient: the lateral acceleration as followed by the sprung mass."""
    w = 2 * pi * q.p.roll_frequency
    back = w**2 * (q.a_y - q.x.a_y_of_roll) - 2 * q.p.roll_damping * w * q.x.a_y_of_roll_rate
    return {"a_y_of_roll": q.x.a_y_of_roll_rate, "a_y_of_roll_rate": back}


def _on_the_sprung_mass(read: Namespace, q: Quantities) -> Mapping[str, Symbol]:
    roll = q.p.roll_dynamics * q.x.a_y_of_roll
    roll_acceleration = q.p.roll_dynamics * q.rates.a_y_of_roll_rate
    return {"a_y": read.a_y + G * roll - q.p.h_cg * roll_acceleration}


def _steady_a_y(x: Namespace, u: Namespace, p: Namespace) -> Symbol:
    del p
    return x.yaw_rate * (x.v_x if hasattr(x, "v_x") else u.v_x)


def _rolling(model: MotionModel) -> MotionModel:
    followed = State("a_y_of_roll", "m/s^2", 1.0, start=_steady_a_y)
    return model.with_states(_swaying, followed, State("a_y_of_roll_rate", "m/s^3", 10.0)).sensed(_on_the_sprung_mass)


mass_change = alteration(
    GROUP, "mass_change", "1", 1.0, (0.3, 3.0),
    "factor on the mass, and so on the wheel loads, but not on the yaw inertia",
    typical=1.15, m=lambda m, q: m * q.p.mass_change,
)  # fmt: skip

cog_shift = alteration(
    GROUP, "cog_shift", "m", 0.0, (-1.0, 1.0), "forward shift of the centre of gravity",
    typical=0.1, needs=("l_f", "l_r"),
    l_f=lambda l_f, q: l_f - q.p.cog_shift,
    l_r=lambda l_r, q: l_r + q.p.cog_shift,
)  # fmt: skip

yaw_inertia = alteration(
    GROUP, "yaw_inertia", "1", 1.0, (0.2, 5.0), "factor on the yaw inertia",
    typical=1.3, I_z=lambda I_z, q: I_z * q.p.yaw_inertia,
)  # fmt: skip

longitudinal_load_transfer = alteration(
    GROUP, "longitudinal_load_transfer", "1", 0.0, (0.0, 2.0),
    "factor on the height of the centre of gravity in load transfer by a_x",
    typical=1.0, passes=3, needs=("a_x", "h_cg", "l_f", "l_r"),
    F_zf=lambda F_z, q: F_z * remaining(_to_rear(q) / F_z),
    F_zr=lambda F_z, q: F_z * remaining(-_to_rear(q) / F_z),
)  # fmt: skip

downforce = alteration(
    GROUP, "downforce", "N s^2/m^2", 0.0, (-5.0, 300.0), "aerodynamic load divided by speed squared; split "
                                                         "between the axles like the static load",
    typical=1.0, needs=("l_f", "l_r"),
    F_zf=lambda F_z, q: F_z + _downforce(q.p.l_r, q),
    F_zr=lambda F_z, q: F_z + _downforce(q.p.l_f, q),
)  # fmt: skip

roll_dynamics = effect(
    GROUP, "roll_dynamics", "rad s^2/m", 0.0, (0.0, 0.05), "roll angle per lateral acceleration",
    touches=("a_y",), needs=("a_y", "yaw_rate", "v_x", "h_cg"), apply=_rolling, typical=0.01,
    others=(
        Parameter("roll_frequency", "Hz", 1.5, (0.3, 10.0), fixed=True, about="natural frequency of roll"),
        Parameter("roll_damping", "1", 0.3, (0.02, 2.0), fixed=True, about="damping ratio of roll"),
    ),
)  # fmt: skip

ALL = (mass_change, cog_shift, yaw_inertia, longitudinal_load_transfer, downforce, roll_dynamics)
