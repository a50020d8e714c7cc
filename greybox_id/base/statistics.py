"""Series of numbers: spectra, correlations, how long these last, moving filters, intervals by drawing blocks of rows.

In numpy alone: SciPy has filters and spectra too, but loading them takes longer than reading and checking most files.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from .shorthands import Array

NORMAL = 1.959964
"""Half of a 95 % interval, in standard deviations of a normal distribution."""
MIDDLE_HALF = 1.4826
"""A normal distribution's standard deviation over the median of its size."""


def robust_sd(values: Array) -> float:
    """Standard deviation of normal numbers about zero, by the median of their sizes: outliers hardly count."""
    return MIDDLE_HALF * float(np.median(np.abs(values)))


def white_noise_sd(parts: Sequence[Array], *, held: bool = False) -> float:
    """Standard deviation of the white noise of readings, by how far they are from the line between their neighbours.

    Parameters
    ----------
    parts : unbroken series, (n,) each, NaN where nothing was read.
    held : whether readings stay where they are between updates: rows on such lines then do not count.

    Returns
    -------
    NaN where no row has both neighbours.
    """
    bends = np.concatenate([np.diff(part, 2) for part in parts]) if len(parts) else np.empty(0)
    bends = bends[np.isfinite(bends) & (bends != 0 if held else True)]
    return robust_sd(bends) / np.sqrt(6.0) if len(bends) else np.nan


