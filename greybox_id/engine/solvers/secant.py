"""The curvature that Gauss-Newton leaves out, told by how the gradient changed over the steps that were taken.

Gauss-Newton takes J'J for the curvature of half the sum of squares. Where residuals stay large and the model bends,
each digit of the optimum takes as many steps as the one before; with what is left out added, it takes fewer.

Source: Dennis, Gay & Welsch, An adaptive nonlinear least-squares algorithm, ACM Trans. Math. Softw. 7 (1981) 348-368:
the update, its size, and that of both models the one is used next that foretold the last step better.
"""

from __future__ import annotations

import numpy as np
from scipy.linalg import lapack

from ...base.shorthands import Array, Mask
from ..least_squares import NormalEquations

LEAST_PIVOT = 1e-12
"""Share of an unknown's own curvature that counts as none."""


class LeftOut:
    """What Gauss-Newton leaves out of the curvature.

    Attributes
    ----------
    S : (unknowns, unknowns) what is added to J'J; None before the first step.
    trusted : whether the last step was foretold better with it.
    """

    def __init__(self) -> None:
        self.S: Array | None = None
        self.trusted = False
        self._last: tuple[Array, Array] | None = None

    def learn(self, x: Array, equations: NormalEquations) -> None:
        """Take the change of the gradient since the last point; before the first step there is none."""
        last, self._last = self._last, (x, equations.g)  # no more of it: of hours, what it was taken from is large
        if last is None:
            return
        s = np.zeros_like(x)
        np.subtract(x, last[0], out=s, where=x != last[0])  # an unknown may stand at infinity
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
        """Equations in unknowns of the sizes `by` with it added; None before the first step.

        It is trusted no longer where the curvature would not be positive.
        """
        if self.S is None:
            return None
        whole = NormalEquations(equations.H + self.S * np.outer(by, by), equations.g)
        self.trusted = self.trusted and _positive_definite(whole.H[np.ix_(free, free)])
        return whole

    def compare(self, fallen: float, foretold: float, without: float) -> None:
        """Trust what foretold better by how much the objective fell."""
        self.trusted = abs(foretold - fallen) < abs(without - fallen)


def _positive_definite(H: Array) -> bool:
    scale = np.diag(H)
    if not np.all(scale > 0):
        return False
    unit = 1.0 / np.sqrt(scale)
    return not lapack.dpotrf(H * np.outer(unit, unit) - LEAST_PIVOT * np.eye(len(H)))[1]
