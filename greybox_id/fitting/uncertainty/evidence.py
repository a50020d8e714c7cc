"""Sizes of functions that may explain residuals in addition to the parameters: empirical Bayes on normal equations.

The objective is expanded to second order at an optimum, in parameters and in the functions' coefficients.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.linalg as la
from scipy.linalg import lapack

from ...base.shorthands import Array, Index

SHARES = (0.0, 0.002, 0.005, 0.01, 0.02, 0.03, 0.05, 0.08, 0.12, 0.2, 0.35, 0.6, 1.0)
"""Candidates for the prior standard deviation of one function's contribution to the error, in output spreads."""
SWEEPS = 3
RIDGE = 1e-9
"""Ridge relative to a column's own curvature: on some drives one function is a sum of others."""


@dataclass
class OutputEquations:
    """Normal equations of one output's residuals, by all candidate explanations, and the residuals' sum of squares."""

    H: Array
    g: Array
    total: float

    def add(self, wide: Array, residuals: Array) -> None:
        """Add rows."""
        self.H += wide.T @ wide
        self.g += wide.T @ residuals
        self.total += float(residuals @ residuals)

    def explained_share(self, sizes: Array) -> float:
        """Share of the sum of squares that explanations of these sizes remove."""
        gone = -float(sizes @ (2.0 * self.g + self.H @ sizes))
        return float(np.clip(gone / max(self.total, 1e-300), 0.0, 1.0))


@dataclass
class StartEquations:
    """Normal equations of an interval's free starts: their curvature, coupling to all other unknowns, and gradient."""

    curvature: Array
    coupling: Array
    gradient: Array

    @classmethod
    def of(cls, few: int, many: int) -> StartEquations:
        """Zero for `few` starts and `many` other unknowns."""
        return cls(np.zeros((few, few)), np.zeros((few, many)), np.zeros(few))

    def add(self, J: Array, wide: Array, residuals: Array) -> None:
        """Add rows."""
        self.curvature += J.T @ J
        self.coupling += J.T @ wide
        self.gradient += J.T @ residuals

    def eliminate_from(self, H: Array, g: Array) -> None:
        """Eliminate the starts from the other unknowns' normal equations, in place (Schur complement)."""
        if len(self.gradient):
            size = np.diag(self.curvature)
            unit = np.where(size > 0.0, 1.0 / np.sqrt(np.where(size > 0.0, size, 1.0)), 0.0)  # some have no influence
            inverse = la.pinvh(self.curvature * np.outer(unit, unit) + RIDGE * np.eye(len(unit))) * np.outer(unit, unit)
            H -= self.coupling.T @ inverse @ self.coupling
            g -= self.coupling.T @ (inverse @ self.gradient)


class Joint:
    """Joint estimation of parameters and coefficients of functions of the drive.

    Parameters
    ----------
    H, g : curvature and gradient by both, parameters first, at the parameters' optimum with zero coefficients.
    count : number of parameters.

    Internally all unknowns are scaled to unit curvature: a very sensitive parameter, such as a lag much shorter than a
    row, would otherwise push the others below rounding.
    """

    def __init__(self, H: Array, g: Array, count: int) -> None:
        size = np.diag(H)
        self.scale = np.where(size > 0.0, 1.0 / np.sqrt(np.where(size > 0.0, size, 1.0)), 1.0)
        self.count, H, g = count, H * np.outer(self.scale, self.scale), g * self.scale
        P, self.C, S = H[:count, :count], H[:count, count:], H[count:, count:]
        self.P = P + np.diag(RIDGE * np.maximum(np.diag(P), 1e-300))
        self.inverse = la.pinvh(self.P) if count else np.zeros((0, 0))
        self.g = g[:count]
        self.S = S - self.C.T @ self.inverse @ self.C
        size, along = la.eigh(0.5 * (self.S + self.S.T))  # cancellation must not leave negative curvature
        self.S = (along * np.maximum(size, 0.0)) @ along.T
        self.pull = g[count:] - self.C.T @ (self.inverse @ self.g)

    def evidence(self, variances: Array) -> float:
        """Log marginal likelihood ratio of the residuals with coefficients of these prior variances, over none."""
        used = variances > 0.0
        if not np.any(used):
            return 0.0
        root = np.sqrt(variances[used]) / self.scale[self.count :][used]
        inner = np.eye(len(root)) + root[:, None] * self.S[np.ix_(used, used)] * root[None, :]
        scaled = root * self.pull[used]
        # LAPACK directly: with so few functions, scipy's checks took nearly half the time
        factor, sizes, failed = lapack.dposv(inner + 1e-12 * np.eye(len(root)), scaled, lower=True)
        if failed:  # so large a variance that rounding hides the rest: reject it
            return -np.inf
        return 0.5 * float(scaled @ sizes) - float(np.sum(np.log(np.diag(factor))))

    def beside(self, variances: Array) -> tuple[Array, Array, Array]:
        """Additional covariance of the parameters, shift of their optimum, and the coefficients' estimates."""
        of_p, of_functions = self.scale[: self.count], self.scale[self.count :]
        root = np.sqrt(variances) / of_functions
        inner = np.eye(len(root)) + root[:, None] * self.S * root[None, :]
        size, along = la.eigh(
            0.5 * (inner + inner.T)
        )  # eigenvalues are at least one: a positive semidefinite matrix is added to the unit matrix
        of_sizes = root[:, None] * ((along / np.maximum(size, 1.0)) @ along.T) * root[None, :]
        sizes, follow = -of_sizes @ self.pull, self.inverse @ self.C
        wider = follow @ of_sizes @ follow.T * np.outer(of_p, of_p)
        return wider, -follow @ sizes * of_p, sizes * of_functions


def likeliest(joint: Joint, owner: Index, unit: Array, count: int) -> tuple[Array, Array]:
    """The most likely prior size of each group of functions, and the log evidence that each group gains over none.

    Parameters
    ----------
    joint : the joint normal equations.
    owner, unit : (functions,) group of each function, and coefficient that corresponds to a share of one.
    count : number of groups.
    """
    shares = np.zeros(count)
    best = 0.0
    for _ in range(SWEEPS):
        before = shares.copy()
        for k in range(count):
            tried = []
            for share in SHARES:
                shares[k] = share
                tried.append(joint.evidence((shares[owner] * unit) ** 2))
            shares[k] = SHARES[int(np.argmax(tried))]
            best = max(tried)
        if np.array_equal(before, shares):
            break
    gains = np.zeros(count)
    for k in range(count):
        without = shares.copy()
        without[k] = 0.0
        gains[k] = best - joint.evidence((without[owner] * unit) ** 2)
    return shares, gains
