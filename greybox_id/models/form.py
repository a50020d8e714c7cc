"""What the form of a single track's equations leaves open, as numbers that a fit estimates along with a vehicle's.

Curves. A tyre's curve is known up to the error of its formula,

    F_y + F_z sgn(alpha) sum_k curve_k (w_k(phi) - what of w_k another slope or peak would make)
    phi = (2 / pi) atan(|alpha| / curve_slip)

w_k raised cosines at phi = k / 6, from 0.27 to 3.7 of the slip at which the slope alone would give the peak. That is
held as it is stated: in units of an estimated peak, one out of reach would excuse any form. A brush, a magic formula
and Dugoff's tyre of one slope and peak lie apart by some 3 % of the peak: a fit that takes one of them for exact is
sure of numbers that others do not have. What slope and peak are of a tyre that has another form is then a matter of
definition: those of the formula that comes nearest to its curve, where every share of the friction counts alike. So
errors are orthogonal to what slope and peak do: what these stand for is told by drives that use all of the friction,
whatever the form, and by no others.

Two front wheels. The outer one bears more by 2 s m a_y h_cg / track, is steered, drags on its side and turns the car
back (`roughness.steered_wheels`). It runs faster, so that it slips by (delta - alpha) track / (2 R) more than the axle,
R the radius of the turn, and Ackermann's geometry steers it by delta^2 track / (2 L) less; the inner wheel the other
way round. Weighed by loads, of which the transfer leaves no track, the axle slips more by

    steered_wheels ((delta - alpha) / R - ackermann delta^2 / L) s m a_y h_cg / F_zf

Sources: Kennedy & O'Hagan, Bayesian calibration of computer models, J. R. Statist. Soc. B 63, 2001 (model discrepancy);
Plumlee, Bayesian calibration of inexact computer models, J. Am. Statist. Assoc. 112, 2017 (orthogonal to parameters);
Gillespie, Fundamentals of Vehicle Dynamics, 1992, ch. 6 and 8 (Ackermann geometry, load transfer).
"""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from math import pi, tan

import casadi as cs
import numpy as np

from ..model import Symbol
from ..motion_model import MotionModel, Quantities
from ..parameter import Array, Parameter, Prior
from .effects.stating import speed
from .effects.tyres import FRONT_SHARE
from .roughness import TRACK_SD, steered_wheels
from .single_track import G
from .smooth import forward_speed
from .tyres import AXLES

CURVE_SD = 0.03
"""Standard deviation of a curve's error over the load, friction being near one: what formulas of `TYRES` differ by."""
KNOTS = 7
"""With three, four and five, fits of designed drives held 80, 89 and 95 % of I_z, B and D (11 virtual vehicles of other
forms, seeds 7301 to 7311 of development; before errors were orthogonal to slope and peak, D being the curve's peak)."""
SHAPE = 1.4
"""C of the magic formula to whose directions errors are orthogonal: that of a usual car's tyre."""
SHARES = 200
"""Of the friction, evenly from none to all."""
HALFWAY = 0.5
"""Prior mean of both numbers of the front wheels: between none of it and all."""
_NUMBERS = range(1, KNOTS + 1)


def with_form_error(model: MotionModel) -> MotionModel:
    """The model with the error of its form, each number of it with a prior about none.

    Parameters
    ----------
    model : `single_track` or `lateral`, on a tyre whose force has a peak.
    """

    def erring(suffix: str, force: Symbol, q: Quantities) -> Symbol:
        alpha, grip = getattr(q, f"alpha_{suffix}"), getattr(q, f"grip_{suffix}")
        slip = cs.fabs(alpha) / getattr(q.p, f"curve_slip_{suffix}")
        sizes = cs.vertcat(*(getattr(q.p, f"curve_{k}_{suffix}") for k in _NUMBERS))
        error = cs.dot(
            sizes, cs.vertcat(*_bumps(slip)) - cs.mtimes(cs.DM(_stood_for()), cs.vertcat(*_directions(slip)))
        )
        return force + grip * getattr(q, f"F_z{suffix}") * cs.sign(alpha) * error

    def outer_front(alpha: Symbol, q: Quantities) -> Symbol:
        L = q.p.l_f + q.p.l_r
        more = (q.u.steer - alpha) * q.x.yaw_rate / forward_speed(speed(q)) - q.p.ackermann * q.u.steer**2 / L
        return alpha + more * transfer(FRONT_SHARE, q.p.l_r, q)

    def outer_rear(alpha: Symbol, q: Quantities) -> Symbol:
        return alpha - alpha * q.x.yaw_rate / forward_speed(speed(q)) * transfer(1 - FRONT_SHARE, q.p.l_f, q)

    def transfer(share: float, other: Symbol, q: Quantities) -> Symbol:
        across = speed(q) * q.x.yaw_rate  # as in a steady turn: a_y itself would ask for this slip
        return q.p.steered_wheels * share * across * q.p.h_cg * (q.p.l_f + q.p.l_r) / (G * other)

    slips = [
        Parameter(
            f"curve_slip_{suffix}", "rad", 0.08, (1e-3, 1.0), fixed=True,
            about=f"slip at which the slope alone would give the peak, {where}",
        )
        for suffix, where in AXLES.items()
    ]  # fmt: skip
    curves = [
        Parameter(
            f"curve_{k}_{suffix}", "1", 0.0, (-0.3, 0.3), prior=Prior(CURVE_SD),
            about=f"error of the curve's form about {tan(pi * k / (2 * KNOTS + 2)):.2g} curve_slip_{suffix}, {where}",
        )
        for suffix, where in AXLES.items() for k in _NUMBERS
    ]  # fmt: skip
    ackermann = Parameter(
        "ackermann", "1", HALFWAY, (-1.0, 2.0), prior=Prior(TRACK_SD, mean=HALFWAY),
        about="steering geometry, from parallel to Ackermann's",
    )  # fmt: skip
    wheels = steered_wheels()
    moment = replace(wheels.parameter, value=1.0, prior=Prior(TRACK_SD, mean=1.0))
    own = model.with_parameters(*slips, *curves, moment, ackermann).altered(
        alpha_f=outer_front, alpha_r=outer_rear, F_yf=lambda force, q: erring("f", force, q), F_yr=lambda force, q: erring("r", force, q),
    )  # fmt: skip
    assert wheels.apply is not None
    return replace(wheels.apply(own), settings={**model.settings, "form": "uncertain"})


def _bumps(slip: Symbol) -> list[Symbol]:
    """Raised cosines over slip, each zero where its neighbours are one."""
    phi = 2 / pi * cs.atan(slip) * (KNOTS + 1)
    return [0.5 + 0.5 * cs.cos(pi * cs.fmin(cs.fabs(phi - k), 1)) for k in _NUMBERS]


def _directions(slip: Symbol) -> list[Symbol]:
    """What a relative change of the peak alone and of the slope make of a magic formula of shape `SHAPE`."""
    angle = SHAPE * cs.atan(slip / SHAPE)
    return [cs.sin(angle), slip * cs.cos(angle) / (1 + (slip / SHAPE) ** 2)]


@cache
def _stood_for() -> Array:
    """(KNOTS, 2) how much of each direction is in each bump, where every share of the friction counts alike."""
    shares = (np.arange(SHARES) + 0.5) / SHARES
    slips = SHAPE * np.tan(np.arcsin(shares) / SHAPE)
    bumps, ways = (np.array(cs.horzcat(*own(cs.DM(slips)))) for own in (_bumps, _directions))
    return np.asarray(np.linalg.lstsq(ways, bumps, rcond=None)[0].T)
