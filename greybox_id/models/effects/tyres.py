"""Effects of tyres beyond a fixed curve of force over slip angle."""

from __future__ import annotations

import casadi as cs

from ..model import Symbol
from ..motion_model import Quantities, State
from ..parameter import Parameter
from ..single_track import G
from ..smooth import forward_speed, remaining
from .stating import alteration, effect, speed

GROUP = "tyres"

FRONT_SHARE = 0.55
"""Front axle's share of the lateral load transfer, by springs and stabilisers of most cars."""


NEXT_TO_NOTHING = 1e-4
"""Added to the squared share of friction that longitudinal forces use: its power is smooth for shares below 0.01."""


def _kept_slope(q: Quantities) -> Symbol | float:
    """Factor on the slope at zero slip, by which a tyre keeps part of its slope when its friction is scaled.

    A factor on Pacejka's D scales the slope B C D as well. On a road of other friction the rubber's stiffness is
    unchanged, as in the brush and Dugoff's tyre (Pacejka, Tire and Vehicle Dynamics, 3rd ed., Sec. 3.2, 4.3.2).
    """
    return q.p.grip_scale ** (q.p.grip_scale_slope - 1) if hasattr(q.p, "B_f") else 1.0


COMBINED_POWER, COMBINED_BALANCE = "combined_power", "combined_balance"
"""Parameters of combined slip that a vehicle file may leave open: two minus the exponent by which longitudinal forces
reduce lateral ones, and how much larger the share of friction used by them is at the front axle than at the rear."""


def _ellipse(F_x: Symbol, peak: Symbol, q: Quantities, side: int) -> Symbol:
    """Lateral force reduced by a longitudinal one: factor sqrt(1 - |s F_x / peak|^n), rounded near zero.

    n = 2 is the friction ellipse. Tyres whose force is along their slip and grows like 1 - exp(-slip), such as
    Burckhardt's, lose half of |F_x / peak| at small slip, n = 1; a brush tyre loses a third of it, magic formulas a
    part of its square (Pacejka, Tire and Vehicle Dynamics, 3rd ed., Sec. 1.2.2, 3.2, 4.3.2).
    """
    share = q.p.combined_slip
    if hasattr(q.p, COMBINED_BALANCE):
        share = share * (1 + side * getattr(q.p, COMBINED_BALANCE))
    used = (share * F_x / peak) ** 2
    if hasattr(q.p, COMBINED_POWER):
        used = used * (used + NEXT_TO_NOTHING) ** (-0.5 * getattr(q.p, COMBINED_POWER))
    return cs.sqrt(remaining(used))


def _friction_of_loads(F_z: Symbol, static: Symbol, share: float, track: Symbol, q: Quantities) -> Symbol:
    """Friction of an axle relative to that of two wheels at their static load F_z0 of the stated mass.

    D_wheel = D (1 - k (F_z - F_z0) / F_z0), summed over left and right wheel, whose loads differ by twice the load
    transfer; a lifted wheel has no friction (smooth, see `remaining`).
    """
    transfer = share * q.p.m * q.before.a_y * q.p.h_cg / track
    apart = 1 - remaining((2 * transfer / F_z) ** 2)
    return 1 - q.p.load_sensitivity * ((1 + apart) * F_z / static - 1)


def _load_sensitive_f(grip: Symbol, q: Quantities) -> Symbol:
    static = q.stated.m * G * q.p.l_r / (q.p.l_f + q.p.l_r)
    return grip * _friction_of_loads(q.F_zf, static, FRONT_SHARE, q.p.track_f, q)


def _load_sensitive_r(grip: Symbol, q: Quantities) -> Symbol:
    static = q.stated.m * G * q.p.l_f / (q.p.l_f + q.p.l_r)
    return grip * _friction_of_loads(q.F_zr, static, 1 - FRONT_SHARE, q.p.track_r, q)


