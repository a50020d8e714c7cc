"""What could be there unseen: the least visible effects, and where the vehicle was driven at all."""

from __future__ import annotations

from collections.abc import Mapping
from math import isfinite

import numpy as np
from matplotlib.axes import Axes

from ....gap import Gap, Limit, Strip
from ...figures.sheet import Sheet, notice
from ...figures.style import BLUE, INK, PALE, SMALL, look
from .looks import EDGED
from .regimes import draw_map

MOST = 12
"""Effects drawn."""
REACH = (0.01, 30.0)
"""Of sizes, in usual ones; larger ones end in an arrow."""
HEIGHT = 150.0
OPACITY = (0.12, 0.9)


def limits(gap: Gap) -> Sheet | None:
    """Bars of the size that would show, over the usual one, beside the map of what was driven; None for neither."""
    columns = bool(gap.limits) + (gap.strip is not None)
    if not columns:
        return None
    sheet = Sheet((HEIGHT,), columns, widths=(1.3, 1.0)[:columns])
    if gap.limits:
        _sizes(sheet.first(), gap.limits)
    if gap.strip is not None:
        driven(sheet.grid[0, -1], gap.strip)
    return sheet


def _sizes(ax: Axes, known: Mapping[str, Limit]) -> None:
    shown = [*known.items()][:MOST]
    at, (low, high) = np.arange(len(shown)), REACH
    ends = np.array([min(max(own.share, 1.3 * low), high) for _, own in shown])
    unseen = np.array([own.share >= 1.0 for _, own in shown])
    for colour, words, k in (
        (PALE, "usual size is below the detection limit", unseen),
        (BLUE, "would show", ~unseen),
    ):
        if np.any(k):
            ax.barh(at[k], ends[k] - low, 0.6, low, color=colour, label=words, **EDGED)
    for row, (_, own) in enumerate(shown):
        if own.share > high:
            ax.text(0.8 * high, row, ">", size=SMALL, ha="center", va="center_baseline", color=INK)
    ax.axvline(1.0, **look(INK, 0.8))
    ax.set(xlabel="size that would show over the usual one [1]", xscale="log", xlim=REACH,
           ylim=(max(len(shown), 4) - 0.4, -0.6))  # fmt: skip
    ax.set_yticks(at, [name.replace("_", " ") for name, _ in shown])
    ax.grid(visible=False, axis="y")


def driven(ax: Axes, strip: Strip) -> None:
    """Draw a map of the share of the time over v_x and a_y; blank where nothing was driven."""
    share = np.asarray(strip.map.get("time", 0.0), dtype=float)
    most = float(np.nanmax(share, initial=0.0))
    if not {"v_x", "a_y", "time"} <= strip.map.keys() or not (isfinite(most) and most > 0):
        notice(ax, "where it was driven is not known")
        return
    draw_map(ax, strip, np.where(share > 0, share, np.nan), "share of the time [%]", BLUE, OPACITY)
