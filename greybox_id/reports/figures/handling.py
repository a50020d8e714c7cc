"""Handling diagram: the steering angle beyond what the path's curvature needs, over lateral acceleration."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator

from ...fit import Fit
from ...parameter import Array
from ..motion.driven import MOVING, Driven, motion_model, typical_speed
from ..motion.settled import steady_turns
from .style import BLUE, DENSITY, INK, canvas, look

POINTS = 81
SEEN, SHOWN = (0.005, 0.995), (0.01, 0.99)
"""Quantiles of what was driven: the curve is thick between the first, the axes end at the second."""


def handling(fit: Fit, recordings: Sequence[Driven]) -> Figure | None:
    """The model's steady turns over the density of what was measured; None for models that do not steer.

    The wheelbase is that of the fit.
    """
    model = motion_model(fit)
    if not ("steer" in model.inputs and "yaw_rate" in model.outputs and "l_f" in model and "l_r" in model):
        return None
    L = float(model["l_f"].array + model["l_r"].array)
    steer, v_x, yaw_rate = _measured(recordings)
    speed = typical_speed(recordings)
    reach = float(np.quantile(np.abs(steer), SEEN[1])) * 1.2 if len(steer) else 0.3
    sides = [np.linspace(0.0, side * reach, POINTS) for side in (1.0, -1.0)]
    turns = [steady_turns(model, angles, speed) for angles in sides]
    if any(turn is None for turn in turns):
        return None
    angles = np.concatenate([sides[1][:0:-1], sides[0]])
    rate = np.concatenate([turns[1][:0:-1], turns[0]])  # type: ignore[index]
    beyond, a_y = angles - L * rate / speed, rate * speed
    with look():
        figure = canvas(2.3)
        axes = figure.subplots()
        if len(steer):
            measured, need = yaw_rate * v_x, steer - L * yaw_rate / v_x
            shown = (*np.quantile(measured, SHOWN), *np.quantile(need, SHOWN))
            cells = axes.hexbin(
                measured, need, gridsize=(60, 34), bins="log", mincnt=1, cmap=DENSITY, linewidths=0.1, extent=shown
            )
            bar = figure.colorbar(cells, ax=axes, pad=0.02)
            bar.ax.yaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
            bar.ax.yaxis.set_major_formatter("{x:g}")
            bar.ax.yaxis.set_minor_formatter("")
            bar.set_label("samples per cell [1]")
            bar.outline.set_visible(False)
        ends = np.quantile(yaw_rate * v_x, SEEN) if len(steer) else np.zeros(2)
        inside = (a_y >= ends[0]) & (a_y <= ends[1])
        axes.axhline(0.0, color=INK, linewidth=0.6)
        axes.plot(a_y, beyond, color=BLUE, linewidth=0.7)
        axes.plot(np.where(inside, a_y, np.nan), beyond, color=BLUE, linewidth=1.9, label=f"model at {speed:.3g} m/s")
        axes.set_xlabel("lateral acceleration $v_x$ · yaw rate [m/s²]")
        axes.set_ylabel("steer − $L$ · curvature [rad]")
        axes.legend(loc="upper left")
    return figure


def _measured(recordings: Sequence[Driven]) -> tuple[Array, Array, Array]:
    """Steering angle, speed and yaw rate at the samples that hold all three and move."""
    wanted = ("steer", "v_x", "yaw_rate")
    held = [one.recording for one in recordings if all(name in one.recording for name in wanted)]
    table = np.vstack([np.empty((0, 3)), *(np.column_stack([r[name] for name in wanted]) for r in held)])
    table = table[np.all(np.isfinite(table), axis=1)]
    top = float(np.quantile(table[:, 1], 0.99)) if len(table) else 0.0
    table = table[table[:, 1] > MOVING * top]
    return table[:, 0], table[:, 1], table[:, 2]
