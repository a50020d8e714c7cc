"""Effects that change no expected reading, only the scatter of readings: repeated rows, jitter of sampling instants.

Jitter moves readings along their rates, and where commands are held, past them: accelerations then jump or not at
random.

These effects are not searched for under a map with memory, whose training left the same scatter, and which knows no
instants between its samples.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import log

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import uniform_filter1d
from scipy.optimize import OptimizeResult, minimize_scalar
from scipy.special import expit

from ...base.shorthands import Array
from ...engine.simulation import FreeRuns
from ...models.effect import Effect
from .calibration import CAL

AT_ONCE = "sensor_latency_imu"
"""Effect that delays readings of accelerations."""
VARIANCES = (2 * log(CAL.jitters[0]), 2 * log(CAL.jitters[1]))
"""Least and greatest logarithm of jitter's variance that is tried."""


@dataclass(frozen=True)
class Scatter:
    """Estimate of an effect on scatter.

    Attributes
    ----------
    magnitude : share of rows, or seconds.
    sd : of the magnitude.
    gain : in log-likelihood.
    left : mean square of residuals over that of noise, with the effect taken into account.
    """

    magnitude: float
    sd: float
    gain: float
    left: float = 1.0


def repeats(bench: FreeRuns) -> NDArray[np.bool_]:
    """(N,) rows at which all sensors repeat the row before exactly."""
    result = np.zeros(len(bench.measured), dtype=bool)
    read = np.any(np.isfinite(bench.measured), axis=0)
    if np.count_nonzero(read) < CAL.fewest_channels or bench.learnt:
        return result
    for rows in bench.rows:
        readings = bench.measured[rows][:, read]
        there = np.isfinite(readings[1:])
        same = np.all((readings[1:] == readings[:-1]) | ~there, axis=1) & np.any(there, axis=1)
        moving = np.any(readings[1:] != 0, axis=1)
        result[rows.start + 1 : rows.stop] = same & moving
    return result


def dropped(held: NDArray[np.bool_]) -> Scatter | None:
    """The share of rows that are held stale; None where these are too few to be no accident."""
    count = int(np.sum(held))
    if count < CAL.some_repeats:
        return None
    share = count / len(held)
    return Scatter(share, float(np.sqrt(share * (1 - share) / len(held))), 10.0 * count)


def without_stale_rows(bench: FreeRuns) -> NDArray[np.bool_]:
    """(N, channels) readings that count, without rows held stale where these are no accident."""
    held = repeats(bench)
    return bench.counted & ~held[:, None] if dropped(held) is not None else bench.counted


def steady_rates(bench: FreeRuns, y: Array, sd: Array, good: NDArray[np.bool_]) -> tuple[Array, NDArray[np.bool_]]:
    """Rates of readings, (N, channels), and where they are known: where no command makes readings jump.

    Where commands are held, accelerations jump with them at every row: a reading that is early by however little shows
    the whole jump. Readings of states do not jump.
    """
    rates, known = np.zeros_like(y), np.zeros_like(good)
    states = {state.name for state in bench.model.states}
    smooth = np.array([channel in states for channel in bench.channels])
    for run, rows in zip(bench.runs, bench.rows, strict=True):
        if rows.stop - rows.start < 3:
            continue
        forward = np.diff(y[rows], axis=0) / np.diff(run.time)[:, None]
        rates[rows.start + 1 : rows.stop - 1] = (forward[1:] + forward[:-1]) / 2
        bend = np.abs(np.diff(y[rows], 2, axis=0))
        known[rows.start + 1 : rows.stop - 1] = (bend < CAL.steady_step * sd) & (smooth | ~np.any(run.held))
    return rates, good & known


