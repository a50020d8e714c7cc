"""A gap along time and along the path."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import to_rgba_array

from ....gap import Strip
from ....gap.clock import running
from ....parameter import Array
from ...figures.sheet import Sheet, band, notice_sheet, shades
from ...figures.style import PALE, look
from .looks import AFTER, BEFORE, EXCESS

LARGEST = 100.0
"""Excess, times the noise, at which colours end at most."""
HEIGHT = 96.0
DOT = 4.4
"""Diameter of a spot on the path, points."""
OPACITY = (0.12, 1.0)


def strips(strip: Strip, stretch: Mapping[str, float], applied: bool) -> Sheet:
    """Mean square errors over the noise's along time, and the path in shades of them.

    Parameters
    ----------
    strip : what is drawn.
    stretch : "from", "to", s: the stretch that holds half of the gap, shaded; empty shades nothing.
    applied : whether there is anything after.
    """
    if len(strip.time) < 2:
        return notice_sheet("too short to be drawn along time")
    placed = len(strip.x) == len(strip.time) and bool(np.any(np.isfinite(strip.x)))
    sheet = Sheet((HEIGHT,), 1 + placed, widths=(1.6, 1.0)[: 1 + placed])
    _along_time(sheet.first(), running(strip.time), strip, stretch, applied)
    if placed:
        _along_path(sheet.grid[0, 1], strip)
    return sheet


def _along_time(ax: Axes, time: Array, strip: Strip, stretch: Mapping[str, float], applied: bool) -> None:
    values = np.concatenate([strip.before, strip.after if applied else strip.before])
    values = values[np.isfinite(values) & (values > 0)]
    low, high = (float(np.min(values)), float(np.max(values))) if len(values) else (0.5, 2.0)
    low, high = min(low, 0.7) / 1.1, max(high, 3.0) * 1.2
    if {"from", "to"} <= stretch.keys():
        ends, level = np.array([stretch["from"], stretch["to"]]), np.ones(2)
        band(ax, ends, low * level, high * level, PALE, "holds half of the gap")
    ax.axhline(1.0, **look(PALE, 0.8))
    ax.plot(time, strip.before, **BEFORE)
    if applied:
        ax.plot(time, strip.after, **AFTER)
    ax.set(xlabel="time along the recordings [s]", xlim=time[[0, -1]], yscale="log", ylim=(low, high),
           ylabel="mean square error\nover the noise's [1]")  # fmt: skip


def _along_path(ax: Axes, strip: Strip) -> None:
    top = float(np.clip(np.nanmax(strip.before, initial=1.0), 3.0, LARGEST))
    share = np.log(np.clip(np.nan_to_num(strip.before, nan=1.0), 1.0, top)) / np.log(top)
    ticks = [own for own in (1.0, 2.0, 5.0, 10.0, 20.0, 50.0, 100.0) if own <= top]
    ticks = ticks[:: max(1, round(len(ticks) / 4))]
    known = np.isfinite(strip.x) & np.isfinite(strip.y)
    order = np.argsort(share[known], kind="stable")  # the darkest on top
    x, y, shade = (own[known][order] for own in (strip.x, strip.y, OPACITY[0] + (OPACITY[1] - OPACITY[0]) * share))
    ax.scatter(x, y, DOT**2, facecolors=to_rgba_array(EXCESS, shade), edgecolors=PALE, linewidths=0.25)
    ax.set(xlabel="x [m]", ylabel="y [m]", aspect="equal", adjustable="datalim")
    scale = [(float(np.log(own) / np.log(top)), f"{own:g}") for own in ticks]
    shades(ax, scale, "before, over the noise's [1]", EXCESS, opacity=OPACITY)
