"""Densities of measured samples, behind curves."""

from __future__ import annotations

import numpy as np

from ...parameter import Array
from ..plot.areas import Cells
from ..plot.figure import Shades
from ..plot.palette import PALE

ACROSS, ALONG = 60, 34
"""Cells along each axis."""
LIGHTEST, DARKEST = 0.14, 0.85

Ends = tuple[float, float]


def density(x: Array, y: Array, x_ends: Ends, y_ends: Ends, cells: tuple[int, int] = (ACROSS, ALONG)) -> Cells:
    """Counts of samples in cells, shaded by their logarithm; cells without samples are left out."""
    edges = [np.linspace(*_apart(ends), count + 1) for ends, count in zip((x_ends, y_ends), cells, strict=True)]
    counts = np.histogram2d(x, y, edges)[0]
    most = max(float(counts.max(initial=0.0)), 2.0)
    share = np.where(counts > 0, np.log(np.maximum(counts, 1.0)) / np.log(most), np.nan)
    return Cells(edges[0], edges[1], share, PALE, lightest=LIGHTEST, darkest=DARKEST, words="")


def counts_of(x: Array, y: Array, x_ends: Ends, y_ends: Ends, cells: tuple[int, int] = (ACROSS, ALONG)) -> Shades:
    """The scale of a density: samples in a cell."""
    edges = [np.linspace(*_apart(ends), count + 1) for ends, count in zip((x_ends, y_ends), cells, strict=True)]
    most = max(float(np.histogram2d(x, y, edges)[0].max(initial=0.0)), 2.0)
    round_ones = [m * 10**k for k in range(6) for m in (1, 2, 5) if m * 10**k <= most]
    kept = round_ones[:: max(1, round(len(round_ones) / 5))]
    ticks = tuple((float(np.log(own) / np.log(most)), f"{own:g}") for own in kept)
    return Shades(ticks, "samples per cell [1]", PALE, LIGHTEST, DARKEST)


def _apart(ends: Ends) -> Ends:
    low, high = ends
    return (low, high) if high > low else (low - 1.0, low + 1.0)
