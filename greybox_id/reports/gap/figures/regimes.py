"""Where in speed and lateral acceleration a gap lies."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes

from ....gap import Strip
from ....parameter import Array
from ...figures.sheet import cells, notice, shades
from ...figures.style import FAINT
from ...numbers import number
from .looks import EXCESS

OPACITY = (0.04, 1.0)


def regimes(ax: Axes, strip: Strip) -> None:
    """Draw a map of the share of the gap over v_x and a_y; grey where nothing was driven."""
    if not {"v_x", "a_y", "gap"} <= strip.map.keys():
        notice(ax, "speed and lateral acceleration are not recorded")
        return
    share = np.asarray(strip.map["gap"], dtype=float)
    if not np.any(np.isfinite(share)) or not np.nanmax(share) > 0:
        notice(ax, "no gap to be placed in a map")
        return
    if not np.all(np.isfinite(share)):
        never = np.where(np.isfinite(share), np.nan, 1.0)
        cells(ax, *_edges(strip), never, FAINT, opacity=(0.9, 0.9), label="never driven")
    draw_map(ax, strip, np.maximum(share, 0.0), "share of the gap [%]", EXCESS, OPACITY)


def draw_map(ax: Axes, strip: Strip, share: Array, words: str, colour: str, opacity: tuple[float, float]) -> None:
    """Draw shares, NaN for none, over v_x and a_y, with their scale."""
    (v_x, a_y), most = _edges(strip), float(np.nanmax(share))
    cells(ax, v_x, a_y, share / most, colour, opacity=opacity)
    shades(ax, [(part, number(100.0 * most * part, 2)) for part in (0.0, 0.5, 1.0)], words, colour, opacity=opacity)
    ax.set(xlabel="v_x [m/s]", xlim=v_x[[0, -1]], ylabel="a_y [m/s²], left positive", ylim=a_y[[0, -1]])
    ax.grid(visible=False)


def _edges(strip: Strip) -> tuple[Array, Array]:
    return np.asarray(strip.map["v_x"]), np.asarray(strip.map["a_y"])
