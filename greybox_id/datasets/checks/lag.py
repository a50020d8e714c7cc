"""The delay between two series, in fractions of a sample, with its uncertainty."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ...base.shorthands import Array
from ...base.windows import CubicSpline, smoothed
from .agreement import standard

BLOCK_SECONDS = 1.0
"""Length of the blocks left out in turn: longer than residuals hang together."""
BLOCKS = (6, 40)
"""Fewest and most blocks of the jackknife."""
SMOOTHING = 1.5
"""Samples, standard deviation of the least smoothing. Interpolation weakens white noise half-way between samples, and
least squares would then find every delay there; what is band-limited is shifted without being weakened."""
STEP = 0.02
"""Seconds, and at least one sample: step of the parabola through the misfit around its minimum."""
FLOOR = 0.05
"""Samples. Interpolation cannot tell a delay more finely; added to the statistical error."""
GOOD_FIT, COARSEST = 0.97, 0.2
"""Smoothing grows until the correlation is that good, or its standard deviation is that many seconds: the misfit of
noisy series has ripples, which pass for sharp minima."""
LEAST_FIT = 0.9
"""Correlation at the best delay below which no delay is told: noise then has minima of its own beside the true one."""

RIVAL = 16.0
"""A second minimum of the misfit counts as excluded if it lies so many squared standard deviations above the first."""


@dataclass(frozen=True)
class Lag:
    """A delay, left side after right side.

    Attributes
    ----------
    samples : the delay; positive if the left series comes later.
    error : its standard uncertainty, samples.
    gain : left over right at that delay.
    correlation : at that delay.
    """

    samples: float
    error: float
    gain: float
    correlation: float


def estimate_lag(left: Array, right: Array, dt: float, smoothing: float = 0.0, longest: float = 0.4) -> Lag | None:
    """Delay d that makes left(t) = gain · right(t - d) + constant fit best, by least squares.

    Both series get the same Gaussian smoothing, which shifts neither. The uncertainty is a jackknife over blocks: noise
    on either side, autocorrelated residuals and a delay that wanders are all in it.

    Parameters
    ----------
    left, right : (n,) series without gaps.
    dt : sample time, s.
    smoothing : standard deviation of the smoothing, s.
    longest : delays up to this, s, are looked for in both directions.

    Returns
    -------
    Lag or None
        None where the series are too short, too little alike, or best alike at the edge of the search.
    """
    if not (np.isfinite(left).all() and np.isfinite(right).all()):
        return None
    sigma, coarsest = max(SMOOTHING, smoothing / dt), max(SMOOTHING, COARSEST / dt)
    lag = _lag(left, right, dt, sigma, longest)
    while lag is not None and lag.correlation < GOOD_FIT and sigma < coarsest:
        sigma = min(1.5 * sigma, coarsest)
        lag = _lag(left, right, dt, sigma, longest)
    return lag if lag is not None and lag.correlation > LEAST_FIT else None


def _lag(left: Array, right: Array, dt: float, sigma: float, longest: float) -> Lag | None:
    """The delay under Gaussian smoothing of `sigma` samples; None where there is no telling it."""
    reach, trim = max(3, int(round(longest / dt))), int(round(3 * sigma))
    if len(left) < 6 * reach + 2 * trim:
        return None
    # Centred and scaled: the sums below would lose digits to a large mean.
    left, left_scale = standard(smoothed(left, sigma)[trim:-trim])
    right, right_scale = standard(smoothed(right, sigma)[trim:-trim])
    step = max(1.0, STEP / dt)
    margin = reach + 2 * int(np.ceil(step))
    if len(left) < 2 * margin + 30 or left_scale == 0.0 or right_scale == 0.0:
        return None
    search = _Search(left, right, margin, max(1, int(round(BLOCK_SECONDS / dt))))
    grid = np.linspace(-reach, reach, min(4 * reach, 80) + 1)
    costs = np.array([search.misfit(search.whole(delay)) for delay in grid])
    best = int(np.argmin(costs))
    if best in (0, len(grid) - 1) or _ambiguous(costs, best, len(left) / (3.5 * sigma)):
        return None
    delay = float(grid[best])
    for _ in range(30):
        move = float(search.vertex(delay, step)[0])
        delay += move
        if not abs(delay) <= reach:
            return None
        if abs(move) < 1e-3:
            break
    left_out = search.vertex(delay, step)[1:]
    error = float(np.sqrt((len(left_out) - 1) * np.var(left_out)))
    covariance, power, energy = search.moments(search.whole(delay))
    if power <= 0 or energy <= 0:
        return None
    correlation = float(covariance / np.sqrt(power * energy))
    if not (correlation > 0 and np.isfinite(error)):
        return None
    return Lag(delay, float(np.hypot(error, FLOOR)), float(covariance / power) * left_scale / right_scale, correlation)


def _ambiguous(costs: Array, best: int, independent: float) -> bool:
    """Whether another minimum is nearly as deep, for so many independent samples."""
    inner = costs[1:-1]
    minima = np.flatnonzero((inner <= costs[:-2]) & (inner <= costs[2:])) + 1
    others = costs[minima[minima != best]]
    return bool(np.any((others - costs[best]) * independent < RIVAL * costs[best]))


class _Search:
    """Misfit of two series as a function of the delay, from sums over blocks."""

    def __init__(self, left: Array, right: Array, margin: int, block: int) -> None:
        self.left = left[margin : len(left) - margin]
        self.margin, self.spline = margin, CubicSpline(right)
        count = int(np.clip(len(self.left) // block, *BLOCKS))
        self.starts = np.linspace(0, len(self.left), count + 1).astype(int)[:-1]
        ends = np.append(self.starts[1:], len(self.left))
        self.of_left = np.stack([ends - self.starts, *self._by_block(self.left, self.left**2)])
        self.of_all = np.sum(self.of_left, axis=1)

    def sums(self, delay: float) -> Array:
        """(6, blocks) count and sums of l, r, l², r², l·r in each block."""
        right = self.spline.shifted(self.margin, len(self.left), -delay)
        count, left, left_2 = self.of_left
        mean, power, both = self._by_block(right, right * right, self.left * right)
        return np.stack([count, left, mean, left_2, power, both])

    def whole(self, delay: float) -> Array:
        """(6,) the same of all blocks together."""
        right = self.spline.shifted(self.margin, len(self.left), -delay)
        count, left, left_2 = self.of_all
        return np.array([count, left, np.sum(right), left_2, np.vdot(right, right), np.vdot(self.left, right)])

    def _by_block(self, *series: Array) -> list[Array]:
        return [np.add.reduceat(item, self.starts) for item in series]

    @staticmethod
    def moments(sums: Array) -> tuple[Array, Array, Array]:
        """Centred sums of l·r, r² and l²."""
        count, left, right, left_2, right_2, both = sums
        return both - left * right / count, right_2 - right * right / count, left_2 - left * left / count

    def misfit(self, sums: Array) -> Array:
        """Residual sum of squares of left on right and a constant; a negative gain counts as no fit."""
        covariance, power, energy = self.moments(sums)
        unexplained: Array = energy - np.maximum(covariance, 0.0) ** 2 / np.maximum(power, 1e-300)
        return unexplained

    def vertex(self, delay: float, step: float) -> Array:
        """How far the minimum lies from `delay`, (1 + blocks,): of all blocks, then with each left out; NaN: none."""
        costs = []
        for shift in (-step, 0.0, step):
            sums = self.sums(delay + shift)
            whole = sums.sum(axis=1, keepdims=True)
            costs.append(self.misfit(np.concatenate([whole, whole - sums], axis=1)))
        low, middle, high = costs
        bend = low - 2 * middle + high
        with np.errstate(divide="ignore", invalid="ignore"):
            move = 0.5 * step * (low - high) / bend
        return np.where(bend > 0, np.clip(move, -20 * step, 20 * step), np.nan)
