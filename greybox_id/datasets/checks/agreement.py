"""How far two series agree: correlation, gain, and whether chance could do as much."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ...base.shorthands import Array
from ..recording import Recording
from .pairs import smooth

CERTAIN = 4.0
"""Fisher's z of the correlation, in standard deviations of chance, from which a sign counts as certain."""
STRONG = 0.7
"""Below this correlation the gain is told too badly to speak of units: the ratio of spreads is off by up to 1/0.7."""
TINY = 1e-100
"""Series smaller than this, or larger than its inverse, are no measurements."""
ENOUGH = 12.0
"""Independent samples needed: with fewer the correlation of two drifts is mistaken for agreement."""


@dataclass(frozen=True)
class Agreement:
    """Agreement of two series.

    Attributes
    ----------
    correlation : of the smoothed series.
    gain : ratio of their spreads, left over right, with the correlation's sign.
    independent : number of independent samples, corrected for autocorrelation.
    """

    correlation: float
    gain: float
    independent: float

    @property
    def beyond_chance(self) -> bool:
        """Whether the correlation is strong and significant."""
        if self.independent < 4 or abs(self.correlation) < STRONG:
            return False
        return bool(np.arctanh(min(abs(self.correlation), 1 - 1e-12)) * np.sqrt(self.independent - 3) > CERTAIN)

    @property
    def certain(self) -> bool:
        """Whether an accusation may rest on it."""
        return self.independent >= ENOUGH and self.beyond_chance


def agreement(recording: Recording, left: Array, right: Array, seconds: float) -> Agreement:
    """Agreement of two series over all runs, smoothed over `seconds`."""
    return _agreement(_thinned(recording, left, right, seconds))


def run_agreements(recording: Recording, left: Array, right: Array, seconds: float) -> dict[int, Agreement]:
    """Agreement of two series in each run: run number, counted from 1 -> agreement."""
    return {n: _agreement([part]) for n, part in enumerate(_thinned(recording, left, right, seconds), 1)}


def _thinned(recording: Recording, left: Array, right: Array, seconds: float) -> list[tuple[Array, Array]]:
    a, b = smooth(recording, left, seconds), smooth(recording, right, seconds)
    stride = max(1, int(round(max(seconds, 0.2) / 2 / recording.sample_time)))  # neighbours tell nothing new
    parts = []
    for start, stop in recording.runs:
        u, v = a[start:stop:stride], b[start:stop:stride]
        both = np.isfinite(u) & np.isfinite(v)
        parts.append((u[both], v[both]))
    return parts


def _agreement(parts: list[tuple[Array, Array]]) -> Agreement:
    x, y = (_tame(np.concatenate([part[k] for part in parts])) for k in (0, 1))
    x, x_scale = standard(x)
    y, y_scale = standard(y)
    if len(x) < 5 or x_scale == 0.0 or y_scale == 0.0:
        return Agreement(0.0, float("nan"), float(len(x)))
    correlation = float(np.mean(x * y))
    gain = x_scale / y_scale * (1.0 if correlation >= 0 else -1.0)
    return Agreement(correlation, gain, independent_samples(x, y, np.cumsum([len(part[0]) for part in parts])))


def standard(values: Array) -> tuple[Array, float]:
    """The series with mean 0 and standard deviation 1, and its standard deviation before; 0 where it is constant."""
    size = float(np.max(np.abs(values), initial=0.0))
    if not TINY < size < 1 / TINY:
        return values, 0.0
    unit = values / size  # first, so that no square over- or underflows
    unit = unit - unit.mean()
    spread = float(np.std(unit))
    return (unit / spread, spread * size) if spread > 1e-12 else (values, 0.0)


def _tame(values: Array) -> Array:
    """Spikes cut off: a single wild value must not decide on a unit."""
    if not values.size:
        return values
    low, high = np.quantile(values, [0.005, 0.995])
    return np.clip(values, low, high)


def independent_samples(x: Array, y: Array, ends: NDArray[np.int_]) -> float:
    """Bartlett's number of independent samples for the correlation of two autocorrelated standard series."""
    total = 1.0
    for lag in range(1, max(2, len(x) // 3)):
        keep = np.ones(len(x) - lag, dtype=bool)
        for end in ends[:-1]:
            keep[max(0, end - lag) : end] = False  # no product across a join
        if np.count_nonzero(keep) < 5:
            break
        u = float(np.mean((x[lag:] * x[:-lag])[keep]))
        v = float(np.mean((y[lag:] * y[:-lag])[keep]))
        if u * v < 0.02 or min(u, v) < 0:
            break
        total += 2 * u * v
    return len(x) / total
