"""Tyre curves: lateral force over load, by slip angle, with what the fit leaves open and where tyres were driven."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial

import numpy as np
from matplotlib.axes import Axes

from ...combined import combined
from ...fit import Fit
from ...model import Combination, Namespace
from ...parameter import Array
from ..driven import Driven, motion_model, typical_speed
from ..settled import OverSlip
from .sheet import Sheet, band
from .style import BLUE, PALE, ZERO, Look, look

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


def tyres(fit: Fit, recordings: Sequence[Driven]) -> Sheet | None:
    """Both axles' curves with bands of 95 %, over the density of the slip angles driven; None for other models."""
    if not has_tyres(fit):
        return None
    speed = typical_speed(recordings)
    beyond = look(BLUE, 0.7, "fit, beyond")
    sheet, top, reached = Sheet((120.0, 40.0), len(AXLES), joined=True), 0.0, 0.0
    for (above, below), (axle, where) in zip(sheet.grid.T, AXLES.items(), strict=True):
        slip = np.concatenate([one.quantities[f"alpha_{axle}"] for one in recordings])
        ends = np.quantile(slip, DRIVEN) if len(slip) else np.zeros(2)
        reach = max(BEYOND * float(np.max(np.abs(ends))), LEAST)
        angles = np.linspace(-reach, reach, POINTS)
        above.axhline(0.0, **ZERO)
        share, low, high = draw_tyre(above, fit, OverSlip(motion_model(fit), axle, speed), angles, beyond, "95 % band")
        inside = (angles >= ends[0]) & (angles <= ends[1]) if len(slip) else np.zeros(len(angles), dtype=bool)
        above.plot(angles, np.where(inside, share, np.nan), **look(BLUE, 2.0, "fit, where driven"))
        top = max(top, float(np.max(np.abs(share))))
        reached = max(reached, float(np.nanmax(np.abs([share, low, high]))))
        counts, edges = np.histogram(slip, bins=60, range=(-reach, reach), density=len(slip) > 0)
        below.stairs(counts, edges, fill=True, color=PALE)
        above.set_title(f"{where} axle")
        below.set(xlabel=f"slip angle alpha_{axle} [rad]", xlim=(-reach, reach), ylabel="density [1/rad]")
        below.set_ylim(bottom=0.0)
    end = min(ROOM * top, 1.05 * reached) or 1.0
    for above in sheet.grid[0]:
        above.set(ylabel="F_y / F_z [1]", ylim=(-end, end))
    return sheet


def draw_tyre(
    ax: Axes, fit: Fit, curve: OverSlip, angles: Array, line: Look, words: str | None = None
) -> tuple[Array, Array, Array]:
    """Draw a curve with its 95 % band, which `words` name, and return them."""
    share, low, high = share_with_band(fit, curve, angles)
    band(ax, angles, low, high, line["color"], words)
    ax.plot(angles, share, **line)
    return share, low, high


def share_with_band(fit: Fit, curve: OverSlip, angles: Array) -> tuple[Array, Array, Array]:
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
