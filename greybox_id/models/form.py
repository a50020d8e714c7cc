"""Model error of the single-track equations' form, as parameters that a fit estimates along with a vehicle's.

Curves. A tyre's curve is known up to the error of its formula,

    F_y + F_z sgn(alpha) sum_k curve_k (w_k(phi) - projection of w_k on changes of slope and peak)
    phi = (2 / pi) atan(|alpha| / curve_slip)

w_k are raised cosines at phi = k / 8, from 0.2 to 5 of curve_slip, the slip at which the slope alone would give the
peak. curve_slip is held as stated: in units of an estimated peak, a peak out of reach would excuse any form. A brush, a
magic formula and Dugoff's tyre of the same slope and peak differ by some 3 % of the peak: a fit that takes one of them
as exact is overconfident. Slope and peak of a tyre of another form are then a matter of definition: those of the
formula closest to its curve, with equal weight on every share of the friction. So the errors are orthogonal to changes
of slope and peak, which only drives that use all of the friction identify, whatever the form.

Four wheels. The outer wheels carry 2 s m a_y h_cg / track more, s the axle's share; they run faster, by
yaw_rate track / 2, and Ackermann's geometry steers the front one by delta^2 track / (2 L) less. Slip and direction of
an axle are the means of its two wheels weighted by loads: a hundredth of a radian in a force's direction shows in the
speed after seconds. The steered outer front wheel drags on its side and turns the car back. `steered_wheels`, a factor
on the tracks, is about one, uncertain like the shares of load transfer; `ackermann` lies between parallel and
Ackermann's geometry. Wheels have inertia against acceleration (`turning_wheels`, mass over the vehicle's) at half a
track from the middle: yaw meets 1 to 3 % more than the body's inertia. The same holds along the vehicle, but forces
stated from acceleration runs already include it.

Sources: Kennedy & O'Hagan, Bayesian calibration of computer models, J. R. Statist. Soc. B 63, 2001 (model discrepancy);
Plumlee, Bayesian calibration of inexact computer models, J. Am. Statist. Assoc. 112, 2017 (orthogonal to parameters);
Gillespie, Fundamentals of Vehicle Dynamics, 1992, ch. 2, 6 and 8 (mass factor, Ackermann geometry, load transfer).
"""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from math import pi, tan

import casadi as cs
import numpy as np

from ..base.shorthands import Array
from .effects.stating import speed
from .effects.tyres import FRONT_SHARE
from .model import Symbol
from .motion_model import MotionModel, Quantities
from .parameter import Parameter, Prior
from .roughness import TRACK_SD, steered_wheels
from .single_track import G
from .smooth import forward_speed
from .tyres import AXLES

CURVE_SD = 0.03
"""Standard deviation of a curve's error over the load, for friction near one: the spread of the formulas in `TYRES`."""
KNOTS = 7
"""Number of w_k. With five, the error of representing a brush tyre's curve exceeds the noise: fits of curves up to 70,
80 and 90 % of the friction bias B by 2.1, 1.4 and 1.6 standard deviations, with seven by 1.7, 1.0 and 0.2, with nine by
1.4, 0.8 and 0.6 (root mean square; curves of vehicles of seeds 7600 to 7629, of development, to 0.2 % of the load)."""
SHAPE = 1.4
"""C of the magic formula whose directions the errors are orthogonal to: that of a usual car's tyre."""
SHARES = 200
"""Number of shares of the friction, evenly spaced from none to all, in the projection."""
HALFWAY = 0.5
"""Prior mean of the steering geometry: between parallel and Ackermann's."""
WHEELS, WHEELS_SD = 0.04, 0.02
"""Prior of the wheels' equivalent mass over the vehicle's: usual for a car whose engine is not coupled."""
_NUMBERS = range(1, KNOTS + 1)


