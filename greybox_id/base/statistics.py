"""Statistics of series: spectra, correlations and their times, moving filters, block bootstrap, cubic splines.

In numpy alone: SciPy has most of these, but takes longer to load than most files to read and check.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from .shorthands import Array

NORMAL = 1.959964
"""Half-width of a 95 % interval of a normal distribution, in standard deviations."""
MIDDLE_HALF = 1.4826
"""Standard deviation of a zero-mean normal variable over the median of its absolute value."""


def robust_sd(values: Array) -> float:
    """Standard deviation about zero from the median absolute value: robust against outliers."""
    return MIDDLE_HALF * float(np.median(np.abs(values)))


def white_noise_sd(parts: Sequence[Array], *, held: bool = False) -> float:
    """Standard deviation of white measurement noise, from the second differences of the readings.

    Parameters
    ----------
    parts : contiguous series, (n,) each, NaN where there is no reading.
    held : whether the sensor repeats its last reading between updates: second differences of zero are then ignored.

    Returns
    -------
    NaN if no reading has both neighbours.
    """
    bends = np.concatenate([np.diff(part, 2) for part in parts]) if len(parts) else np.empty(0)
    bends = bends[np.isfinite(bends) & (bends != 0 if held else True)]
    return robust_sd(bends) / np.sqrt(6.0) if len(bends) else np.nan


def welch(values: Array, rate: float, length: int) -> tuple[Array, Array]:
    """Welch's power spectral density: Hamming windows of `length` samples overlapping by half, each less its mean.

    Parameters
    ----------
    values : (n,), n at least `length`.
    rate : samples per second.

    Returns
    -------
    Frequencies, Hz, and the one-sided density, per Hz.
    """
    # not scipy.signal.welch: SciPy takes too long to load
    window = 0.54 - 0.46 * np.cos(2.0 * np.pi * np.arange(length) / length)
    pieces = np.lib.stride_tricks.sliding_window_view(values, length)[:: length - length // 2]
    spectra = np.fft.rfft((pieces - np.mean(pieces, axis=1, keepdims=True)) * window)
    density = np.mean(np.abs(spectra) ** 2, axis=0) / (rate * float(window @ window))
    density[1 : (length + 1) // 2] *= 2.0
    return np.asarray(np.fft.rfftfreq(length, 1.0 / rate), dtype=float), np.asarray(density, dtype=float)


def detrended(values: Array) -> Array:
    """A series less its least-squares straight line."""
    if len(values) < 2:
        return np.zeros(len(values))
    along = np.arange(len(values)) - 0.5 * (len(values) - 1)
    return np.asarray(values - np.mean(values) - along * (along @ values) / (along @ along))


def correlation(parts: Sequence[tuple[Array, Array]], most: int) -> Array:
    """Cross-correlation of two signals over several contiguous stretches at lags 0 to `most` samples.

    Parameters
    ----------
    parts : pairs of equally long stretches (a, b); each signal's mean over all stretches is subtracted.

    Returns
    -------
    (most + 1,) correlations of a(t + lag) with b(t); NaN where a signal does not vary.
    """
    means = [float(np.mean(np.concatenate([part[k] for part in parts]))) for k in (0, 1)]
    sums, powers = np.zeros(most + 1), np.zeros(2)
    for a, b in ((a - means[0], b - means[1]) for a, b in parts):
        size = 1 << (len(a) + most).bit_length()
        products = np.fft.irfft(np.fft.rfft(a, size) * np.conj(np.fft.rfft(b, size)), size)
        reach = min(most + 1, len(a))
        sums[:reach] += products[:reach]
        powers += [float(a @ a), float(b @ b)]
    scale = float(np.sqrt(powers[0] * powers[1]))
    return sums / scale if scale > 0 else np.full(most + 1, np.nan)


def correlation_time(residuals: Array) -> float:
    """Integrated autocorrelation time of residuals in rows: 1 + 2 sum of autocorrelations, the longest of all outputs.

    n rows carry the information of n / time independent ones. The sum is truncated at five times its value (Sokal,
    Monte Carlo methods in statistical mechanics, 1997). Autocorrelations are about zero, not about the mean, because
    a constant offset is correlation too.

    Parameters
    ----------
    residuals : (rows, outputs), zero where there is no reading.
    """
    rows = len(residuals)
    share = np.count_nonzero(residuals, axis=0) / max(1, rows)
    residuals, share = residuals[:, share > 0.0], share[share > 0.0]
    if residuals.size == 0:
        return 1.0
    lags = min(rows, FIRST_LAGS)
    while True:
        products = np.column_stack([_products(item, lags) for item in residuals.T])
        times = 2.0 * np.cumsum(products / products[0], axis=0) - 1.0
        enough = np.arange(lags)[:, None] * share >= 5.0 * times
        if lags == rows or np.all(np.any(enough, axis=0)):
            break
        lags = min(rows, MORE_LAGS * lags)
    last = np.where(np.any(enough, axis=0), np.argmax(enough, axis=0), lags - 1)
    return max(1.0, float(np.max(times[last, np.arange(len(share))] / share)))


FIRST_LAGS, MORE_LAGS = 4096, 8
"""Number of lags tried first, and factor by which it grows until the sum can be truncated: a day of readings then
takes no more memory than a minute."""


def _products(values: Array, lags: int) -> Array:
    """(lags,) unnormalised autocorrelation of a series (n,), computed block by block."""
    size = 1 << (4 * lags - 1).bit_length()
    result, step = np.zeros(lags), size - lags
    for first in range(0, len(values), step):
        part, ahead = values[first : first + step], values[first : first + size]
        spectrum = np.conj(np.fft.rfft(part, size)) * np.fft.rfft(ahead, size)
        result += np.fft.irfft(spectrum, size)[:lags]
    return result


def resampled(sums: Array, of: Callable[[Array], Any], draws: int) -> Array:
    """95 % interval by the block bootstrap (Kunsch, Annals of Statistics 17, 1989).

    Parameters
    ----------
    sums : (blocks, columns) sums over the rows of each block.
    of : total sums of a draw, (columns,) -> the statistic.
    draws : number of bootstrap draws, with a fixed random seed.

    Returns
    -------
    (2, ...) lower and upper ends.
    """
    rng = np.random.default_rng(0)
    drawn = [of(np.sum(sums[rng.integers(len(sums), size=len(sums))], axis=0)) for _ in range(draws)]
    return np.asarray(np.quantile(drawn, (0.025, 0.975), axis=0))


REACH = 4.0
"""Standard deviations at which the Gaussian kernel is truncated."""


def moving_mean(values: Array, width: int) -> Array:
    """(n,) centred moving mean over `width` values, an odd number; the series is mirrored at its ends."""
    mirrored = np.pad(values, width // 2, mode="symmetric")
    return np.convolve(mirrored, np.full(width, 1.0 / width), mode="valid")


def smoothed(values: Array, sd: float) -> Array:
    """(n,) values smoothed by a Gaussian kernel of `sd` rows; the series is mirrored at its ends."""
    reach = int(REACH * sd + 0.5)
    weights = np.exp(-0.5 * (np.arange(-reach, reach + 1) / sd) ** 2)
    return np.convolve(np.pad(values, reach, mode="symmetric"), weights / np.sum(weights), mode="valid")


def moving_maximum(values: Array, width: int) -> Array:
    """(n,) centred moving maximum over `width` values, an odd number; fewer at the ends."""
    result, size = np.pad(values, width // 2, constant_values=-np.inf), 1
    while 2 * size <= width:
        result, size = np.maximum(result[:-size], result[size:]), 2 * size
    rest = width - size
    return np.maximum(result[:-rest], result[rest:]) if rest else result


def median_of_five(values: Array) -> Array:
    """(n,) centred moving median of five values; the series is mirrored at its first and its last value."""
    padded, count = np.pad(values, 2, mode="reflect"), len(values)
    a, b, c, d, e = (padded[k : k + count] for k in range(5))
    low, high = np.maximum(np.minimum(a, b), np.minimum(c, d)), np.minimum(np.maximum(a, b), np.maximum(c, d))
    middle: Array = np.maximum(np.minimum(low, high), np.minimum(np.maximum(low, high), e))
    return middle


class CubicSpline:
    """Interpolating cubic spline through equally spaced values, evaluated at equally spaced places.

    Its coefficients are the values convolved with the inverse of the B-spline weights 1/6, 4/6, 1/6, a kernel that
    decays by 2 - sqrt(3) per row; the series is continued by point reflection at its ends. Source: Unser, Splines: a
    perfect fit for signal and image processing, IEEE Signal Processing Magazine 16 (1999).
    """

    def __init__(self, values: Array) -> None:
        fall, reach = np.sqrt(3.0) - 2.0, min(PREFILTER, len(values) - 1)
        kernel = np.sqrt(3.0) * fall ** np.abs(np.arange(-reach, reach + 1))
        self._before = 2
        turned = np.pad(values, reach + self._before, mode="reflect", reflect_type="odd")
        self._coefficients = np.convolve(turned, kernel, mode="valid")

    def shifted(self, first: int, count: int, by: float) -> Array:
        """(count,) values at rows first + by, first + 1 + by, ...; at most one row beyond the ends of the series."""
        whole = int(np.floor(by))
        t = by - whole
        weights = np.array([(1 - t) ** 3, 3 * t**3 - 6 * t**2 + 4, -3 * t**3 + 3 * t**2 + 3 * t + 1, t**3]) / 6.0
        begin = first + whole - 1 + self._before
        coefficient = self._coefficients[begin : begin + count + 3]
        return np.convolve(coefficient, weights[::-1], mode="valid")


PREFILTER = 28
"""Rows after which the kernel of the spline's coefficients has decayed to 1e-16."""
