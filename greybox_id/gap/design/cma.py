"""CMA-ES, which refines the best plans."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ...base.shorthands import Array


class CMA:
    """CMA-ES by ask and tell (Hansen, The CMA Evolution Strategy, 2016, arXiv:1604.00772).

    Parameters
    ----------
    start : (n,).
    step : standard deviation at the start, in all coordinates.
    """

    def __init__(self, start: Array, step: float, rng: np.random.Generator) -> None:
        n = len(start)
        self.mean, self.step, self.rng, self.k = start.astype(float), step, rng, 0
        self.count = 4 + int(3 * np.log(n)) + 4
        mu = self.count // 2
        weights = np.log(mu + 0.5) - np.log(np.arange(1, mu + 1))
        self.weights = weights / np.sum(weights)
        self.effective = float(1.0 / np.sum(self.weights**2))
        self.C, self.p_c, self.p_s = np.eye(n), np.zeros(n), np.zeros(n)

    def ask(self) -> Array:
        """(lambda, n) points to evaluate; the very first one is the start."""
        variances, self.B = np.linalg.eigh(self.C)
        self.D = np.sqrt(np.maximum(variances, 1e-14))
        z = self.rng.standard_normal((self.count, len(self.mean)))
        if self.k == 0:
            z[0] = 0.0
        self.moved = z * self.D @ self.B.T
        return np.asarray(self.mean + self.step * self.moved)

    def tell(self, costs: Sequence[float]) -> None:
        """Update by the costs of these points."""
        n, effective, weights = len(self.mean), self.effective, self.weights
        c_c = (4 + effective / n) / (n + 4 + 2 * effective / n)
        c_s = (effective + 2) / (n + effective + 5)
        c_1 = 2 / ((n + 1.3) ** 2 + effective)
        c_mu = min(1 - c_1, 2 * (effective - 2 + 1 / effective) / ((n + 2) ** 2 + effective))
        damping = 1 + 2 * max(0.0, np.sqrt((effective - 1) / (n + 1)) - 1) + c_s
        usual = np.sqrt(n) * (1 - 1 / (4 * n) + 1 / (21 * n**2))
        best = self.moved[np.argsort(costs, kind="stable")[: len(weights)]]
        way = weights @ best
        self.k += 1
        self.mean = self.mean + self.step * way
        self.p_s = (1 - c_s) * self.p_s + np.sqrt(c_s * (2 - c_s) * effective) * (self.B @ ((self.B.T @ way) / self.D))
        long = np.linalg.norm(self.p_s)
        going = long / np.sqrt(1 - (1 - c_s) ** (2 * self.k)) < (1.4 + 2 / (n + 1)) * usual
        self.p_c = (1 - c_c) * self.p_c + going * np.sqrt(c_c * (2 - c_c) * effective) * way
        C = (
            (1 - c_1 - c_mu) * self.C
            + c_1 * (np.outer(self.p_c, self.p_c) + (not going) * c_c * (2 - c_c) * self.C)
            + c_mu * (best.T * weights) @ best
        )
        self.C = 0.5 * (C + C.T)
        self.step *= float(np.exp((c_s / damping) * (long / usual - 1)))
