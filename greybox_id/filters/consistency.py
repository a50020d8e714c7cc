"""Does the filter know how wrong it is: its innovations against what it expected of them.

An innovation over its expected standard deviation, squared, is 1 on average (NIS, normalised innovation squared) and
does not depend on the one before. Source: Bar-Shalom, Li & Kirubarajan, Estimation with Applications to Tracking and
Navigation, 2001, Sec. 5.4.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.stats import chi2

from ..parameter import Array

WINDOW = 2.0
"""Innovations are judged over so many seconds."""


@dataclass(frozen=True)
class Consistency:
    """The innovations of one channel.

    Attributes
    ----------
    count : how many readings were taken.
    nis : their mean NIS.
    inside : share of windows of `WINDOW` seconds whose mean NIS lies within its 95 % bounds.
    correlation : of each with the next, and within which it lies in 95 % of cases if there is none.
    correlation_bound : that bound.
    gated : how many lay beyond the gate.
    rms : root mean square of the innovations themselves, in the channel's unit.
    """

    count: int
    nis: float
    inside: float
    correlation: float
    correlation_bound: float
    gated: int
    rms: float


def consistency(off: Array, spread: Array, per_window: int, gate: float) -> Consistency:
    """Judge a channel's innovations (n,) and their expected variances (n,); NaN where nothing was read."""
    there = np.isfinite(off)
    count = int(np.count_nonzero(there))
    if count < 2:
        return Consistency(count, np.nan, np.nan, np.nan, np.nan, 0, np.nan)
    scaled = off[there] / np.sqrt(spread[there])
    windows = windowed(scaled**2, per_window)
    low, high = bounds(per_window)
    inside = float(np.mean((windows > low) & (windows < high))) if len(windows) else np.nan
    clipped = np.clip(scaled, -gate, gate)
    correlation = float(np.corrcoef(clipped[1:], clipped[:-1])[0, 1]) if count > 3 and np.std(clipped) > 0 else np.nan
    beyond = int(np.count_nonzero(np.abs(scaled) > gate))
    nis = float(np.mean(clipped**2))
    return Consistency(
        count, nis, inside, correlation, 1.96 / np.sqrt(count), beyond, float(np.sqrt(np.mean(off[there] ** 2)))
    )


def windowed(values: Array, size: int) -> Array:
    """Means of windows of so many values; what is left over at the end is left out."""
    whole = len(values) // size
    return np.asarray(values[: whole * size].reshape(whole, size).mean(axis=1)) if whole else np.empty(0)


def bounds(size: int) -> tuple[float, float]:
    """Within which the mean of so many independent NIS lies in 95 % of cases."""
    return float(chi2.ppf(0.025, size) / size), float(chi2.ppf(0.975, size) / size)


def widening(channels: Sequence[Consistency]) -> float:
    """By how much bands are too narrow, judged by the channel that is furthest off; never less than 1."""
    found = [np.sqrt(own.nis) for own in channels if np.isfinite(own.nis)]
    return float(max([1.0, *found]))
