"""Rauch-Tung-Striebel smoother: what later readings say of a state, backwards through what a filter went through.

    G = forward predicted_P^-1,   x_s = x + G (x_s' - x'),   P_s = P + G (P_s' - P') G^T

with ' for the next segment, x' and P' as predicted for it and `forward` the covariance of x with x'. It serves EKF and
UKF alike. Source: Sarkka, Bayesian Filtering and Smoothing, 2013, Sec. 9.1 and 9.3.
"""

from __future__ import annotations

import numpy as np

from ..parameter import Array
from .kernel import History

LEAST = 1e-12
"""Variance, in shares of the largest, that any direction is taken to have: what has none cannot be divided by."""


def smoothed(history: History) -> tuple[Array, Array]:
    """States (S, n) and their covariance (S, n, n) given all readings of the run."""
    x, P = history.filtered.copy(), history.filtered_P.copy()
    ahead = history.predicted_P[1:]
    scale = np.sqrt(np.maximum(np.einsum("kii->ki", ahead), 1e-300))
    scaled = ahead / (scale[:, :, None] * scale[:, None, :]) + LEAST * np.eye(x.shape[1])
    back = np.linalg.solve(scaled, history.forward[:-1].swapaxes(1, 2) / scale[:, :, None]) / scale[:, :, None]
    for k in range(len(x) - 2, -1, -1):
        G = back[k].T
        x[k] += G @ (x[k + 1] - history.predicted[k + 1])
        P[k] += G @ (P[k + 1] - history.predicted_P[k + 1]) @ G.T
    return x, P
