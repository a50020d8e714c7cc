"""What the form of a single track's equations leaves open, as numbers that a fit estimates along with a vehicle's.

Curves. A tyre's curve is known up to the error of its formula,

    F_y + F_z sgn(alpha) sum_k curve_k w_k(phi),   phi = (2 / pi) atan(|alpha| / curve_slip)

w_k raised cosines at phi = k / 6, from 0.27 to 3.7 of the slip at which the slope alone would give the peak. That is
held as it is stated: in units of an estimated peak, one out of reach would excuse any form. The slope and the force at
large slip stay the formula's. A brush, a magic formula and Dugoff's tyre of one slope and peak lie apart by some 3 % of
the peak between them: a fit that takes one of them for exact is sure of numbers that others do not have.

Two front wheels. The outer one bears more, is steered, drags on its side and turns the car back
(`roughness.steered_wheels`). It also runs faster: steered alike, it slips by delta^2 track / (2 L) more than the axle
does and the inner one by as much less, which steering geometry takes back as far as it is Ackermann's. Weighed by
loads, of which the transfer s m a_y h_cg / track leaves no track, the axle slips delta^2 s m a_y h_cg / (L F_zf) more.

Sources: Kennedy & O'Hagan, Bayesian calibration of computer models, J. R. Statist. Soc. B 63, 2001 (model discrepancy);
Gillespie, Fundamentals of Vehicle Dynamics, 1992, ch. 6 and 8 (Ackermann geometry, load transfer).
"""

from __future__ import annotations

from dataclasses import replace
from math import pi, tan

import casadi as cs

from ..model import Symbol
from ..motion_model import MotionModel, Quantities
from ..parameter import Parameter, Prior
from .effects.stating import speed
from .effects.tyres import FRONT_SHARE
from .roughness import TRACK_SD, steered_wheels
from .single_track import G

AXLES = (("f", "front"), ("r", "rear"))
CURVE_SD = 0.03
"""Standard deviation of a curve's error over the load, friction being near one: what formulas of `TYRES` differ by."""
KNOTS = 5
"""With three or four, among which there is no brush, fits of drives that use 0.8 of the friction held the peak in 73 to
91 %, with five in 100 % (11 virtual vehicles of other forms, seeds 7301 to 7311 of development)."""
_NUMBERS = range(1, KNOTS + 1)


def with_form_error(model: MotionModel) -> MotionModel:
    """The model with the error of its form, each number of it with a prior about none.

    Parameters
    ----------
    model : `single_track` or `lateral`, on a tyre whose force has a peak.
    """

    def erring(suffix: str, force: Symbol, q: Quantities) -> Symbol:
        alpha, grip = getattr(q, f"alpha_{suffix}"), getattr(q, f"grip_{suffix}")
        phi = 2 / cs.pi * cs.atan(cs.fabs(alpha) / getattr(q.p, f"curve_slip_{suffix}"))
        error = sum(getattr(q.p, f"curve_{k}_{suffix}") * _raised_cosine(phi * (KNOTS + 1) - k) for k in _NUMBERS)
        return force + grip * getattr(q, f"F_z{suffix}") * cs.sign(alpha) * error

    def outer_slip(alpha: Symbol, q: Quantities) -> Symbol:
        across = q.p.m * speed(q) * q.x.yaw_rate  # a_y as in a steady turn: its own would ask for itself
        transfer = FRONT_SHARE * across * q.p.h_cg / (q.p.m * G * q.p.l_r)  # over F_zf = m g l_r / L, and over L
        return alpha + q.p.parallel_steering * q.u.steer**2 * transfer

    slips = [
        Parameter(
            f"curve_slip_{suffix}", "rad", 0.08, (1e-3, 1.0), fixed=True,
            about=f"slip at which the slope alone would give the peak, {where}",
        )
        for suffix, where in AXLES
    ]  # fmt: skip
    curves = [
        Parameter(
            f"curve_{k}_{suffix}", "1", 0.0, (-0.3, 0.3), prior=Prior(CURVE_SD),
            about=f"error of the curve's form about {tan(pi * k / (2 * KNOTS + 2)):.2g} curve_slip_{suffix}, {where}",
        )
        for suffix, where in AXLES for k in _NUMBERS
    ]  # fmt: skip
    parallel = Parameter(
        "parallel_steering", "1", 0.0, (0.0, 2.0), prior=Prior(TRACK_SD),
        about="share of the outer front wheel's slip that parallel steering leaves",
    )  # fmt: skip
    wheels = steered_wheels()
    own = model.with_parameters(*slips, *curves, wheels.parameter, parallel).altered(
        alpha_f=outer_slip, F_yf=lambda force, q: erring("f", force, q), F_yr=lambda force, q: erring("r", force, q),
    )  # fmt: skip
    assert wheels.apply is not None
    return replace(wheels.apply(own), settings={**model.settings, "form": "uncertain"})


def _raised_cosine(off: Symbol) -> Symbol:
    """One at its centre, zero at its neighbours' centres and beyond."""
    return 0.5 + 0.5 * cs.cos(cs.pi * cs.fmin(cs.fabs(off), 1))
