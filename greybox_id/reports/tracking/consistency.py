"""Normalised innovations squared over time, with the bounds within which they belong."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, LogLocator, NullLocator

from ...filters import Track
from ...filters.consistency import WINDOW, bounds, windowed
from ..figures.style import BLUE, PALE, canvas, look, words

HEIGHT = 1.2


def innovations(found: Track) -> Figure:
    """One panel for each reading."""
    names = tuple(found.innovations)
    step = float(np.median(np.diff(found.time))) if len(found.time) > 1 else 1.0
    size = max(2, round(WINDOW / step))
    low, high = bounds(size)
    with look():
        figure = canvas(HEIGHT * len(names) + 0.6)
        panels = figure.subplots(len(names), 1, sharex=True, squeeze=False)[:, 0]
        for axes, name in zip(panels, names, strict=True):
            there = np.isfinite(found.innovations[name])
            squares = (found.innovations[name][there] / found.expected[name][there]) ** 2
            means, time = windowed(squares, size), windowed(found.time[there], size)
            axes.axhspan(low, high, color=PALE, alpha=0.4, linewidth=0, label="95 % of windows, if consistent")
            axes.plot(time, means, color=BLUE, marker=".", markersize=2.5, linewidth=0.6, label="mean over 2 s")
            axes.set_yscale("log")
            axes.yaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
            axes.yaxis.set_major_formatter(FuncFormatter(lambda value, place: f"{value:g}"))
            axes.yaxis.set_minor_locator(NullLocator())
            axes.set_ylabel(f"NIS {words(name)} [1]")
            axes.margins(x=0)
        figure.align_ylabels()
        panels[-1].set_xlabel("time [s]")
        handles, said = panels[0].get_legend_handles_labels()
        figure.legend(handles, said, loc="outside upper center", ncols=2)
    return figure
