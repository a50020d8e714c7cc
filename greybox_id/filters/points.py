"""Sigma points of the unscented Kalman filter: where they lie and what they weigh.

Scaled points of Van der Merwe, Sigma-Point Kalman Filters for Probabilistic Inference in Dynamic State-Space Models,
2004, Sec. 3.2.2: the mean, and n points ahead and n behind it at sqrt(n + lambda) standard deviations along the columns
of a root of P, lambda = alpha^2 (n + kappa) - n.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..parameter import Array


@dataclass(frozen=True)
class SigmaPoints:
    """Scaled sigma points.

    Attributes
    ----------
    alpha, beta, kappa : spread, knowledge of the fourth moment, second scale. At their defaults the points lie at
        sqrt(n) standard deviations and the mean weighs nothing in means: no weight is negative, so that no covariance
        can become indefinite, however many states there are.
    """

    alpha: float = 1.0
    beta: float = 2.0
    kappa: float = 0.0

    def weights(self, n: int) -> Array:
        """(4,): weight of the mean's point in means and in covariances, weight of every other point, and its reach."""
        scale = self.alpha**2 * (n + self.kappa)
        middle = 1 - n / scale
        return np.array([middle, middle + 1 - self.alpha**2 + self.beta, 0.5 / scale, np.sqrt(scale)])