def with_form_error(model: MotionModel) -> MotionModel:
    """The model with the error of its form, whose parameters have priors centred on no error.

    Parameters
    ----------
    model : `single_track` or `lateral`, with a tyre whose force has a peak.
    """

    def erring(suffix: str, force: Symbol, q: Quantities) -> Symbol:
        alpha, grip = getattr(q, f"alpha_{suffix}"), getattr(q, f"grip_{suffix}")
        slip = cs.fabs(alpha) / getattr(q.p, f"curve_slip_{suffix}")
        sizes = cs.vertcat(*(getattr(q.p, f"curve_{k}_{suffix}") for k in _NUMBERS))
        error = cs.dot(
            sizes, cs.vertcat(*_bumps(slip)) - cs.mtimes(cs.DM(_stood_for()), cs.vertcat(*_directions(slip)))
        )
        return force + grip * getattr(q, f"F_z{suffix}") * cs.sign(alpha) * error

    def transfer(suffix: str, across: Symbol, q: Quantities) -> Symbol:
        """Load of the right wheel less that of the left one, over the axle's load."""
        share, other = (FRONT_SHARE, q.p.l_r) if suffix == "f" else (1 - FRONT_SHARE, q.p.l_f)
        moment = share * across * q.p.h_cg * (q.p.l_f + q.p.l_r) / (G * other)
        return cs.fmin(cs.fmax(2 * moment / getattr(q.p, f"track_{suffix}"), -1), 1)

    def toed(steer: Symbol, q: Quantities) -> Symbol:
        more = transfer("f", speed(q) * q.x.yaw_rate, q)
        return steer - 0.5 * more * q.p.steered_wheels * q.p.track_f * q.p.ackermann * steer**2 / (q.p.l_f + q.p.l_r)

    def weighed(suffix: str, alpha: Symbol, q: Quantities) -> Symbol:
        x, v = (q.p.l_f if suffix == "f" else -q.p.l_r), speed(q)
        w, more = q.x.v_y + x * q.x.yaw_rate, transfer(suffix, v * q.x.yaw_rate, q)
        for side in (1.0, -1.0):
            y = 0.5 * side * q.p.steered_wheels * getattr(q.p, f"track_{suffix}")
            value = cs.atan2(w, forward_speed(v)) - cs.atan2(w, forward_speed(v - y * q.x.yaw_rate))
            alpha = alpha + 0.5 * (1 - side * more) * value
        return alpha

    def turned_back(M_z: Symbol, q: Quantities) -> Symbol:
        more, half = transfer("f", (q.F_yf + q.F_yr) / q.p.m, q), 0.5 * q.p.steered_wheels * q.p.track_f
        toe = half * q.p.ackermann * q.u.steer**2 / (q.p.l_f + q.p.l_r)
        left, right = 0.5 * (1 - more) * cs.sin(q.u.steer + toe), 0.5 * (1 + more) * cs.sin(q.u.steer - toe)
        inertia = q.p.turning_wheels * q.p.m * q.p.track_f * q.p.track_r / 4
        return (M_z + half * q.F_yf * (left - right)) / (1 + inertia / q.p.I_z)

    slips = [
        Parameter(
            f"curve_slip_{suffix}", "rad", 0.08, (1e-3, 1.0), fixed=True,
            about=f"slip at which a straight line with the slope at zero slip would reach the peak, {where}",
        )
        for suffix, where in AXLES.items()
    ]  # fmt: skip
    curves = [
        Parameter(
            f"curve_{k}_{suffix}", "1", 0.0, (-0.3, 0.3), prior=Prior(CURVE_SD),
            about=f"error of the tyre curve at a slip of about {tan(pi * k / (2 * KNOTS + 2)):.2g} times "
                  f"curve_slip_{suffix}, {where}",
        )
        for suffix, where in AXLES.items() for k in _NUMBERS
    ]  # fmt: skip
    ackermann = Parameter(
        "ackermann", "1", HALFWAY, (-1.0, 2.0), prior=Prior(TRACK_SD, mean=HALFWAY),
        about="steering geometry, from parallel to Ackermann's",
    )  # fmt: skip
    wheels = replace(steered_wheels().parameter, value=1.0, prior=Prior(TRACK_SD, mean=1.0))
    turning = Parameter(
        "turning_wheels",
        "1",
        WHEELS,
        (0.0, 0.5),
        prior=Prior(WHEELS_SD),
        about="share of the mass which, half a track from the middle, would have the additional yaw inertia of the "
        "wheels",
    )
    value = model.with_parameters(*slips, *curves, wheels, ackermann, turning).altered(
        steer=toed, alpha_f=lambda alpha, q: weighed("f", alpha, q), alpha_r=lambda alpha, q: weighed("r", alpha, q),
        F_yf=lambda force, q: erring("f", force, q), F_yr=lambda force, q: erring("r", force, q), M_z=turned_back,
    )  # fmt: skip
    return replace(value, settings={**model.settings, "form": "uncertain"})


def _bumps(slip: Symbol) -> list[Symbol]:
    """Raised cosines over slip, each zero at the maxima of its neighbours."""
    phi = 2 / pi * cs.atan(slip) * (KNOTS + 1)
    return [0.5 + 0.5 * cs.cos(pi * cs.fmin(cs.fabs(phi - k), 1)) for k in _NUMBERS]


def _directions(slip: Symbol) -> list[Symbol]:
    """Changes of a magic formula of shape `SHAPE` by a relative change of the peak alone, and of the slope."""
    angle = SHAPE * cs.atan(slip / SHAPE)
    return [cs.sin(angle), slip * cs.cos(angle) / (1 + (slip / SHAPE) ** 2)]


@cache
def _stood_for() -> Array:
    """(KNOTS, 2) projection of each bump on the directions, with equal weight on every share of the friction."""
    shares = (np.arange(SHARES) + 0.5) / SHARES
    slips = SHAPE * np.tan(np.arcsin(shares) / SHAPE)
    bumps, ways = (np.array(cs.horzcat(*item(cs.DM(slips)))) for item in (_bumps, _directions))
    return np.asarray(np.linalg.lstsq(ways, bumps, rcond=None)[0].T)
