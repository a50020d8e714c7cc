"""Draws from the normal distribution that a fit's covariance describes: free of cost, and blind to a bent posterior.

Positive numbers but lengths, times, masses and inertias are drawn in their logarithm, in which fits of vehicles are
closer to normal; what falls beyond a bound is drawn again.
"""

from __future__ import annotations

import numpy as np
import scipy.linalg as la
from numpy.typing import NDArray

from ..errors import BadInput
from ..parameter import Array
from .density import PosteriorDensity

Mask = NDArray[np.bool_]

MOST_TRIES = 1000
"""Times as many draws as are wanted may fall beyond bounds."""
ADDING = ("m", "s", "kg", "kg m^2")
"""Units of numbers that make up sums, as wheelbases and delays do: along these a valley is straight in the numbers
themselves, along products of the others in their logarithms."""
RIDGE = 1e-10
"""Of a covariance in units of its standard deviations: rounding must not make it indefinite."""


def laplace(density: PosteriorDensity, covariance: Array, draws: int, seed: int) -> tuple[Array, Array, float]:
    """Draws, the logarithm of the normal density there (up to a constant), and the share that fell within bounds.

    Parameters
    ----------
    density : whose optimum and bounds they are.
    covariance : (d, d) of the coordinates.
    draws : how many.
    seed : of the draws.

    Raises
    ------
    BadInput : a parameter is not determined, or nearly all draws fall beyond bounds.
    """
    unit, factor, logarithmic = whitening(density, covariance)
    rng, found, logs, tried, kept = np.random.default_rng((seed, 31)), [], [], 0, 0
    while kept < draws:
        z = rng.standard_normal((max(draws, 64), len(unit)))
        with np.errstate(over="ignore"):
            own = coloured(density, z, unit, factor, logarithmic)
        good = density.within(own) & np.all(np.isfinite(own), axis=1)
        tried, kept = tried + len(z), kept + int(np.sum(good))
        found.append(own[good])
        logs.append(-0.5 * np.sum(z[good] ** 2, axis=1))
        if tried > MOST_TRIES * max(draws, 64):
            raise BadInput(
                "Nearly all draws of the fit's normal distribution fall beyond the parameters' bounds: the recordings "
                "do not determine them. Fix some, or give them priors, and fit again."
            )
    return np.concatenate(found)[:draws], np.concatenate(logs)[:draws], kept / tried


def whitening(density: PosteriorDensity, covariance: Array) -> tuple[Array, Array, Mask]:
    """Standard deviations (d,), a factor of the correlations (d, d), and which coordinates go by their logarithm."""
    sd = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    untold = [own.name for own, s in zip(density.coordinates, sd, strict=True) if not np.isfinite(s)]
    if untold:
        raise BadInput(
            f"{', '.join(untold)} is not determined by the recordings, nor by a prior: there is nothing to draw from. "
            "Fix it or give it a prior, and fit again."
        )
    unit = np.where(sd > 0, sd, 1.0)
    correlation = covariance / np.outer(unit, unit)
    correlation[np.diag_indices_from(correlation)] = np.where(sd > 0, 1.0 + RIDGE, RIDGE)
    values, vectors = la.eigh(correlation)
    adds = np.array([own.unit in ADDING for own in density.coordinates])
    logarithmic = (density.bounds[0] >= 0) & (density.centre > 0) & ~adds
    return unit, np.asarray(vectors * np.sqrt(np.maximum(values, 0.0))), logarithmic


def coloured(density: PosteriorDensity, z: Array, unit: Array, factor: Array, logarithmic: Mask) -> Array:
    """Standard normal numbers (n, d) as draws about the optimum."""
    moved = (z @ factor.T) * unit
    size = np.where(logarithmic, density.centre, 1.0)
    return np.asarray(np.where(logarithmic, size * np.exp(moved / size), density.centre + moved))
