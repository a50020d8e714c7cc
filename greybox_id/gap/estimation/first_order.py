"""Coordinates that are not simulated, at their best for any step of all others."""

from __future__ import annotations

import numpy as np

from ...base.shorthands import Array, Mask
from ...engine.solvers.gauss_newton import least_within
from .sparse import Quadratic


class FirstOrder:
    """Coordinates that are not simulated, at their best for any step of all others.

    Causes among them go no further than they may without being simulated: columns that were taken elsewhere would make
    up for whatever a simulation changes.

    Parameters
    ----------
    quadratic, prec : normal equations and prior precisions about the state.
    switched_at : (causes,) distance from the null beyond which a cause is simulated.
    switched : (causes,) those that are simulated from this step on.

    Attributes
    ----------
    low, high : (K,) bounds of a step of all coordinates, so that these stay within their range.
    """

    def __init__(self, quadratic: Quadratic, prec: Array, switched_at: Array, switched: Mask) -> None:
        linear = quadratic.about
        here = ~linear.moved & ~np.isin(linear.cause, np.flatnonzero(switched))
        reach = np.append(switched_at, np.inf)[linear.cause[here]]  # no limit for what is no cause (-1)
        self._A, self._here, self._prec, self._off = linear.A, here, prec[here], (linear.at - linear.mean)[here]
        self.low, self.high = linear.low - linear.at, linear.high - linear.at
        self.low[here] = np.maximum(self.low[here], -reach - self._off)
        self.high[here] = np.minimum(self.high[here], reach - self._off)
        self._within = self.low[here], self.high[here]
        self._H = quadratic.G[np.ix_(here, here)] + np.diag(self._prec)

    def left(self, R: Array) -> Array:
        """(n,) squares of residuals, (R, n), and of the prior that are left with these coordinates at their best."""
        slopes = (self._A.T @ R)[self._here] + (self._prec * self._off)[:, None]
        least, free = self._off @ (self._prec * self._off), np.ones(len(slopes), dtype=bool)
        steps = [least_within(self._H, g, *self._within, free) for g in slopes.T]
        gained = [2 * g @ step + step @ self._H @ step for g, step in zip(slopes.T, steps, strict=True)]
        return np.asarray(np.sum(R**2, axis=0) + least + gained)
