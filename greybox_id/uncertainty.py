"""How well a fit tells its parameters: covariance corrected for what the residuals leave correlated.

Neighbouring residuals are not independent: a car's unmodelled lag or bump lasts. The plain Gauss-Newton
covariance takes residuals as independent and is several times too small then. Here the scores (gradients of single
residuals) are summed over blocks of two seconds first, and their scatter sets the covariance (a sandwich estimate,
Newey & West, Econometrica 55 (1987), with block sums in place of a kernel).
"""

from __future__ import annotations

import numpy as np
import scipy.linalg as la

from .engine.shooting import Nodes, Problem
from .parameter import Array

BLOCK = 2.0
"""Length of a block, s: longer than residuals of a vehicle stay correlated."""


def covariance(problem: Problem, x: Array, nodes: Nodes) -> Array:
    """Covariance of the unknowns about an optimum, (unknowns, unknowns); fixed ones have none.

    With J the residuals' derivative and R the priors', both in standard deviations, it is
    H^-1 (S + R'R) H^-1 with H = J'J + R'R and S the sum over blocks of the outer product of J'r. A run and its
    mirror image carry the same noise: their scores belong to one block. What neither the data nor a prior tells
    has infinite variance.
    """
    rows = max(1, round(BLOCK / problem.trace.model.sample_time))
    H = (problem.R.T @ problem.R).toarray()
    middle = H.copy()
    scores: list[Array] = []
    for k, (residuals, J) in enumerate(problem.residuals(x, nodes)):
        index = problem.layout.index[k]
        full = J.reshape(-1, J.shape[-1])
        H[np.ix_(index, index)] += full.T @ full
        of_rows = np.einsum("ro,rop->rp", residuals, J)
        sums = np.add.reduceat(of_rows, np.arange(0, len(of_rows), rows), axis=0)
        if k < problem.copies:
            scores.append(np.zeros((len(sums), len(H))))
        scores[k % problem.copies][:, index] += sums
    blocks = np.vstack(scores)
    middle += blocks.T @ blocks * len(blocks) / max(len(blocks) - 1, 1)
    untold = problem.free & (np.diag(H) <= 0.0)
    free = problem.free & ~untold
    unit = 1.0 / np.sqrt(np.diag(H)[free])
    inner = H[np.ix_(free, free)] * np.outer(unit, unit)
    inner[np.diag_indices_from(inner)] += 1e-12
    half = la.solve(inner, np.eye(len(inner)), assume_a="pos") * np.outer(unit, unit)
    result = np.diag(np.where(untold, np.inf, 0.0))
    result[np.ix_(free, free)] = half @ middle[np.ix_(free, free)] @ half
    return result
