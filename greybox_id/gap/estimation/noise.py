"""Noise of the channels: its size, stated or estimated, and its correlation from row to row.

Residuals of every channel are modelled as an autoregressive process of low order. Whitened by it, they count as often
as they hold something new, and slow model-form errors, which look like coloured noise, do not drown what is fast.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import median_filter

from ...base.shorthands import Array
from ...base.statistics import robust_sd, white_noise_sd
from ...engine.simulation import FreeRuns
from ...models.vehicle import Vehicle
from .calibration import CAL


class Whitener(Protocol):
    """How residuals are whitened: innovations over their standard deviation."""

    @property
    def usable(self) -> NDArray[np.bool_]:
        """(N, channels) readings that count."""

    @property
    def readings(self) -> int:
        """Number of readings that count."""

    @property
    def stationary_sd(self) -> Array:
        """(channels,) standard deviation of a reading's error."""

    def white(self, values: Array) -> Array:
        """Innovations over their standard deviation, (N, channels, ...); zero where no reading counts."""


@dataclass(frozen=True)
class AutoregressiveNoise:
    """Whitening by an autoregressive process per channel.

    Attributes
    ----------
    sd : (channels,) standard deviation of the innovations.
    ar : per channel, its autoregressive coefficients.
    rows : slices of unbroken runs.
    usable : (N, channels) whether an innovation counts: its reading and those before it that it needs exist and are
        sound.
    """

    sd: Array
    ar: tuple[Array, ...]
    rows: tuple[slice, ...]
    usable: NDArray[np.bool_]

    def white(self, values: Array) -> Array:
        """Innovations over their standard deviation, (N, channels, ...); zero where no reading counts."""
        result = np.empty(values.shape)
        for c, a in enumerate(self.ar):
            value = values[:, c]
            if len(a) and value.size:  # without nuisances there is nothing to filter
                value = np.concatenate([_innovations(value[rows], a) for rows in self.rows])
            result[:, c] = value * (self.usable[:, c] / self.sd[c]).reshape(-1, *[1] * (values.ndim - 2))
        return result

    @property
    def stationary_sd(self) -> Array:
        """(channels,) standard deviation of the residuals themselves, where the process is stationary."""
        return np.array([s * np.sqrt(_gain(a)) for s, a in zip(self.sd, self.ar, strict=True)])

    @property
    def readings(self) -> int:
        """Number of innovations that count."""
        return int(np.sum(self.usable))


def white_noise(sd: Array, good: NDArray[np.bool_], rows: Sequence[slice]) -> AutoregressiveNoise:
    """Noise without memory."""
    return AutoregressiveNoise(np.asarray(sd, dtype=float), tuple(np.empty(0) for _ in sd), tuple(rows), good)


def colour(residuals: Array, good: NDArray[np.bool_], rows: Sequence[slice]) -> AutoregressiveNoise:
    """The autoregressive process that describes residuals, (N, channels), where they are good, in unbroken runs."""
    sd, ar, usable = [], [], np.zeros_like(good)
    for c in range(residuals.shape[1]):
        s, a = _fitted(np.where(good[:, c], residuals[:, c], 0.0), good[:, c], rows)
        sd.append(s)
        ar.append(a)
        usable[:, c] = _all_there(good[:, c], rows, len(a))
    return AutoregressiveNoise(np.array(sd), tuple(ar), tuple(rows), usable)


def without_spikes(
    residuals: Array, counted: NDArray[np.bool_], rows: Sequence[slice], spike: float = CAL.spike
) -> NDArray[np.bool_]:
    """(N, channels) readings that count and whose residuals are no spikes among their neighbours'."""
    good, around = counted & np.isfinite(residuals), 2 * CAL.rows_beside + 1
    for c in range(residuals.shape[1]):
        for row in rows:
            e = np.where(good[row, c], residuals[row, c], np.nan)
            if np.count_nonzero(np.isfinite(e)) <= 2 * around:
                continue
            filled = np.interp(np.arange(len(e)), np.flatnonzero(np.isfinite(e)), e[np.isfinite(e)])
            off = e - median_filter(filled, around, mode="mirror")
            spread = robust_sd(off[np.isfinite(off) & (off != 0)]) if np.any(off != 0) else 0.0
            good[row, c] &= ~(np.abs(off) > spike * max(spread, 1e-300))
    return good


