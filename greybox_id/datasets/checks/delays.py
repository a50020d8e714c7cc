"""Delays between channels, run by run.

Estimates the delay between two series to fractions of a sample, with its uncertainty.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ...base.numbers import short_with_sd
from ...base.shorthands import Array
from ...base.statistics import CubicSpline, smoothed
from ..recording import Recording
from .finding import Finding, FoundAt, Severity, listed
from .pairs import Pair, standard
from .values import ZERO_SHARE, zero_share

BLOCK_SECONDS = 1.0
"""Length of the blocks left out in turn, s: longer than residuals are correlated."""
BLOCKS = (6, 40)
"""Smallest and largest number of blocks of the jackknife."""
SMOOTHING = 1.5
"""Standard deviation of the weakest smoothing, in samples. Interpolation damps white noise between samples, so that
least squares would prefer delays of half samples; band-limited series are shifted without being damped."""
STEP = 0.02
"""Step in s, at least one sample, of the parabola through the misfit around its minimum."""
FLOOR = 0.05
"""Resolution of a delay by interpolation, in samples; added to the statistical error."""
GOOD_FIT, COARSEST = 0.97, 0.2
"""Smoothing increases until the correlation reaches the first, or its standard deviation the second, in s: the misfit
of noisy series has ripples, which look like sharp minima."""
LEAST_FIT = 0.9
"""Correlation at the best delay below which no delay is returned: noise then has minima near the true one."""

RIVAL = 16.0
"""A second minimum of the misfit is excluded if it is this much, in squared standard deviations, above the first."""


@dataclass(frozen=True)
class Lag:
    """A delay of the left series relative to the right one.

    Attributes
    ----------
    samples : the delay; positive if the left series is later.
    error : standard uncertainty of the delay, samples.
    gain : left over right at this delay.
    correlation : at this delay.
    """

    samples: float
    error: float
    gain: float
    correlation: float


def estimate_lag(left: Array, right: Array, dt: float, smoothing: float = 0.0, longest: float = 0.4) -> Lag | None:
    """Delay d that makes left(t) = gain · right(t - d) + constant fit best, by least squares.

    Both series get the same Gaussian smoothing, which shifts neither. The uncertainty is a block jackknife, which
    includes noise on either side, autocorrelated residuals and variation of the delay.

    Parameters
    ----------
    left, right : (n,) series without gaps.
    dt : sample time, s.
    smoothing : standard deviation of the smoothing, s.
    longest : largest delay to search in both directions, s.

    Returns
    -------
    Lag or None
        None if the series are too short or not similar enough, or match best at the edge of the search.
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
    """The delay under Gaussian smoothing of `sigma` samples; None if it cannot be estimated."""
    reach, trim = max(3, int(round(longest / dt))), int(round(3 * sigma))
    if len(left) < 6 * reach + 2 * trim:
        return None
    # Centred and scaled: a large mean would cost digits in the sums below.
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
    """Whether another minimum is nearly as deep, given the number of independent samples."""
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
        """(6, blocks) counts and sums of l, r, l², r², l·r (l left, r right) in each block."""
        right = self.spline.shifted(self.margin, len(self.left), -delay)
        count, left, left_2 = self.of_left
        mean, power, both = self._by_block(right, right * right, self.left * right)
        return np.stack([count, left, mean, left_2, power, both])

    def whole(self, delay: float) -> Array:
        """(6,) the same sums over all blocks."""
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
        """Residual sum of squares of regressing left on right and a constant; a negative gain is set to zero."""
        covariance, power, energy = self.moments(sums)
        unexplained: Array = energy - np.maximum(covariance, 0.0) ** 2 / np.maximum(power, 1e-300)
        return unexplained

    def vertex(self, delay: float, step: float) -> Array:
        """Offset of the parabola's minimum from `delay`, (1 + blocks,): of all data, then with each block left out."""
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


SIGNIFICANT = 4.0
"""Standard errors for a disagreement between delays: many runs and pairs are compared, so chance must be excluded."""
DISAGREEMENT = 0.5
"""Samples by which a run's delay may differ from the others' before no single model can fit both."""
RESPONSE_SHARE = 0.25
"""Share of the lag of yaw rate behind steering (the vehicle's response) by which it varies with the manoeuvre; only
larger differences are attributed to the recording."""
LIKE_SPEED = 2.0
"""The response lag grows with speed: only runs whose mean speeds lie within this factor are compared."""
MANY, MANY_RUNS = 0.25, 8
"""If more than this share of at least this many runs differ, no run is singled out: the delay is not constant."""
WORTH_TELLING = 0.5
"""Delay in samples between two measurements of the same quantity from which it is reported."""
OF_HELD_COMMANDS = 0.5
"""Delay in samples that results from holding commands between rows and from central differences."""
BLUNT = "The steering signal has a dead zone, which delays it as well."
PRECISE = 0.5
"""Uncertainty in samples above which a delay is not reported."""


def check_delays(recording: Recording, pairs: list[Pair]) -> list[Finding]:
    """Report the delay of each pair, and runs whose delay differs from the others'."""
    findings: list[Finding] = []
    for pair in pairs:
        lags = run_lags(recording, pair)
        if lags:
            findings += _usual(pair, lags, recording.sample_time)
            findings += _disagreements(recording, pair, lags)
    return findings


def run_lags(recording: Recording, pair: Pair) -> dict[int, Lag]:
    """Delay of the pair's left side relative to the right: run number -> lag, for runs in which it can be estimated."""
    if pair.lag_smoothing is None:
        return {}
    dt = recording.sample_time
    lags = {}
    for number, (start, stop) in enumerate(recording.runs, 1):
        left, right = pair.left_values[start:stop], pair.right_values[start:stop]
        lag = estimate_lag(left, right, dt, pair.lag_smoothing)
        if lag is not None and lag.error < max(PRECISE, 0.01 / dt):
            lags[number] = lag
    return lags