def _heating(q: Quantities) -> dict[str, Symbol]:
    """Friction work of both axles, W."""
    sliding = q.F_yf * cs.sin(q.alpha_f) + q.F_yr * cs.sin(q.alpha_r)
    return {"friction_work": sliding * forward_speed(speed(q))}


def _heated(grip: Symbol, q: Quantities) -> Symbol:
    warm = -cs.expm1(-q.x.friction_work / q.p.tyre_temperature_E_0)
    return grip * (1 - q.p.tyre_temperature * warm)


grip_scale = alteration(
    GROUP, "grip_scale", "1", 1.0, (0.1, 3.0), "factor on the friction of both axles",
    typical=0.85,
    grip_f=lambda grip, q: grip * q.p.grip_scale,
    grip_r=lambda grip, q: grip * q.p.grip_scale,
    stiffness_f=lambda stiffness, q: stiffness * _kept_slope(q),
    stiffness_r=lambda stiffness, q: stiffness * _kept_slope(q),
    road_limit=lambda limit, q: limit * q.p.grip_scale,
    others=(Parameter(
        "grip_scale_slope", "1", 1.0, (0.0, 1.0), fixed=True,
        about="exponent of grip_scale in the cornering stiffnesses: with 1 they scale like the friction, with 0 they "
              "do not change",
    ),),
)  # fmt: skip

front_stiffness = alteration(
    GROUP, "front_stiffness", "1", 1.0, (0.2, 4.0), "factor on the cornering stiffness of the front tyres",
    typical=0.85, stiffness_f=lambda stiffness, q: stiffness * q.p.front_stiffness,
)  # fmt: skip

rear_stiffness = alteration(
    GROUP, "rear_stiffness", "1", 1.0, (0.2, 4.0), "factor on the cornering stiffness of the rear tyres",
    typical=0.85, stiffness_r=lambda stiffness, q: stiffness * q.p.rear_stiffness,
)  # fmt: skip

tyre_relaxation = effect(
    GROUP, "tyre_relaxation", "m", 0.0, (0.0, 3.0), "relaxation length of the slip angle, both axles",
    touches=("alpha_f", "alpha_r"), typical=0.4, gradual=False,
    apply=lambda model: model.relaxed(
        lambda q: q.p.tyre_relaxation / forward_speed(speed(q)), "alpha_f", "alpha_r"
    ),
)  # fmt: skip

combined_slip = alteration(
    GROUP, "combined_slip", "1", 0.0, (0.0, 1.5),
    "how much longitudinal forces reduce lateral ones: 0 not at all, 1 by the friction ellipse",
    typical=0.6, gradual=False, needs=("F_xf", "F_xr", "peak_f", "peak_r"),
    F_yf=lambda F_y, q: F_y * _ellipse(q.F_xf, q.peak_f, q, 1),
    F_yr=lambda F_y, q: F_y * _ellipse(q.F_xr, q.peak_r, q, -1),
)  # fmt: skip

load_sensitivity = alteration(
    GROUP, "load_sensitivity", "1", 0.0, (0.0, 1.0), "relative loss of a wheel's friction per relative "
                                                     "increase of its load",
    typical=0.15, passes=3, needs=("F_zf", "F_zr", "a_y"), grip_f=_load_sensitive_f, grip_r=_load_sensitive_r,
)  # fmt: skip

tyre_temperature = effect(
    GROUP, "tyre_temperature", "1", 0.0, (-0.5, 0.8), "share of the friction that warm tyres lose",
    touches=("grip_f", "grip_r"), needs=("F_yf", "F_yr"), typical=0.2,
    apply=lambda model: model.with_states(_heating, State("friction_work", "J", 1e3)).altered(
        grip_f=_heated, grip_r=_heated
    ),
    others=(Parameter(
        "tyre_temperature_E_0", "J", 2e4, (1.0, 1e9), fixed=True, about="friction work that warms the tyres",
    ),),
)  # fmt: skip

ALL = (
    grip_scale, front_stiffness, rear_stiffness, tyre_relaxation, combined_slip, load_sensitivity, tyre_temperature,
)  # fmt: skip