def jitter(
    bench: FreeRuns, e: Array, y: Array, sd: Array, good: NDArray[np.bool_], jumps: Array | None = None
) -> Scatter | None:
    """Scatter of the sampling instant: errors of all channels in a row are their rates times the same time.

    It is estimated from residuals less the mean of their neighbours, for jitter does not last.

    Parameters
    ----------
    bench : whose rows.
    e, y : (N, channels) residuals of the best model, and its readings.
    sd : (channels,) of noise where nothing changes.
    good : (N, channels) readings that count.
    jumps : (N, channels) by which readings would differ had they been taken before their row's command; None where no
        command is held.
    """
    if bench.learnt:
        return None
    rates, use = steady_rates(bench, y, sd, good)
    a, z = np.where(use, rates / sd, 0.0), np.where(good, e / sd, 0.0)
    less = _less_neighbours(z, good, bench.rows)
    brief, z = np.where(use, less, 0.0), np.where(use, z, 0.0)
    rows = _JitterLikelihood(a, brief, np.sum(use, axis=1))
    if not np.any(rows.h > 0):
        return None
    best = minimize_scalar(rows.loss, bounds=VARIANCES, method="bounded", options={"xatol": 1e-3})
    variance = float(np.exp(best.x))
    gain = float(np.sum(np.minimum(rows.losses(0.0) - rows.losses(variance), CAL.row_gain)))
    if _gain_of_separate_jitters(a, brief, use, variance) > CAL.odds * gain:
        gain = 0.0
    if _correlation_of_rows(a, brief, variance, bench.rows) > CAL.surely:
        gain = 0.0
    tossed = 0.0 if jumps is None else order_gain(np.where(good, jumps / sd, 0.0), less)
    if gain + tossed <= 0:
        return None
    tau, spread = rows.sd_at(best)
    explained = 2.0 * tossed / max(int(np.sum(good)), 1)
    return Scatter(tau, spread, max(gain, 0.0) + tossed, max(rows.left(variance, z) - explained, 0.0))


class _JitterLikelihood:
    """Likelihood of jitter's variance v, over that of noise, whose own variance is the likeliest beside it.

    Parameters
    ----------
    a : (N, channels) rates of readings over noise.
    brief : (N, channels) residuals over noise, less the mean of their neighbours.
    count : (N,) readings of each row.
    """

    def __init__(self, a: Array, brief: Array, count: NDArray[np.intp]) -> None:
        self.a, self.brief, self.count, self.h = a, brief, count, np.sum(a**2, axis=1)

    def _squares(self, v: float, of: Array) -> Array:
        """(N,) squares of residuals less the part expected from jitter."""
        return np.asarray(np.sum(of**2, axis=1) - v * np.sum(self.a * of, axis=1) ** 2 / (1 + v * self.h))

    def left(self, v: float, of: Array) -> float:
        """Mean square of residuals that jitter leaves."""
        return max(float(np.sum(self._squares(v, of))) / max(int(np.sum(self.count)), 1), 1e-300)

    def losses(self, v: float) -> Array:
        """(N,) negative log-likelihoods of rows."""
        noise, squares = self.left(v, self.brief), self._squares(v, self.brief)
        return np.asarray(0.5 * (np.log1p(v * self.h) + self.count * np.log(noise) + squares / noise))

    def loss(self, log_variance: float) -> float:
        """Negative log-likelihood of all rows."""
        return float(np.sum(self.losses(float(np.exp(log_variance)))))

    def sd_at(self, best: OptimizeResult) -> tuple[float, float]:
        """Standard deviation of jitter, s, at the optimum of `loss`, and the standard error of that."""
        at, step = float(best.x), 0.05
        curve = (self.loss(at + step) - 2 * best.fun + self.loss(at - step)) / step**2
        rest = 1 - 1 / (2 * CAL.rows_beside + 1)  # of its variance remains once the mean is subtracted

        def square(v: float) -> float:
            return v * self.left(v, self.brief)

        variance = float(np.exp(at))
        tau = float(np.sqrt(square(variance) / rest))
        low, high = (variance * float(np.exp(side)) for side in (-step, step))
        follows = float(np.log(square(high) / square(low)) / (2 * step))  # of tau, noise refitted
        return tau, float(0.5 * tau * follows / np.sqrt(max(curve, 1e-3)))