def _usual(pair: Pair, lags: dict[int, Lag], dt: float) -> list[Finding]:
    delays = np.array([lag.samples for lag in lags.values()])
    errors = np.array([lag.error for lag in lags.values()])
    usual = float(np.median(delays))
    weights = 1 / errors**2
    error = float(max(1 / np.sqrt(weights.sum()), 1.25 * np.std(delays) / np.sqrt(len(delays))))
    ms = 1000 * dt
    findings = []
    if not pair.kinematic or (abs(usual) > WORTH_TELLING and abs(usual) > SIGNIFICANT * error):
        verb = "lags" if usual >= 0 else "leads"
        runs = f"median of {len(lags)} runs" if len(lags) > 1 else f"run {next(iter(lags))}"
        why = (
            "This time includes the response of the vehicle."
            if not pair.kinematic
            else "The two should agree: correct the time of one of the sensors."
        )
        sentence = (
            f"{pair.left} {verb} {pair.right} by {short_with_sd(abs(usual), error)} samples "
            f"({short_with_sd(abs(usual) * ms, error * ms)} ms; {runs}). {why}"
        )
        apart = pair.kinematic and abs(usual) > WORTH_TELLING + OF_HELD_COMMANDS
        severity = Severity.WARNING if apart else Severity.NOTE
        findings.append(Finding("delay", severity, FoundAt(pair.nodes[0]), sentence, usual * dt, error * dt, "s"))
    return findings


def _disagreements(recording: Recording, pair: Pair, lags: dict[int, Lag]) -> list[Finding]:
    """Runs whose delay differs from that of most other comparable runs."""
    dt = recording.sample_time
    ms = 1000 * dt
    odd: dict[int, tuple[float, float]] = {}
    compared: dict[int, list[int]] = {}
    for number, lag in lags.items():
        likes = [n for n in lags if n != number and (pair.kinematic or _alike(recording, n, number))]
        others = [lags[n] for n in likes]
        apart = np.array([lag.samples - other.samples for other in others])
        errors = np.array([np.hypot(lag.error, other.error) for other in others])
        allowed = [
            DISAGREEMENT if pair.kinematic else max(DISAGREEMENT, RESPONSE_SHARE * abs(o.samples)) for o in others
        ]
        differs = (np.abs(apart) > allowed) & (np.abs(apart) > SIGNIFICANT * errors)
        if len(others) >= min(2, len(lags) - 1) and np.count_nonzero(differs) > len(others) / 2:
            middle = int(np.argsort(apart)[len(apart) // 2])
            odd[number], compared[number] = (float(apart[middle]), float(errors[middle])), likes
    if len(lags) == 2 and odd:
        odd = {max(odd): odd[max(odd)]}  # two runs disagree with each other: report it once
    blunt = not pair.kinematic and zero_share(recording, "steer") > ZERO_SHARE
    if len(lags) >= MANY_RUNS and len(odd) > MANY * len(lags):
        return [_scattered(pair, lags, odd, dt)]
    like = "in other runs" if pair.kinematic else "in runs of similar speed"
    findings = []
    for number, (distance, error) in sorted(odd.items()):
        lag = lags[number]
        elsewhere = [f"{lags[n].samples:.2f} in run {n}" for n in compared[number]]
        sentence = (
            f"in run {number}, {pair.left} lags {pair.right} by {short_with_sd(lag.samples, lag.error)} samples "
            f"({short_with_sd(lag.samples * ms, lag.error * ms)} ms); {like} it lags by {listed(elsewhere, 5)}. "
            f"Run {number} differs from their median by {short_with_sd(abs(distance) * ms, error * ms)} ms. "
        )
        sentence += BLUNT if blunt else "No model with one delay fits all of them: estimate the delay for each run."
        where = FoundAt(pair.nodes[0], number)
        severity = Severity.WARNING if blunt else Severity.DISTRUST
        findings.append(Finding("run_delay", severity, where, sentence, distance * dt, error * dt, "s"))
    return findings


def _alike(recording: Recording, a: int, b: int) -> bool:
    speeds = [float(np.nanmean(np.abs(recording["v_x"][slice(*recording.runs[n - 1])]))) for n in (a, b)]
    return max(speeds) < LIKE_SPEED * min(speeds)


def _scattered(pair: Pair, lags: dict[int, Lag], odd: dict[int, tuple[float, float]], dt: float) -> Finding:
    low, high = (choose(lags, key=lambda number: lags[number].samples) for choose in (min, max))
    ms = 1000 * dt
    ends = [f"{short_with_sd(ms * lags[n].samples, ms * lags[n].error)} ms in run {n}" for n in (low, high)]
    sentence = (
        f"the delay of {pair.left} after {pair.right} differs from run to run, from {ends[0]} to {ends[1]}; "
        f"{len(odd)} of {len(lags)} runs have another delay than the rest. "
    )
    if pair.kinematic:
        sentence += "Both channels show the same quantity, so their clocks are not synchronised."
    else:
        sentence += (
            "A delay this long comes from the vehicle's response or a dead zone in the steering rather than "
            "from the clock."
        )
    severity = Severity.DISTRUST if pair.kinematic else Severity.WARNING
    apart, error = odd[max(odd, key=lambda number: abs(odd[number][0]))]
    return Finding("run_delay", severity, FoundAt(pair.nodes[0]), sentence, apart * dt, error * dt, "s")
