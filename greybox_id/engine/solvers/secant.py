"""Secant estimate of the curvature that Gauss-Newton leaves out, from gradient changes over the accepted steps.

Gauss-Newton takes J'J for the curvature of half the sum of squares. With large residuals and a nonlinear model it
converges linearly: each digit of the optimum takes as many steps as the last. The missing curvature speeds it up.

Source: Dennis, Gay & Welsch, An adaptive nonlinear least-squares algorithm, ACM Trans. Math. Softw. 7 (1981) 348-368:
the update, its sizing, and the rule that the quadratic model that predicted the last step better is used next.
"""

from __future__ import annotations

import numpy as np
from scipy.linalg import lapack

from ...base.shorthands import Array, Mask
from ..least_squares import NormalEquations

LEAST_PIVOT = 1e-12
"""Pivot, as a share of an unknown's curvature, below which a matrix counts as not positive definite."""


class MissingCurvature:
    """Curvature of the objective beyond J'J.

    Attributes
    ----------
    S : (unknowns, unknowns) estimate, added to J'J; None before the first step.
    trusted : whether the model with S predicted the last step better.
    """

    def __init__(self) -> None:
        self.S: Array | None = None
        self.trusted = False
        self._last: tuple[Array, Array] | None = None

    def learn(self, x: Array, equations: NormalEquations) -> None:
        """Update S by the change of the gradient since the last point; the first call only stores the point."""
        last, self._last = self._last, (x, equations.g)  # g alone: what else the equations refer to is large
        if last is None:
            return
        s = np.zeros_like(x)
        np.subtract(x, last[0], out=s, where=x != last[0])  # an unknown may be infinite
        y = equations.g - last[1]
        change, S = float(y @ s), np.zeros_like(equations.H) if self.S is None else self.S
        with np.errstate(all="ignore"):
            missing, along = y - equations.H @ s, S @ s
            size = abs(float(s @ along))
            share = min(1.0, abs(float(s @ missing)) / size) if size > 0 else 1.0
            S, off = share * S, missing - share * along
            if change > 0:
                outer = np.outer(off, y) / change
                S = S + outer + outer.T - float(s @ off) / change**2 * np.outer(y, y)
        self.S = S if np.all(np.isfinite(S)) else None

    def added(self, equations: NormalEquations, by: Array, free: Mask) -> NormalEquations | None:
        """The equations with S added, for unknowns scaled by `by`; None before the first step.

        S loses its trust if the sum is not positive definite.
        """
        if self.S is None:
            return None
        whole = NormalEquations(equations.H + self.S * np.outer(by, by), equations.g)
        self.trusted = self.trusted and _positive_definite(whole.H[np.ix_(free, free)])
        return whole

    def compare(self, actual: float, predicted: float, without: float) -> None:
        """Trust S if the decrease predicted with it is closer to the actual one, `actual`, than `without` it."""
        self.trusted = abs(predicted - actual) < abs(without - actual)


def _positive_definite(H: Array) -> bool:
    scale = np.diag(H)
    if not np.all(scale > 0):
        return False
    unit = 1.0 / np.sqrt(scale)
    return not lapack.dpotrf(H * np.outer(unit, unit) - LEAST_PIVOT * np.eye(len(H)))[1]
