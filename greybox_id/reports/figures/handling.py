"""Handling diagram: the steering angle beyond what the path's curvature needs, over lateral acceleration."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from ...fit import Fit
from ...parameter import Array
from ..motion.driven import MOVING, Driven, motion_model, typical_speed
from ..motion.settled import steady_turns
from ..plot.figure import Figure, Panel
from ..plot.marks import Curve, Mark, Rule
from ..plot.palette import BLUE, Line
from ..plot.scale import Axis
from .density import counts_of, density

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
    sides = [steady_turns(model, np.linspace(0.0, side * reach, POINTS), speed) for side in (1.0, -1.0)]
    if sides[0] is None or sides[1] is None:
        return None
    angles = np.linspace(-reach, reach, 2 * POINTS - 1)
    rate = np.concatenate([sides[1][:0:-1], sides[0]])
    beyond, a_y = angles - L * rate / speed, rate * speed
    marks: list[Mark] = []
    shades, ends = None, np.zeros(2)
    if len(steer):
        measured, need = yaw_rate * v_x, steer - L * yaw_rate / v_x
        low, high = np.quantile(need, SHOWN)
        within = (*np.quantile(measured, SHOWN).tolist(),), (min(low, np.nanmin(beyond)), max(high, np.nanmax(beyond)))
        marks.append(density(measured, need, *within))
        shades = counts_of(measured, need, *within)
        ends = np.quantile(measured, SEEN)
    inside = (a_y >= ends[0]) & (a_y <= ends[1])
    thick = Line(BLUE, width=2.0, words=f"model at {speed:.3g} m/s, where driven")
    thin = Line(BLUE, width=0.8, words="beyond" if not np.all(inside) else "")
    marks += [Rule(0.0), Curve(a_y, beyond, thin), Curve(a_y, np.where(inside, beyond, np.nan), thick)]
    if not np.any(inside):
        marks[-1] = Curve(a_y, beyond, replace(thin, words=f"model at {speed:.3g} m/s"))
    panel = Panel(
        tuple(marks), Axis("lateral acceleration v_x · yaw rate [m/s²]"),
        Axis("steer − wheelbase · curvature [rad]"), shades=shades,
    )  # fmt: skip
    return Figure(((panel,),), (135.0,))


def _measured(recordings: Sequence[Driven]) -> tuple[Array, Array, Array]:
    """Steering angle, speed and yaw rate at the samples that hold all three and move."""
    wanted = ("steer", "v_x", "yaw_rate")
    held = [one.recording for one in recordings if all(name in one.recording for name in wanted)]
    table = np.vstack([np.empty((0, 3)), *(np.column_stack([r[name] for name in wanted]) for r in held)])
    table = table[np.all(np.isfinite(table), axis=1)]
    top = float(np.quantile(table[:, 1], 0.99)) if len(table) else 0.0
    table = table[table[:, 1] > MOVING * top]
    return table[:, 0], table[:, 1], table[:, 2]
