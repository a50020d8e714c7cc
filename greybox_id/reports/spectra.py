"""Power spectra and correlations of signals, without the weight of a library for all of them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ..parameter import Array


def welch(values: Array, rate: float, length: int) -> tuple[Array, Array]:
    """Welch's power spectral density: Hamming windows of `length` samples overlapping by half, each without its mean.

    Parameters
    ----------
    values : (n,), n at least `length`.
    rate : samples per second.

    Returns
    -------
    Frequencies, Hz, and the one-sided density, per Hz.

    Source: P. D. Welch, IEEE Trans. Audio Electroacoustics 15, 1967.
    """
    window = 0.54 - 0.46 * np.cos(2 * np.pi * np.arange(length) / length)
    starts = range(0, len(values) - length + 1, length - length // 2)
    parts = np.stack([values[k : k + length] for k in starts])
    power = np.abs(np.fft.rfft((parts - parts.mean(axis=1, keepdims=True)) * window, axis=1)) ** 2
    density = power.mean(axis=0) / (rate * np.sum(window**2))
    density[1 : -1 if length % 2 == 0 else None] *= 2.0
    return np.asarray(np.fft.rfftfreq(length, 1 / rate), dtype=float), np.asarray(density, dtype=float)


def detrended(values: Array) -> Array:
    """Values without their straight line of least squares."""
    at = np.arange(len(values)) - (len(values) - 1) / 2
    power = float(at @ at)
    slope = float(at @ values) / power if power > 0 else 0.0
    return np.asarray(values - values.mean() - slope * at)


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
