"""Densities of measured samples, behind curves."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes

from ...parameter import Array
from .sheet import cells, shades
from .style import PALE

CELLS = (60, 34)
"""Cells along each axis."""
OPACITY = (0.14, 0.85)

Ends = tuple[float, float]


def density(ax: Axes, x: Array, y: Array, x_ends: Ends, y_ends: Ends, count: tuple[int, int] = CELLS) -> float:
    """Draw counts of samples in cells, shaded by their logarithm; without samples they are left out. The largest."""
    across, along = (np.linspace(*_apart(ends), n + 1) for ends, n in zip((x_ends, y_ends), count, strict=True))
    counts = np.histogram2d(x, y, (across, along))[0]
    most = max(float(counts.max(initial=0.0)), 2.0)
    share = np.where(counts > 0, np.log(np.maximum(counts, 1.0)) / np.log(most), np.nan)
    cells(ax, across, along, share, PALE, opacity=OPACITY)
    return most


def scale_of_counts(ax: Axes, most: float) -> None:
    """Draw the scale of a density beside it: samples in a cell, up to the largest count."""
    round_ones = [m * 10**k for k in range(6) for m in (1, 2, 5) if m * 10**k <= most]
    kept = round_ones[:: max(1, round(len(round_ones) / 5))]
    ticks = [(float(np.log(own) / np.log(most)), f"{own:g}") for own in kept]
    shades(ax, ticks, "samples per cell [1]", PALE, opacity=OPACITY)


def _apart(ends: Ends) -> Ends:
    low, high = ends
    return (low, high) if high > low else (low - 1.0, low + 1.0)
