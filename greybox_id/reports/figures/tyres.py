"""Tyre curves: lateral force over load, by slip angle, with what the fit leaves open and where tyres were driven."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial

import numpy as np

from ...combined import combined
from ...fit import Fit
from ...model import Combination, Namespace
from ...parameter import Array
from ..motion.driven import Driven, motion_model, typical_speed
from ..motion.settled import OverSlip
from ..plot.areas import Bars
from ..plot.figure import Figure, Panel
from ..plot.marks import Band, Curve, Mark, Rule
from ..plot.palette import BLUE, Line
from ..plot.scale import Axis

AXLES = {"f": "front", "r": "rear"}
POINTS = 41
BEYOND = 1.4
"""Curves reach so many times as far as the slip angles driven."""
LEAST = 0.02
"""Slip angle, rad, that curves reach at least."""
DRIVEN = (0.005, 0.995)
"""Quantiles of the slip angles driven, between which curves are drawn thick."""
ROOM = 2.0
"""The axis ends at so many times the curves' largest value at most: the band may be wide where nothing was driven."""


def has_tyres(fit: Fit) -> bool:
    """Whether a model has axles with slip angles, lateral forces and loads."""
    wanted = [f"{quantity}{axle}" for quantity in ("alpha_", "F_y", "F_z") for axle in AXLES]
    return set(wanted) <= set(motion_model(fit).quantities)


def tyres(fit: Fit, recordings: Sequence[Driven]) -> Figure | None:
    """Both axles' curves with bands of 95 %, over the density of the slip angles driven; None for other models."""
    if not has_tyres(fit):
        return None
    speed = typical_speed(recordings)
    above, below, top = [], [], 0.0
    for axle, where in AXLES.items():
        slip = np.concatenate([one.quantities[f"alpha_{axle}"] for one in recordings])
        ends = np.quantile(slip, DRIVEN) if len(slip) else np.zeros(2)
        reach = max(BEYOND * float(np.max(np.abs(ends))), LEAST)
        angles = np.linspace(-reach, reach, POINTS)
        share, low, high = band(fit, OverSlip(motion_model(fit), axle, speed), angles)
        top = max(top, float(np.max(np.abs(share))))
        inside = (angles >= ends[0]) & (angles <= ends[1]) if len(slip) else np.zeros(len(angles), dtype=bool)
        above.append((where, _curves(angles, share, low, high, inside)))
        counts, edges = np.histogram(slip, bins=60, range=(-reach, reach), density=len(slip) > 0)
        x = Axis(f"slip angle alpha_{axle} [rad]", -reach, reach)
        below.append(Panel((Bars(edges[:-1], edges[1:], counts),), x, Axis("density [1/rad]", low=0.0)))
    reached = [np.nanmax(np.abs(mark.reach[1]), initial=top) for _, marks in above for mark in marks]
    end = min(ROOM * top, 1.05 * max(float(own) for own in reached)) or 1.0
    y = Axis("F_y / F_z [1]", -end, end)
    upper = tuple(Panel(marks, own.x, y, f"{where} axle") for (where, marks), own in zip(above, below, strict=True))
    return Figure((upper, tuple(below)), (120.0, 40.0), joined=True)


def _curves(angles: Array, share: Array, low: Array, high: Array, inside: Array) -> tuple[Mark, ...]:
    return (
        Band(angles, low, high, words="95 % band"),
        Rule(0.0),
        Curve(angles, share, Line(BLUE, width=0.7, words="fit, beyond")),
        Curve(angles, np.where(inside, share, np.nan), Line(BLUE, width=2.0, words="fit, where driven")),
    )


def band(fit: Fit, curve: OverSlip, angles: Array) -> tuple[Array, Array, Array]:
    """A curve at the estimates, and the ends of its 95 % band, to first order; NaN where no covariance was kept."""
    model = fit.model
    names = [p.name for p in model.parameters]
    share = curve(angles, model.values)
    if fit.covariance is None:
        nothing = np.full(len(angles), np.nan)
        return share, nothing, nothing
    told = []
    for angle in angles:
        at = Combination("F_y / F_z", "1", partial(_share, curve, angle, names))
        told.append(combined(at, model, fit.covariance, fit.dof))
    return share, np.array([one.low for one in told]), np.array([one.high for one in told])


def _share(curve: OverSlip, angle: float, names: Sequence[str], p: Namespace) -> float:
    return float(curve(np.array([angle]), np.array([getattr(p, name) for name in names]))[0])
