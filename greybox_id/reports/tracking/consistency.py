"""Normalised innovations squared over time, with the bounds within which they belong."""

from __future__ import annotations

import numpy as np

from ...filters import Track
from ...filters.consistency import WINDOW, bounds, windowed
from ..figures.style import symbol
from ..plot.figure import Figure, Panel
from ..plot.marks import Band, Curve
from ..plot.palette import BLUE, PALE, Line
from ..plot.scale import Axis

HEIGHT = 60.0


def innovations(found: Track) -> Figure:
    """One panel for each reading."""
    names = tuple(found.innovations)
    step = float(np.median(np.diff(found.time))) if len(found.time) > 1 else 1.0
    size = max(2, round(WINDOW / step))
    low, high = bounds(size)
    x = Axis("time [s]", float(np.min(found.time)), float(np.max(found.time)))
    panels = []
    for name in names:
        there = np.isfinite(found.innovations[name])
        squares = (found.innovations[name][there] / found.expected[name][there]) ** 2
        means, time = windowed(squares, size), windowed(found.time[there], size)
        ends = np.array([x.low, x.high], dtype=float)
        within = Band(ends, np.full(2, low), np.full(2, high), PALE, "95 % of windows, if consistent", 0.4)
        line = Curve(time, means, Line(BLUE, width=0.6, words="mean over 2 s"), dots=1.2)
        panels.append(Panel((within, line), x, Axis(f"NIS {symbol(name)}\n[1]", log=True)))
    return Figure(tuple((panel,) for panel in panels), (HEIGHT,) * len(panels), joined=True)
