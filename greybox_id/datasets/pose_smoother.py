"""Fixed-interval smoother of poses, compiled: for one axis (yaw), or two whose accelerations rotate (x and y).

States are p, v and a of each axis. An input row holds: the step since the previous row in s, 1 at the first row of a
run, 1 if there is a reading, the readings, and for two axes the rotations by which an acceleration adds to velocity and
to position, each as cosine and sine. Variances: q of each axis, of readings, and initial ones of p, v and a of a run.
"""

from __future__ import annotations

import numpy as np

from ..base.machine_code import begun, compiled
from ..base.shorthands import Array


@begun
def log_likelihood(rows: Array, variances: Array, axes: int) -> float:  # pragma: no cover
    """Log-likelihood of the readings, up to a constant."""
    n = 3 * axes
    m, P, result = np.zeros(n), np.zeros((n, n)), 0.0
    F, Q, FP, gone = np.zeros((n, n)), np.zeros((n, n)), np.zeros((n, n)), np.zeros((axes, n + 2))
    for row in rows:
        _predict(row, variances, axes, m, P, F, Q, FP)
        result += _update(row, variances, axes, m, P, gone)
    return result


@begun
def smooth(rows: Array, variances: Array, axes: int) -> tuple[Array, Array, Array]:  # pragma: no cover
    """States (rows, n), covariances (rows, n, n), and residuals of readings against all others (rows, axes), in sd."""
    n = 3 * axes
    count = len(rows)
    state, covariance, against = np.zeros((count, n)), np.zeros((count, n, n)), np.zeros((count, axes))
    m, P, lam, L, LF = np.zeros(n), np.zeros((n, n)), np.zeros(n), np.zeros((n, n)), np.zeros((n, n))
    F, Q, FP, gone = np.zeros((n, n)), np.zeros((n, n)), np.zeros((n, n)), np.zeros((axes, n + 2))
    for k in range(count):
        _predict(rows[k], variances, axes, m, P, F, Q, FP)
        state[k], covariance[k] = m, P
        _update(rows[k], variances, axes, m, P, gone)
    for k in range(count - 1, -1, -1):
        row = rows[k]
        m[:], P[:] = state[k], covariance[k]
        _update(row, variances, axes, m, P, gone)
        for axis in range(axes - 1, -1, -1):
            K, e, S = gone[axis, :n], gone[axis, n], gone[axis, n + 1]
            LK = L @ K  # a reading changes P to (I - K e^T) P (I - K e^T)^T; the transposed operation is applied to L
            against[k, axis] = row[2] * (e / S + K @ lam) / np.sqrt(1 / S + K @ LK)
            lam[axis] -= K @ lam + row[2] * e / S
            L[axis] -= LK
            LK = L @ K
            L[:, axis] -= LK
            L[axis, axis] += row[2] / S
        P[:] = covariance[k]
        state[k] -= P @ lam
        covariance[k] = P - P @ L @ P
        if row[1]:
            lam[:], L[:] = 0.0, 0.0
            continue
        _transition(row, variances, axes, F, Q)
        lam[:] = F.T @ lam
        np.dot(L, F, LF)
        np.dot(np.ascontiguousarray(F.T), LF, L)
    return state, covariance, against


@compiled
def _transition(row: Array, variances: Array, axes: int, F: Array, Q: Array) -> None:  # pragma: no cover
    """Transition matrix F and process noise covariance Q of a step, in place."""
    dt = row[0]
    q, R, twice = variances[:axes], np.eye(axes), np.eye(axes)
    if axes == 2:
        for turn, at in ((R, 5), (twice, 7)):
            turn[0, 0], turn[0, 1] = row[at], -row[at + 1]
            turn[1, 0], turn[1, 1] = row[at + 1], row[at]
    for i in range(axes):
        F[i, i] = F[axes + i, axes + i] = F[2 * axes + i, 2 * axes + i] = 1.0
        F[i, axes + i] = dt
        Q[2 * axes + i, 2 * axes + i] = dt * q[i]
        for j in range(axes):
            F[i, 2 * axes + j], F[axes + i, 2 * axes + j] = dt**2 / 2 * twice[i, j], dt * R[i, j]
            Rq, W = R[i, j] * q[j], 0.0
            for k in range(axes):
                W += R[i, k] * q[k] * R[j, k]
            Q[i, j], Q[axes + i, axes + j] = dt**5 / 20 * W, dt**3 / 3 * W
            Q[i, axes + j] = Q[axes + i, j] = dt**4 / 8 * W
            Q[i, 2 * axes + j] = Q[2 * axes + j, i] = dt**3 / 6 * Rq
            Q[axes + i, 2 * axes + j] = Q[2 * axes + j, axes + i] = dt**2 / 2 * Rq


@compiled
def _predict(
    row: Array, variances: Array, axes: int, m: Array, P: Array, F: Array, Q: Array, FP: Array
) -> None:  # pragma: no cover
    """Predict state and covariance for a row, in place; F is upper triangular."""
    n = len(m)
    if row[1]:
        m[:], P[:] = 0.0, 0.0
        for i in range(n):
            P[i, i] = variances[axes + 1 + i // axes]
        return
    _transition(row, variances, axes, F, Q)
    for i in range(n):
        moved = 0.0
        for k in range(i, n):
            moved += F[i, k] * m[k]
        m[i] = moved
        for j in range(n):
            total = 0.0
            for k in range(i, n):
                total += F[i, k] * P[k, j]
            FP[i, j] = total
    for i in range(n):
        for j in range(i, n):
            total = Q[i, j]
            for k in range(j, n):
                total += FP[i, k] * F[j, k]
            P[i, j] = P[j, i] = total


@compiled
def _update(row: Array, variances: Array, axes: int, m: Array, P: Array, gone: Array) -> float:  # pragma: no cover
    """Update with a row's readings, in place, in Joseph's form; stores gain, residual and its variance in `gone`.

    Returns the log-likelihood of the readings.
    """
    n, r, result = len(m), variances[axes], 0.0
    for axis in range(axes):
        e, S = row[3 + axis] - m[axis], P[axis, axis] + r
        K = gone[axis, :n]
        for i in range(n):
            K[i] = row[2] * P[i, axis] / S
        gone[axis, n], gone[axis, n + 1] = e, S
        if row[2]:
            for j in range(n):
                m[j] += K[j] * e
                across = P[axis, j]
                for i in range(n):
                    P[i, j] -= K[i] * across
            for i in range(n):
                along = r * K[i] - P[i, axis]
                for j in range(n):
                    P[i, j] += along * K[j]
            result -= (np.log(S) + e**2 / S) / 2
    return result
