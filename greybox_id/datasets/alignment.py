"""Alignment of two clocks that record the same quantity: their offset and relative rate.

Smoothed series are cross-correlated at all rates that quartz clocks and operating systems reach; from the best match,
offset, rate, gain and constant are refined by least squares. A block jackknife gives their uncertainty.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..base.shorthands import Array
from ..base.statistics import smoothed

FASTEST = 0.03
"""Largest share by which a clock may run fast or slow."""
COARSE = 0.04
"""Smallest sampling step of the coarse search, s."""
SMOOTHING = 0.1
"""Standard deviation of the smoothing in the coarse search, s; neighbouring rates shift the ends by this much."""
REFINED = 1.5
"""Standard deviation of the smoothing before refinement, in samples: interpolation damps noise between samples."""
ALIKE = 0.9
"""Correlation below which two series do not show the same quantity."""
FEWEST_SHARED = 100
"""Samples in common below which nothing is estimated."""
BLOCKS = 20
SURE = 2.0
"""Standard deviations from which a rate is significant; otherwise it is set to zero."""
STEPS = 40
SEARCHED = 300.0
"""s of a long recording to which the coarse search is confined."""


@dataclass(frozen=True)
class ClockAlignment:
    """t_other = t + seconds + rate (t - start).

    Attributes
    ----------
    start : instant of the first clock that offsets refer to, s.
    seconds, sd : offset of the other clock at that instant, positive if ahead, and its standard deviation, s.
    rate, rate_sd : share by which the other clock runs fast; 0 if not significant.
    left : largest standard deviation of the remaining offset within the common time, s.
    correlation : of the two series once aligned.
    """

    start: float
    seconds: float
    sd: float
    rate: float
    rate_sd: float
    left: float
    correlation: float

    def corrected(self, time: Array) -> Array:
        """Times of the other clock converted to the first clock, s."""
        return np.asarray(self.start + (time - self.start - self.seconds) / (1 + self.rate))


def aligned(t: Array, v: Array, t_other: Array, v_other: Array, longest: float) -> ClockAlignment | None:
    """Alignment of the second clock to the first; None if the series are not similar enough.

    Parameters
    ----------
    t, v : (n,) instants, increasing, s, and values of the first.
    t_other, v_other : (m,) of the second.
    longest : largest offset to search, s.
    """
    step = max(float(np.median(np.diff(t))), float(np.median(np.diff(t_other))))
    if not step > 0 or min(np.ptp(t), np.ptp(t_other)) < FEWEST_SHARED * step:
        return None
    time, other = t - t[0], t_other - t[0]
    span, whole = min(time[-1], SEARCHED), time[-1]
    part = time <= span
    begun = _searched(time[part], v[part], other, v_other, max(step, COARSE), longest)
    while begun is not None and span < whole:  # the rate from a part is good enough to start on one four times as long
        part = time <= span
        reached = _refined(time[part], v[part], other, v_other, step, begun, True)
        begun, span = (None if reached is None else (reached.seconds, reached.rate)), 4 * span
    if begun is None:
        return None
    free = _refined(time, v, other, v_other, step, begun, True)
    if free is None or abs(free.rate) <= SURE * free.rate_sd:
        free = _refined(time, v, other, v_other, step, (begun[0] if free is None else free.seconds, 0.0), False)
    if free is None or free.correlation < ALIKE or abs(free.seconds) > longest:
        return None
    return ClockAlignment(float(t[0]), free.seconds, free.sd, free.rate, free.rate_sd, free.left, free.correlation)


def _searched(t: Array, v: Array, u: Array, w: Array, step: float, longest: float) -> tuple[float, float] | None:
    """Offset and rate at which the smoothed series correlate best."""
    from scipy.signal import correlate, correlation_lags  # imported here: slower to load than most files to read

    grid = np.arange(t[0], t[-1], step)
    standardised = _standard(smoothed(np.interp(grid, t, v), SMOOTHING / step))
    span = min(t[-1], u[-1]) - max(t[0], u[0])
    if span < FEWEST_SHARED * step or not np.any(standardised):
        return None
    count = int(np.ceil(FASTEST * span / (2 * SMOOTHING)))
    best: tuple[float, float, float] | None = None
    reach = int(longest / step)
    for rate in FASTEST * np.arange(-count, count + 1) / max(count, 1):
        # the other clock's values at the grid's instants if there were no offset
        values = np.interp(grid * (1 + rate), u, w, left=np.nan, right=np.nan)
        finite = np.isfinite(values)
        if np.count_nonzero(finite) < FEWEST_SHARED:
            continue
        other = np.where(finite, values, 0.0)
        other = _standard(smoothed(np.where(finite, other - np.mean(values[finite]), 0.0), SMOOTHING / step))
        product = correlate(other, standardised, mode="full", method="fft") / len(standardised)
        lags = correlation_lags(len(other), len(standardised), mode="full")
        near = np.abs(lags) <= reach
        k = int(np.argmax(np.where(near, product, -np.inf)))
        if best is None or product[k] > best[0]:
            best = float(product[k]), float(lags[k]) * step, float(rate)
    return None if best is None else (best[1], best[2])


def _refined(
    t: Array, v: Array, u: Array, w: Array, step: float, begun: tuple[float, float], with_rate: bool
) -> ClockAlignment | None:
    """Least squares over offset, rate, gain and constant, started from the coarse search."""
    from scipy.interpolate import CubicSpline  # imported here: slower to load than most files to read

    own_step, other_step = float(np.median(np.diff(t))), float(np.median(np.diff(u)))
    sigma = REFINED * step
    even = np.arange(u[0], u[-1], other_step)
    spline = CubicSpline(even, smoothed(np.interp(even, u, w), sigma / other_step))
    grid = np.arange(t[0], t[-1], own_step)
    target = smoothed(np.interp(grid, t, v), sigma / own_step)
    seconds, rate = begun
    middle = 0.5 * (grid[0] + grid[-1])
    cut = 4 * sigma
    for _ in range(STEPS):
        place = grid + seconds + rate * grid
        inside = (place > even[0] + cut) & (place < even[-1] - cut) & (grid > t[0] + cut) & (grid < t[-1] - cut)
        if np.count_nonzero(inside) < FEWEST_SHARED:
            return None
        x, y, tau = place[inside], target[inside], grid[inside] - middle
        predicted, slope = spline(x), spline(x, 1)
        a, c = np.polyfit(predicted, y, 1)
        columns = [a * slope, *([a * slope * tau] if with_rate else []), predicted, np.ones(len(x))]
        design = np.column_stack(columns)
        residual = y - a * predicted - c
        move = np.linalg.lstsq(design, residual, rcond=None)[0]
        d_rate = float(move[1]) if with_rate else 0.0
        seconds, rate = seconds + float(move[0]) - d_rate * middle, rate + d_rate
        if abs(move[0]) < 1e-7 and abs(d_rate) < 1e-9:
            break
    if not a > 0:
        return None
    covariance = _jackknife(design, residual)
    at = np.array([1.0, *([-middle] if with_rate else [])])
    ends = [np.array([1.0, *([item - middle] if with_rate else [])]) for item in (grid[inside][0], grid[inside][-1])]
    size = len(at)
    spread = [float(np.sqrt(end @ covariance[:size, :size] @ end)) for end in (at, *ends)]
    rate_sd = float(np.sqrt(covariance[1, 1])) if with_rate else 0.0
    correlation = float(np.corrcoef(predicted, y)[0, 1])
    return ClockAlignment(0.0, float(seconds), spread[0], float(rate), rate_sd, max(spread[1:]), correlation)


def _jackknife(design: Array, left: Array) -> Array:
    """Covariance of the last least-squares step, by leaving out blocks in turn."""
    edges = np.linspace(0, len(left), BLOCKS + 1).astype(int)
    blocks = list(zip(edges, edges[1:], strict=False))
    squares = [design[a:b].T @ design[a:b] for a, b in blocks]
    pulls = [design[a:b].T @ left[a:b] for a, b in blocks]
    whole, pull = np.sum(squares, axis=0), np.sum(pulls, axis=0)
    moves = np.array([np.linalg.lstsq(whole - s, pull - p, rcond=None)[0] for s, p in zip(squares, pulls, strict=True)])
    about = moves - np.mean(moves, axis=0)
    return np.asarray((BLOCKS - 1) / BLOCKS * about.T @ about)


def _standard(values: Array) -> Array:
    spread = float(np.std(values))
    return np.asarray((values - np.mean(values)) / spread) if spread > 0 else np.zeros(len(values))
