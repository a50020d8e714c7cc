"""Shares, medians and calibration with their uncertainty."""

from __future__ import annotations

from collections.abc import Sequence
from math import floor, nan, sqrt

import numpy as np
from scipy import stats

NORMAL = 1.959964
"""Half of a 95 % interval, in standard deviations."""
BINS = 10


def wilson(hits: int, of: int) -> tuple[float, float]:
    """95 % interval of a share (Wilson, Journal of the American Statistical Association 22, 1927); NaN of nothing."""
    if of == 0:
        return nan, nan
    share, z = hits / of, NORMAL**2
    middle = (share + z / (2 * of)) / (1 + z / of)
    half = NORMAL / (1 + z / of) * sqrt(share * (1 - share) / of + z / (4 * of**2))
    return max(middle - half, 0.0), min(middle + half, 1.0)


def median(values: Sequence[float]) -> tuple[float, tuple[float, float]]:
    """Median and its 95 % interval between order statistics; the interval is NaN below six values."""
    if not values:
        return nan, (nan, nan)
    ordered = sorted(values)
    n = len(ordered)
    k = floor(stats.binom.ppf(0.025, n, 0.5))
    interval = (ordered[k - 1], ordered[n - k]) if k >= 1 else (nan, nan)
    return float(np.median(ordered)), interval


def calibration_error(told: Sequence[tuple[float, bool]]) -> float:
    """Mean distance between probabilities and how often they come true, over ten bins, weighted by what is in them."""
    if not told:
        return nan
    probabilities, true = np.array([own for own, _ in told]), np.array([own for _, own in told], float)
    bins = np.clip((probabilities * BINS).astype(int), 0, BINS - 1)
    apart = [np.sum(bins == k) * abs(np.mean((probabilities - true)[bins == k])) for k in set(bins.tolist())]
    return float(sum(apart) / len(told))