def welch(values: Array, rate: float, length: int) -> tuple[Array, Array]:
    """Welch's power spectral density: Hamming windows of `length` samples overlapping by half, each without its mean.

    Parameters
    ----------
    values : (n,), n at least `length`.
    rate : samples per second.

    Returns
    -------
    Frequencies, Hz, and the one-sided density, per Hz.
    """
    # scipy.signal has the same and takes as long to load as a case to diagnose
    window = 0.54 - 0.46 * np.cos(2.0 * np.pi * np.arange(length) / length)
    pieces = np.lib.stride_tricks.sliding_window_view(values, length)[:: length - length // 2]
    spectra = np.fft.rfft((pieces - np.mean(pieces, axis=1, keepdims=True)) * window)
    density = np.mean(np.abs(spectra) ** 2, axis=0) / (rate * float(window @ window))
    density[1 : (length + 1) // 2] *= 2.0
    return np.asarray(np.fft.rfftfreq(length, 1.0 / rate), dtype=float), np.asarray(density, dtype=float)


def detrended(values: Array) -> Array:
    """A series without its straight line of least squares."""
    if len(values) < 2:
        return np.zeros(len(values))
    along = np.arange(len(values)) - 0.5 * (len(values) - 1)
    return np.asarray(values - np.mean(values) - along * (along @ values) / (along @ along))


def correlation(parts: Sequence[tuple[Array, Array]], most: int) -> Array:
    """Correlations of two signals over several unbroken stretches at lags 0 to `most` samples of the first.

    Parameters
    ----------
    parts : pairs of equally long stretches (a, b); means are those of all stretches together.

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
    """Integrated autocorrelation time of residuals, rows: 1 + 2 sum of autocorrelations, the longest of all outputs.

    Residuals average over so many rows as if they were one. The sum ends at five times itself (Sokal, Monte Carlo
    methods in statistical mechanics, 1997). About zero, not about their mean: a lasting offset is correlation too.

    Parameters
    ----------
    residuals : (rows, outputs), zero where there was no reading.
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
"""Lags over which products are summed at first, and times so many more until their sum ends: a day of readings then
takes no more memory than a minute."""


def _products(values: Array, lags: int) -> Array:
    """(lags,) sums of the products of a series, (n,), with itself so many rows later, part by part."""
    size = 1 << (4 * lags - 1).bit_length()
    result, step = np.zeros(lags), size - lags
    for first in range(0, len(values), step):
        part, ahead = values[first : first + step], values[first : first + size]
        spectrum = np.conj(np.fft.rfft(part, size)) * np.fft.rfft(ahead, size)
        result += np.fft.irfft(spectrum, size)[:lags]
    return result


def resampled(sums: Array, of: Callable[[Array], Any], draws: int) -> Array:
    """The ends of a 95 % interval by drawing blocks with replacement (Kunsch, Annals of Statistics 17, 1989).

    Parameters
    ----------
    sums : (blocks, columns) sums over the rows of each block.
    of : sums of a draw, (columns,) -> what the interval is of.
    draws : how many; the same every time.

    Returns
    -------
    (2, ...) low and high.
    """
    rng = np.random.default_rng(0)
    drawn = [of(np.sum(sums[rng.integers(len(sums), size=len(sums))], axis=0)) for _ in range(draws)]
    return np.asarray(np.quantile(drawn, (0.025, 0.975), axis=0))


REACH = 4.0
"""Standard deviations after which a Gaussian is nothing."""


def moving_mean(values: Array, width: int) -> Array:
    """(n,) mean of `width` values about each, an odd number; the series is mirrored at its ends."""
    mirrored = np.pad(values, width // 2, mode="symmetric")
    return np.convolve(mirrored, np.full(width, 1.0 / width), mode="valid")


def smoothed(values: Array, sd: float) -> Array:
    """(n,) values under a Gaussian of so many rows' standard deviation; the series is mirrored at its ends."""
    reach = int(REACH * sd + 0.5)
    weights = np.exp(-0.5 * (np.arange(-reach, reach + 1) / sd) ** 2)
    return np.convolve(np.pad(values, reach, mode="symmetric"), weights / np.sum(weights), mode="valid")


def moving_maximum(values: Array, width: int) -> Array:
    """(n,) greatest of `width` values about each, an odd number; beyond the ends there are none."""
    result, size = np.pad(values, width // 2, constant_values=-np.inf), 1
    while 2 * size <= width:
        result, size = np.maximum(result[:-size], result[size:]), 2 * size
    rest = width - size
    return np.maximum(result[:-rest], result[rest:]) if rest else result


def median_of_five(values: Array) -> Array:
    """(n,) median of five values about each; the series is mirrored at its first and its last value."""
    padded, count = np.pad(values, 2, mode="reflect"), len(values)
    a, b, c, d, e = (padded[k : k + count] for k in range(5))
    low, high = np.maximum(np.minimum(a, b), np.minimum(c, d)), np.minimum(np.maximum(a, b), np.maximum(c, d))
    middle: Array = np.maximum(np.minimum(low, high), np.minimum(np.maximum(low, high), e))
    return middle


class CubicSpline:
    """The cubic spline through equally spaced values, read at places that are equally spaced as well.

    Its coefficients are the values' convolution with the kernel that undoes the weights 1/6, 4/6, 1/6, which falls by
    2 - sqrt(3) with each row; the series goes on turned about its ends. Source: Unser, Splines: a perfect fit for
    signal and image processing, IEEE Signal Processing Magazine 16 (1999).
    """

    def __init__(self, values: Array) -> None:
        fall, reach = np.sqrt(3.0) - 2.0, min(PREFILTER, len(values) - 1)
        kernel = np.sqrt(3.0) * fall ** np.abs(np.arange(-reach, reach + 1))
        self._before = 2
        turned = np.pad(values, reach + self._before, mode="reflect", reflect_type="odd")
        self._coefficients = np.convolve(turned, kernel, mode="valid")

    def shifted(self, first: int, count: int, by: float) -> Array:
        """(count,) values at first + by, first + 1 + by, ...; within the series, or a row beyond."""
        whole = int(np.floor(by))
        t = by - whole
        weights = np.array([(1 - t) ** 3, 3 * t**3 - 6 * t**2 + 4, -3 * t**3 + 3 * t**2 + 3 * t + 1, t**3]) / 6.0
        begin = first + whole - 1 + self._before
        coefficient = self._coefficients[begin : begin + count + 3]
        return np.convolve(coefficient, weights[::-1], mode="valid")


PREFILTER = 28
"""Rows after which the kernel of a spline's coefficients is 1e-16."""
