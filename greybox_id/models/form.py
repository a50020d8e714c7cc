"""What the form of a single track's equations leaves open, as numbers that a fit estimates along with a vehicle's.

Curves. A tyre's curve is known up to the error of its formula,

    F_y + F_peak sgn(alpha) sum_k curve_k w_k(phi),   phi = (2 / pi) atan(C_alpha |alpha| / F_peak)

w_k raised cosines at phi = 1/4, 1/2 and 3/4, where the slope alone would give 0.41, 1 and 2.4 of the peak. Slope and
force at large slip stay the formula's. A brush, a magic formula and Dugoff's tyre of one slope and one peak lie apart by
some 3 % of it between the two: a fit that takes one of them for exact is sure of numbers that the others do not have.

Two front wheels. The outer one bears more, is steered, drags on its side and turns the car back
(`roughness.steered_wheels`). It also runs faster: steered alike, it slips by delta^2 track / (2 L) more than the axle
does and the inner one by as much less, which steering geometry takes back as far as it is Ackermann's. Weighed by
loads, of which the transfer s m a_y h_cg / track leaves no track, the axle slips by delta^2 s m a_y h_cg / (L F_zf) more.

Sources: Kennedy & O'Hagan, Bayesian calibration of computer models, J. R. Statist. Soc. B 63, 2001 (model discrepancy);
Gillespie, Fundamentals of Vehicle Dynamics, 1992, ch. 6 and 8 (Ackermann geometry, load transfer).
"""

from __future__ import annotations

from dataclasses import replace

import casadi as cs

from ..model import Symbol
from ..motion_model import MotionModel, Quantities
from ..parameter import Parameter, Prior
from .effects.stating import speed
from .effects.tyres import FRONT_SHARE
from .roughness import TRACK_SD, steered_wheels
from .single_track import G
from .tyres import Tyre, axle
from .tyres.tyre import LEAST_FORCE

CURVE_SD = 0.03
"""Standard deviation of a curve's error over its peak: what the formulas of `TYRES` differ by (a test says so)."""
CENTRES = {"small": 0.25, "middle": 0.5, "large": 0.75}
WIDTH = 0.25
"""In phi; half of a raised cosine's foot, so that neighbours add up to one."""


def with_form_error(model: MotionModel, tyre: Tyre) -> MotionModel:
    """The model with the error of its form, each number of it with a prior about none.

    Parameters
    ----------
    model : `single_track` or `lateral`.
    tyre : that it stands on; its force has a peak.
    """
    def erring(suffix: str, force: Symbol, q: Quantities) -> Symbol:
        alpha, F_z, peak, stiffness = (
            getattr(q, name) for name in (f"alpha_{suffix}", f"F_z{suffix}", f"peak_{suffix}", f"stiffness_{suffix}")
        )
        linear = tyre.slope(F_z, axle(q.p, suffix)) * stiffness * cs.fabs(alpha) / cs.fmax(peak, LEAST_FORCE)
        phi = 2 / cs.pi * cs.atan(linear)
        error = sum(getattr(q.p, f"curve_{k}_{suffix}") * _raised_cosine(phi, at) for k, at in CENTRES.items())
        return force + peak * cs.sign(alpha) * error

    def outer_slip(alpha: Symbol, q: Quantities) -> Symbol:
        across = q.p.m * speed(q) * q.x.yaw_rate  # a_y as in a steady turn: its own would ask for itself
        transfer = FRONT_SHARE * across * q.p.h_cg / (q.p.m * G * q.p.l_r)  # over F_zf = m g l_r / L, and over L
        return alpha + q.p.parallel_steering * q.u.steer**2 * transfer

    curves = [
        Parameter(
            f"curve_{k}_{suffix}", "1", 0.0, (-0.3, 0.3), prior=Prior(CURVE_SD),
            about=f"error of the curve's form at {k} slip, {where}",
        )
        for suffix, where in (("f", "front"), ("r", "rear")) for k in CENTRES
    ]  # fmt: skip
    parallel = Parameter(
        "parallel_steering", "1", 0.0, (0.0, 2.0), prior=Prior(TRACK_SD),
        about="share of the outer front wheel's slip that parallel steering leaves",
    )  # fmt: skip
    wheels = steered_wheels()
    own = model.with_parameters(*curves, wheels.parameter, parallel).altered(
        alpha_f=outer_slip, F_yf=lambda force, q: erring("f", force, q), F_yr=lambda force, q: erring("r", force, q),
    )  # fmt: skip
    assert wheels.apply is not None
    return replace(wheels.apply(own), settings={**model.settings, "form": "uncertain"})


def _raised_cosine(phi: Symbol, centre: float) -> Symbol:
    return 0.5 + 0.5 * cs.cos(cs.pi * cs.fmin(cs.fabs(phi - centre) / WIDTH, 1))