def _gain_of_separate_jitters(a: Array, z: Array, use: NDArray[np.bool_], v: float) -> float:
    """Log-likelihood gained by a separate jitter for each channel, over one jitter for all, of variance v over noise.

    Parameters
    ----------
    a, z : (N, channels) rates, and residuals less the mean of their neighbours, over the noise.
    use : (N, channels) where rates are known.
    """
    apart = 0.0
    for c in range(a.shape[1]):
        known = use[:, c] & (a[:, c] != 0)
        if np.count_nonzero(known) < CAL.fewest_jumps:
            continue
        h, squares = a[known, c] ** 2, z[known, c] ** 2

        def loss(log_variance: float, h: Array = h, squares: Array = squares) -> float:
            spread = 1 + np.exp(log_variance) * h
            return float(0.5 * (np.sum(np.log(spread)) + len(h) * np.log(max(np.mean(squares / spread), 1e-300))))

        alone = minimize_scalar(loss, bounds=VARIANCES, method="bounded")
        apart += max(loss(np.log(v)) - float(alone.fun), 0.0)
    return apart


def _correlation_of_rows(a: Array, z: Array, v: float, runs: Sequence[slice]) -> float:
    """By how many sds the time errors of neighbouring rows correlate: jitter is independent from row to row.

    Parameters
    ----------
    a, z : (N, channels) rates, and residuals less the mean of their neighbours, over the noise.
    v : variance of jitter over that of noise; rows count where it would exceed the noise.
    runs : rows of each.
    """
    h = np.sum(a**2, axis=1)
    known = v * h > 1.0
    t = np.where(known, np.sum(a * z, axis=1) / np.sqrt(np.maximum(h, 1e-300)), 0.0)
    pairs = np.concatenate([np.arange(run.start, run.stop - 1) for run in runs if run.stop > run.start + 1])
    pairs = pairs[known[pairs] & known[pairs + 1]]
    if len(pairs) < CAL.fewest_jumps:
        return 0.0
    one, other = t[pairs], t[pairs + 1]
    K = 2 * CAL.rows_beside + 1
    by_chance = -(K + 1) / (K * (K - 1))  # for white noise less the mean of K rows
    alike = float(np.sum(one * other) / np.sqrt(np.sum(one**2) * np.sum(other**2)))
    return (alike - by_chance) * float(np.sqrt(len(pairs)))


def order_gain(jumps: Array, z: Array) -> float:
    """Log-likelihood gained if each row comes before or after its command at random, over the same share for all rows.

    Parameters
    ----------
    jumps : (N, channels) by which readings before and after differ, over their noise.
    z : (N, channels) residuals less the mean of their neighbours, over the noise; its size is refitted in both.
    """
    jumping = np.any(jumps != 0, axis=1)
    j, z = jumps[jumping], z[jumping]
    count = np.count_nonzero(j)
    if count < CAL.fewest_jumps:
        return 0.0
    z = np.where(j != 0, z, 0.0)
    across, along, length = np.sum(z**2, axis=1), np.sum(z * j, axis=1), np.sum(j**2, axis=1)
    alike = float(np.sum(across) - np.sum(along) ** 2 / np.sum(length)) / count
    best = -np.inf
    for share in CAL.jump_shares:  # of each jump that the best model has absorbed
        ends = [across - 2 * c * along + c**2 * length for c in (share, share - 1.0)]

        def loss(log_variance: float, ends: Sequence[Array] = ends) -> float:
            halves = np.logaddexp(*(-0.5 * end * np.exp(-log_variance) for end in ends)) - np.log(2.0)
            return float(0.5 * count * log_variance - np.sum(halves))

        at = np.log(max(alike, 1e-300))
        best = max(best, -float(minimize_scalar(loss, bounds=(at - 3.0, at + 0.1), method="bounded").fun))
    without = -0.5 * count * (np.log(max(alike, 1e-300)) + 1.0)
    return max(float(best - without - np.log(len(CAL.jump_shares))), 0.0)


