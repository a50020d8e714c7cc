"""Handling diagram: the steering angle beyond what the path's curvature needs, over lateral acceleration."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ...fit import Fit
from ...motion_model import MotionModel
from ...parameter import Array
from ..driven import MOVING, Driven, motion_model, typical_speed
from ..settled import steady_turns
from .density import density, scale_of_counts
from .sheet import Sheet
from .style import BLUE, ZERO, look

A_Y, BEYOND = "lateral acceleration v_x · yaw rate [m/s²]", "steer − wheelbase · curvature [rad]"
POINTS = 81
SEEN, SHOWN = (0.005, 0.995), (0.01, 0.99)
"""Quantiles of what was driven: the curve is thick between the first, the axes end at the second."""


def handling(fit: Fit, recordings: Sequence[Driven]) -> Sheet | None:
    """The model's steady turns over the density of what was measured; None for models that do not steer.

    The wheelbase is that of the fit.
    """
    model = motion_model(fit)
    if not is_steered(model):
        return None
    steer, v_x, yaw_rate = _measured(recordings)
    speed = typical_speed(recordings)
    reach = float(np.quantile(np.abs(steer), SEEN[1])) * 1.2 if len(steer) else 0.3
    turns = turns_beyond_curvature(model, speed, reach)
    if turns is None:
        return None
    a_y, beyond = turns
    sheet, ends = Sheet((135.0,)), np.zeros(2)
    ax = sheet.first()
    if len(steer):
        L = float(model["l_f"].array + model["l_r"].array)
        measured, need = yaw_rate * v_x, steer - L * yaw_rate / v_x
        low, high = np.quantile(need, SHOWN)
        within = (*np.quantile(measured, SHOWN).tolist(),), (min(low, np.nanmin(beyond)), max(high, np.nanmax(beyond)))
        scale_of_counts(ax, density(ax, measured, need, *within))
        ends = np.quantile(measured, SEEN)
    inside, words = (a_y >= ends[0]) & (a_y <= ends[1]), f"model at {speed:.3g} m/s"
    ax.axhline(0.0, **ZERO)
    ax.plot(a_y, beyond, **look(BLUE, 0.8, "beyond" if np.any(inside) else words))
    if np.any(inside):
        ax.plot(a_y, np.where(inside, beyond, np.nan), **look(BLUE, 2.0, f"{words}, where driven"))
    ax.set(xlabel=A_Y, ylabel=BEYOND)
    return sheet


def is_steered(model: MotionModel) -> bool:
    """Whether a model has a handling diagram."""
    return "steer" in model.inputs and "yaw_rate" in model.outputs and "l_f" in model and "l_r" in model


def turns_beyond_curvature(model: MotionModel, speed: float, reach: float) -> tuple[Array, Array] | None:
    """Lateral acceleration, m/s², and steering less wheelbase times curvature, rad, in steady turns to both sides.

    None where there are none.
    """
    angles = np.linspace(0.0, reach, POINTS)
    sides = [steady_turns(model, side * angles, speed) for side in (-1.0, 1.0)]
    if sides[0] is None or sides[1] is None:
        return None
    rate = np.concatenate([sides[0][:0:-1], sides[1]])
    L = float(model["l_f"].array + model["l_r"].array)
    return rate * speed, np.concatenate([-angles[:0:-1], angles]) - L * rate / speed


def _measured(recordings: Sequence[Driven]) -> tuple[Array, Array, Array]:
    """Steering angle, speed and yaw rate at the samples that hold all three and move."""
    wanted = ("steer", "v_x", "yaw_rate")
    held = [one.recording for one in recordings if all(name in one.recording for name in wanted)]
    table = np.vstack([np.empty((0, 3)), *(np.column_stack([r[name] for name in wanted]) for r in held)])
    table = table[np.all(np.isfinite(table), axis=1)]
    top = float(np.quantile(table[:, 1], 0.99)) if len(table) else 0.0
    table = table[table[:, 1] > MOVING * top]
    return table[:, 0], table[:, 1], table[:, 2]
