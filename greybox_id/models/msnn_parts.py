"""Building blocks of model-structured networks: local models over evenly spaced centres, and decaying FIR filters."""

from __future__ import annotations

from collections.abc import Sequence

import casadi as cs
import numpy as np

from ..base.errors import BadInput
from ..base.shorthands import Array
from .model import Symbol
from .parameter import Prior


def memberships(x: Symbol, centres: Sequence[float]) -> list[Symbol]:
    """Piecewise linear activations psi_j(x): 1 at centre j, 0 at its neighbours, summing to 1 everywhere.

    Beyond the outermost centres the outermost activation stays 1.
    Source: Mungiello et al., Vehicle dynamics learning from physics priors, Eq. 4 and Fig. 2b.
    """
    _increasing(centres, "of a membership function")
    last = len(centres) - 1
    rising = [cs.fmin(1, cs.fmax(0, (x - a) / (b - a))) for a, b in zip(centres[:-1], centres[1:], strict=True)]
    return [(rising[j - 1] if j > 0 else 1) - (rising[j] if j < last else 0) for j in range(last + 1)]


def evenly(low: float, high: float, count: int) -> tuple[float, ...]:
    """`count` centres evenly spaced from low to high; a single one in the middle."""
    if count == 1:
        return ((low + high) / 2,)
    return tuple(low + (high - low) * k / (count - 1) for k in range(count))


def over(values: Array, count: int, symmetric: bool = False) -> tuple[float, ...]:
    """Centres evenly spaced over the range of recorded values, mirrored about zero where `symmetric`."""
    known = values[np.isfinite(values)]
    low, high = (float(np.min(known)), float(np.max(known))) if known.size else (-1.0, 1.0)
    if symmetric:
        high = max(abs(low), abs(high))
        low = -high
    if high - low < 1e-6:  # a constant channel: centres are arbitrary, but must differ
        low, high = low - 1.0, high + 1.0
    return evenly(low, high, count)


def centres(name: str, given: tuple[float, ...] | None, count: int, low: float, high: float) -> tuple[float, ...]:
    """The centres given, or evenly spaced ones; their number must be `count`."""
    if given is None:
        return evenly(low, high, count)
    if len(given) != count:
        raise BadInput(f"{count} local models over {name} were asked for, but {len(given)} centres are given.")
    _increasing(given, f"over {name}")
    return given


def _increasing(centres: Sequence[float], what: str) -> None:
    if not all(a < b for a, b in zip(centres[:-1], centres[1:], strict=True)):
        raise BadInput(f"The centres {what} must increase; they are {list(centres)}.")


def fading(length: int, samples: float = 3.0) -> Array:
    """An impulse response that decays with a time constant of `samples` samples, oldest first, with unit gain."""
    if length < 1:
        raise BadInput(
            "A window holds at least the newest sample, so the number of samples before it must be 0 or "
            f"more, not {length - 1}."
        )
    weights = np.exp(-np.arange(length)[::-1] / samples)
    return np.asarray(weights / weights.sum())


def fading_prior(
    length: int, sd: float, decay: float, axes: int, mean: float | None = None, strength: str = ""
) -> Prior:
    """Tuned/correlated prior on impulse responses along the last of `axes` axes, oldest sample first.

    The covariance of ages i and j is sd^2 min(decay^i, decay^j): independent increments that shrink with age, and a
    response that vanishes with age. Source: Chen, Ohlsson & Ljung, Automatica 48 (2012) 1525, kernel TC.

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
