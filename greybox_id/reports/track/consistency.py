"""Does the filter know how wrong it is: innovations over time and over lags, within the bounds where they belong."""

from __future__ import annotations

import numpy as np

from ..figures.style import symbol
from ..plot.figure import Figure, Panel
from ..plot.marks import Band, Curve, Rule
from ..plot.palette import BLUE, PALE, Line
from ..plot.scale import Axis
from .digest import Digest

HEIGHT, LOW = 60.0, 75.0


def squares(found: Digest) -> Figure:
    """Normalised innovations squared over time, one panel for each reading."""
    x = Axis("time [s]", float(np.min(found.course.time)), float(np.max(found.course.time)))
    panels = []
    for name, own in found.innovations.items():
        ends = np.array([x.low, x.high], dtype=float)
        within = Band(ends, np.full(2, own.low), np.full(2, own.high), PALE, "95 % of windows, if consistent", 0.4)
        line = Curve(own.time, own.nis, Line(BLUE, width=0.6, words="mean over 2 s"), dots=1.2)
        panels.append(Panel((within, line), x, Axis(f"NIS {symbol(name)}\n[1]", log=True)))
    return Figure(tuple((panel,) for panel in panels), (HEIGHT,) * len(panels), joined=True)


def whiteness(found: Digest) -> Figure:
    """Correlations of innovations with later ones, one panel for each reading."""
    panels = []
    for name, own in found.innovations.items():
        half = np.full(2, found.consistency[name].correlation_bound)
        band = Band(own.lags[[0, -1]], -half, half, PALE, "95 % if independent", 0.4)
        line = Curve(own.lags, own.correlation, Line(BLUE, width=0.9), dots=1.2)
        x = Axis("lag [s]", 0.0, float(own.lags[-1]))
        y = Axis("correlation [1]", -0.6, 1.05, ticks=((-0.5, "−0.5"), (0.0, "0"), (0.5, "0.5"), (1.0, "1")))
        panels.append(Panel((band, Rule(0.0), line), x, y, symbol(name)))
    return Figure((tuple(panels),), (LOW,))
