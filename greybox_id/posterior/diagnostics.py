"""Whether chains have met, and how many independent draws they are worth.

Source: Vehtari, Gelman, Simpson, Carpenter & Buerkner, Rank-normalization, folding, and localization: an improved
R-hat, Bayesian Analysis 16 (2021), Eq. 1-4, 10, 14; the autocorrelation is cut where a pair of lags sums to less than
zero (Geyer 1992).
"""

from __future__ import annotations

import numpy as np
from scipy.special import ndtri
from scipy.stats import rankdata

from ..parameter import Array

FEWEST = 4
"""Draws of a chain below which nothing can be said."""


def r_hat(chains: Array) -> float:
    """Rank-normalised split R-hat of one parameter, the larger of that of the draws and of the folded ones.

    Parameters
    ----------
    chains : (chains, draws).

    Returns
    -------
    1 where chains have met; NaN where they are shorter than four draws or do not move.
    """
    if chains.size == 0 or chains.shape[1] < FEWEST or np.ptp(chains) == 0:
        return float("nan")
    folded = np.abs(chains - np.median(chains))
    return float(max(_plain_r_hat(_normal_scores(_split(own))) for own in (chains, folded)))


def effective_sample_size(chains: Array) -> float:
    """How many independent draws tell as much of a parameter's middle (bulk), from (chains, draws).

    NaN where chains are shorter than four draws or do not move; never above the number of draws times its logarithm.
    """
    if chains.size == 0 or chains.shape[1] < FEWEST or np.ptp(chains) == 0:
        return float("nan")
    z = _normal_scores(_split(chains))
    count, length = z.shape
    centred = z - np.mean(z, axis=1, keepdims=True)
    size = 1 << int(np.ceil(np.log2(2 * length)))
    spectrum = np.abs(np.fft.rfft(centred, size, axis=1)) ** 2
    covariance = np.fft.irfft(spectrum, size, axis=1)[:, :length] / length
    within = float(np.mean(covariance[:, 0])) * length / (length - 1)
    between = float(np.var(np.mean(z, axis=1), ddof=1)) if count > 1 else 0.0
    total = within * (length - 1) / length + between
    rho = 1.0 - (within - np.mean(covariance, axis=0) * length / (length - 1)) / total
    pairs = rho[: length - length % 2].reshape(-1, 2).sum(axis=1)
    positive = int(np.argmax(pairs < 0)) if np.any(pairs < 0) else len(pairs)
    pairs = np.minimum.accumulate(pairs[: max(positive, 1)])
    tau = max(-1.0 + 2.0 * float(np.sum(pairs)), 1.0 / np.log10(max(z.size, 10)))
    return float(z.size / tau)


def weighted_quantile(values: Array, weight: Array, share: float) -> float:
    """The value below which a share of the weight lies, (n,) each, between neighbours on a straight line."""
    if len(values) == 0:
        return float("nan")
    order = np.argsort(values, kind="stable")
    own = weight[order] / np.sum(weight)
    return float(np.interp(share, np.cumsum(own) - 0.5 * own, values[order]))


def _split(chains: Array) -> Array:
    half = chains.shape[1] // 2
    return np.concatenate([chains[:, :half], chains[:, -half:]])


def _normal_scores(chains: Array) -> Array:
    ranks = rankdata(chains, method="average").reshape(chains.shape)
    return np.asarray(ndtri((ranks - 0.375) / (chains.size + 0.25)))


def _plain_r_hat(z: Array) -> float:
    length = z.shape[1]
    within, between = np.mean(np.var(z, axis=1, ddof=1)), np.var(np.mean(z, axis=1), ddof=1)
    return float(np.sqrt((length - 1) / length + between / within)) if within > 0 else float("nan")
