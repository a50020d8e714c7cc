"""Tyre curves: lateral force over load, by slip angle, with what the fit leaves open and where tyres were driven."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from ...combined import combined
from ...fit import Fit
from ...model import Combination, Namespace
from ...parameter import Array
from ..motion.driven import Driven, motion_model, typical_speed
from ..motion.settled import OverSlip
from .style import BLUE, PALE, canvas, look

AXLES = {"f": "front", "r": "rear"}
POINTS = 61
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
    slips = {axle: np.concatenate([one.quantities[f"alpha_{axle}"] for one in recordings]) for axle in AXLES}
    speed = typical_speed(recordings)
    with look():
        figure = canvas(3.1)
        panels = figure.subplots(2, 2, sharex="col", sharey="row", height_ratios=[3.0, 1.0])
        top = 0.0
        for (axle, where), (above, below) in zip(AXLES.items(), panels.T, strict=True):
            slip = slips[axle]
            reach = max(
                BEYOND * float(np.max(np.abs(np.quantile(slip, DRIVEN)), initial=0.0)) if len(slip) else 0.0, LEAST
            )
            angles = np.linspace(-reach, reach, POINTS)
            share, low, high = band(fit, OverSlip(motion_model(fit), axle, speed), angles)
            top = max(top, float(np.max(np.abs(share))))
            inside = np.zeros(len(angles), dtype=bool)
            if len(slip):
                ends = np.quantile(slip, DRIVEN)
                inside = (angles >= ends[0]) & (angles <= ends[1])
                below.hist(slip, bins=60, range=(-reach, reach), density=True, color=PALE)
            _curve(above, angles, share, low, high, inside)
            above.set_title(f"{where} axle")
            below.xaxis.set_major_locator(MaxNLocator(6))
            below.set_xlabel(f"slip angle $\\alpha_{axle}$ [rad]")
        panels[0, 0].set_ylim(
            *(
                sign * min(ROOM * top, 1.05 * abs(end))
                for sign, end in zip((-1, 1), panels[0, 0].get_ylim(), strict=True)
            )
        )
        panels[0, 0].set_ylabel("$F_y/F_z$ [1]")
        panels[1, 0].set_ylabel("density [1/rad]")
        figure.align_ylabels()
        handles, said = panels[0, 0].get_legend_handles_labels()
        figure.legend(handles[::-1], said[::-1], loc="outside upper center", ncols=3)
    return figure


def _curve(axes: Axes, angles: Array, share: Array, low: Array, high: Array, inside: Array) -> None:
    axes.fill_between(angles, low, high, color="#bcdcee", linewidth=0, label="95 % band")
    axes.plot(angles, share, color=BLUE, linewidth=0.7, label="fit, beyond")
    axes.plot(angles, np.where(inside, share, np.nan), color=BLUE, linewidth=1.9, label="fit, where driven")


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
