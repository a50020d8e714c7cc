"""Finite impulse responses and what is believed of them before the data: they fade, and fade smoothly."""

from __future__ import annotations

import numpy as np

from ..errors import BadInput
from ..parameter import Array, Prior


def fading(length: int, samples: float = 3.0) -> Array:
    """An impulse response that fades over `samples` samples, oldest first, with unit gain."""
    if length < 1:
        raise BadInput(f"A window holds the newest sample at least; {length - 1} samples before it were asked for.")
    weights = np.exp(-np.arange(length)[::-1] / samples)
    return np.asarray(weights / weights.sum())


def fading_prior(
    length: int, sd: float, decay: float, axes: int, mean: float | None = None, strength: str = ""
) -> Prior:
    """Tuned/correlated prior on impulse responses that lie along the last of `axes` axes, oldest sample first.

    The covariance of ages i and j is sd^2 min(decay^i, decay^j): independent steps that shrink with age, and a
    response that is gone when it is old. Source: Chen, Ohlsson & Ljung, Automatica 48 (2012) 1525, kernel TC.

    Parameters
    ----------
    length : samples in a response.
    sd : standard deviation of its newest weight.
    decay : factor of the variance per sample of age, 0 < decay < 1.
    axes : number of axes of the parameter.
    mean : mean of every weight; None takes the parameter's nominal response.
    """
    variance = sd**2 * decay ** np.arange(length)[::-1]
    oldest = np.full(length, np.inf)
    oldest[0] = np.sqrt(variance[0])
    return Prior(oldest, mean, step_sd=(*[None] * (axes - 1), np.sqrt(np.diff(variance))), strength=strength)