def _fitted(e: Array, good: NDArray[np.bool_], rows: Sequence[slice]) -> tuple[float, Array]:
    """Innovations' standard deviation, and coefficients of the order of least BIC."""
    most = CAL.colour_order
    usable = _all_there(good, rows, most)
    count = int(np.sum(usable))
    if count < CAL.coefficient_rows * (most + 1):
        there = e[good]
        return float(np.sqrt(np.mean(there**2))) if len(there) else 1.0, np.empty(0)
    lagged = np.zeros((len(e), most + 1))
    for row in rows:
        for lag in range(most + 1):
            lagged[row.start + lag : row.stop, lag] = e[row.start : row.stop - lag]
    A = lagged[usable]
    G = A.T @ A
    best = (np.inf, 1.0, np.empty(0))
    for order in range(most + 1):
        a = np.linalg.solve(G[1 : order + 1, 1 : order + 1], G[1 : order + 1, 0]) if order else np.empty(0)
        variance = max(float(G[0, 0] - a @ G[1 : order + 1, 0]) / count, 1e-300)
        score = count * np.log(variance) + order * np.log(count)
        if score < best[0] - 1e-9:
            best = (float(score), variance, np.asarray(a))
    return float(np.sqrt(best[1])), best[2]


def _all_there(good: NDArray[np.bool_], rows: Sequence[slice], order: int) -> NDArray[np.bool_]:
    """(N,) whether a row and the `order` rows before it are good."""
    result = np.zeros_like(good)
    for row in rows:
        there = good[row].copy()
        for lag in range(1, order + 1):
            there[lag:] &= good[row][:-lag]
            there[:lag] = False
        result[row] = there
    return result


def _gain(a: Array) -> float:
    """Variance of a process over that of its innovations; bounded, for a process that is nearly integrating."""
    if len(a) == 0:
        return 1.0
    response = np.zeros(len(a) + 2001)
    response[len(a)] = 1.0
    for k in range(len(a) + 1, len(response)):
        response[k] = response[k - len(a) : k] @ a[::-1]
    return float(min(np.sum(np.minimum(response**2, CAL.colour_gain)), CAL.colour_gain))


def _innovations(values: Array, a: Array) -> Array:
    """Innovations, (n, ...), of a process with these coefficients, taken to be zero before it begins."""
    result = values.copy()
    for lag, item in enumerate(a, 1):
        result[lag:] -= item * values[:-lag]
    return result


def stated_noise(bench: FreeRuns, vehicle: Vehicle | None, residuals: Array) -> tuple[Array, bool]:
    """Standard deviation of each channel's noise, (channels,), and whether all of them were stated.

    Parameters
    ----------
    vehicle : noise of its sensors as stated; of a map with memory, the error after training, which holds in any case.
    residuals : (N, channels) of any model: slow model error does not count as noise.
    """
    stated = vehicle.noise if vehicle is not None else {}
    result, known = [], True
    for c, channel in enumerate(bench.channels):
        counted = bench.counted[:, c]
        if not np.any(counted):
            result.append(1.0)
            continue
        e = residuals[counted, c]
        spread = robust_sd(e - np.median(e))
        held = bench.learnt or spread > CAL.too_large * stated.get(channel, 0.0)
        if channel in stated and held:
            result.append(stated[channel])
            continue
        known = known and channel in stated
        fast = white_noise_sd([bench.measured[rows, c] for rows in bench.rows])
        least = max(1e-9 * float(np.max(np.abs(bench.measured[counted, c]))), 1e-12)
        result.append(1.0 if np.isnan(fast) else max(fast, least))
    return np.array(result), known


def blocks(bench: FreeRuns, seconds: float = 4 * CAL.memory) -> list[tuple[int, int]]:
    """Rows [a, b) of stretches over which residuals may be correlated, none of them across runs."""
    length = max(1, round(seconds / bench.sample_time))
    return [(a, min(a + length, rows.stop)) for rows in bench.rows for a in range(rows.start, rows.stop, length)]