def _less_neighbours(z: Array, good: NDArray[np.bool_], runs: Sequence[slice]) -> Array:
    """(N, channels) residuals that count, less the mean of their neighbours."""
    result = z.copy()
    for rows in runs:
        around = [uniform_filter1d(item[rows].astype(float), 2 * CAL.rows_beside + 1, axis=0) for item in (z, good)]
        result[rows] -= around[0] / np.maximum(around[1], 1e-9)
    return result


def jumps_by_commands(bench: FreeRuns, p: Array, effects: Mapping[str, Effect]) -> Array | None:
    """(N, channels) by which readings would differ had they been taken before their row's command, if that is known."""
    if bench.learnt or AT_ONCE not in effects or not any(np.any(run.held) for run in bench.runs):
        return None
    name, names = effects[AT_ONCE].parameter.name, [parameter.name for parameter in bench.model.parameters]
    if name not in names or p[index := names.index(name)] != 0:
        return None
    early = p.copy()
    early[index] = CAL.early
    after, before = bench.simulate(np.array([p, early]))
    return np.where(bench.counted & (np.abs(before - after) > 0), before - after, 0.0)


def jitters(bench: FreeRuns, base: Array, best: Array, sd: Array, good: NDArray[np.bool_], jump: Array | None) -> bool:
    """Whether jitter alone explains more than the best hypothesis, and the latter explains little beside it.

    Where a command makes readings jump, an early reading does not follow from rates, and delays and lags explain it in
    part: where the size of these jumps is unknown, only the other readings count. A hypothesis that explains little
    leaves more than noise where jitter leaves noise, and gains nothing where jitter does not act.

    Parameters
    ----------
    bench, sd, good, jump : as for `jitter`.
    base, best : (N, channels) residuals without any effect, and with the best explanation's.
    """
    y = np.where(bench.counted, base + bench.measured, 0.0)
    scatter = sole_jitter(bench, base, y, sd, good, jump)
    known = good if jump is not None else steady_rates(bench, y, sd, good)[1]
    gain = 0.5 * float(np.sum(np.where(known, (base / sd) ** 2 - (best / sd) ** 2, 0.0)))
    if scatter is None or scatter_probability(scatter.gain) <= CAL.present:
        return False
    beside = jitter(bench, best, y, sd, good, jump)
    if beside is not None and scatter.left - beside.left > CAL.excess_exact:  # it explains what jitter leaves
        return gain + beside.gain - scatter.gain < CAL.cost
    if scatter.gain >= gain:
        return True
    use = steady_rates(bench, y, sd, good)[1]
    elsewhere = known & ~use & (jump == 0 if jump is not None else True)
    there = 0.5 * float(np.sum(np.where(elsewhere, (base / sd) ** 2 - (best / sd) ** 2, 0.0)))
    left = float(np.mean((best / sd)[use] ** 2)) if np.any(use) else 1.0
    return there < CAL.cost and left - scatter.left > CAL.excess_exact


def sole_jitter(
    bench: FreeRuns, e: Array, y: Array, sd: Array, good: NDArray[np.bool_], jump: Array | None
) -> Scatter | None:
    """Jitter beside which only noise is left: model error that lasts a row or two looks like jitter as well."""
    scatter = jitter(bench, e, y, sd, good, jump)
    return scatter if scatter is not None and scatter.left <= CAL.unnamed_noise**2 else None


def scatter_probability(gain: float) -> float:
    """The probability of an effect on scatter, by its log-likelihood."""
    return float(expit(gain - CAL.cost_without_forces))
