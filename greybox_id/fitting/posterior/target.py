"""What is drawn from: the posterior as wide as the fit's covariance has it, in coordinates where valleys are straight.

Errors of a model last, for a whole run at times, and a likelihood that counts readings as independent then is too
narrow along some directions, by different factors. Deviations from the fit are mapped so that its second derivatives
there are those of the covariance that errors which last have widened; bends and priors are mapped along. No direction
gets narrower than the likelihood has it. Positive numbers but lengths, times, masses and inertias go by their
logarithm: valleys along which a product stays the same are straight there.

Source: Ribatet, Cooley & Davison, Bayesian inference from composite likelihoods, Statistica Sinica 22 (2012), Sec. 2.3,
the curvature adjustment.
"""

from __future__ import annotations

import numpy as np
import scipy.linalg as la

from ...base.errors import BadInput
from ...base.shorthands import Array, Mask
from .density import PosteriorDensity

ADDING = ("m", "s", "kg", "kg m^2")
"""Units of numbers that make up sums, as wheelbases and delays do: along these a valley is straight in the numbers
themselves, along products of the others in their logarithms."""
RIDGE = 1e-10
"""Of a covariance in units of its standard deviations: rounding must not make it indefinite."""


class Target:
    """The density in the coordinates in which draws move, u = log(theta) or theta, as `whitening` tells.

    Parameters
    ----------
    density : in theta.
    independent : (d, d) covariance of theta about the fit, as the density has it.
    lasting : (d, d) that covariance with what errors that last add.

    Attributes
    ----------
    centre : (d,) the fit.
    factor : (d, d) of the covariance about the fit.
    narrowed : (d, d) deviations from the fit to those at which the density is looked up.
    """

    def __init__(self, density: PosteriorDensity, independent: Array, lasting: Array) -> None:
        self.density = density
        unit, factor, self.logarithmic = whitening(density, independent)
        size = np.where(self.logarithmic, density.centre, 1.0)
        self.centre = self.to_u(density.centre[None])[0]
        L = factor * (unit / size)[:, None]
        inward = np.linalg.inv(L)
        wider, Q = np.linalg.eigh(inward @ (lasting / np.outer(size, size)) @ inward.T)
        growth = np.sqrt(np.maximum(wider, 1.0))
        self.factor = L @ (Q * growth)
        self.narrowed = L @ (Q / growth) @ Q.T @ inward

    def to_u(self, theta: Array) -> Array:
        """(n, d) -> (n, d)."""
        return np.asarray(np.where(self.logarithmic, np.log(np.where(self.logarithmic, theta, 1.0)), theta))

    def to_theta(self, u: Array) -> Array:
        """(n, d) -> (n, d)."""
        with np.errstate(over="ignore"):
            return np.asarray(np.where(self.logarithmic, np.exp(np.where(self.logarithmic, u, 0.0)), u))

    def within(self, u: Array) -> Array:
        """(n, d) -> (n,) whether points lie within the parameters' bounds."""
        return self.density.within(self.to_theta(u))

    def __call__(self, u: Array) -> Array:
        """(n, d) -> (n,) logarithm of the density of u."""
        result = np.full(len(u), -np.inf)
        inside = self.within(u)
        looked_up = self.centre + (u[inside] - self.centre) @ self.narrowed.T
        result[inside] = self.density(self.to_theta(looked_up)) + np.sum(looked_up[:, self.logarithmic], axis=1)
        return np.asarray(np.where(np.isfinite(result), result, -np.inf))


def whitening(density: PosteriorDensity, covariance: Array) -> tuple[Array, Array, Mask]:
    """Standard deviations (d,), a factor of the correlations (d, d), and which coordinates go by their logarithm.

    Raises
    ------
    BadInput : a parameter is not determined.
    """
    sd = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    untold = [coordinate.name for coordinate, s in zip(density.coordinates, sd, strict=True) if not np.isfinite(s)]
    if untold:
        raise BadInput(
            f"{', '.join(untold)} is not determined by the recordings, nor by a prior: there is nothing to draw from. "
            "Fix it or give it a prior, and fit again."
        )
    unit = np.where(sd > 0, sd, 1.0)
    correlation = covariance / np.outer(unit, unit)
    correlation[np.diag_indices_from(correlation)] = np.where(sd > 0, 1.0 + RIDGE, RIDGE)
    values, vectors = la.eigh(correlation)
    adds = np.array([coordinate.unit in ADDING for coordinate in density.coordinates])
    logarithmic = (density.bounds[0] >= 0) & (density.centre > 0) & ~adds
    return unit, np.asarray(vectors * np.sqrt(np.maximum(values, 0.0))), logarithmic
