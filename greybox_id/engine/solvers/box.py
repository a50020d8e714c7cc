"""The least of a quadratic function within bounds: one step of every search here."""

from __future__ import annotations

import numpy as np
import scipy.linalg as la
from scipy.linalg import lapack

from ...base.shorthands import Array, Mask

LEAST_RIDGE = 1e-12
"""Share of an unknown's own curvature that is always added to it: what rounding leaves of a singular one."""
INWARD = 1e-12
"""Share of the steepest slope from which on a bound pulls inward."""


def least_within(H: Array, g: Array, low: Array, high: Array, free: Mask, damping: float = 0.0) -> Array:
    """Minimiser of g d + d H d / 2 within low <= d <= high, zero where not free.

    A primal active-set method (Nocedal & Wright, Numerical Optimization, 2nd ed., Sec. 16.5): from no step at all, walk
    to the minimiser over the unknowns that are free to move, stop at the first bound in the way and hold it; let go of
    a bound that pulls inward. It descends at every turn, which clipping a step would not.

    Parameters
    ----------
    H : (n, n) positive semidefinite.
    g, low, high : (n,).
    free : (n,) what may move at all.
    damping : share of an unknown's own curvature that is added to it.
    """
    scale = np.diag(H).copy()
    scale[scale <= 0] = 1.0
    H = H + np.diag((damping + LEAST_RIDGE) * scale)
    unit = 1.0 / np.sqrt(scale)  # unknowns in units of their own curvature: their SI units span orders of magnitude
    step = np.where(free, np.clip(0.0, low, high), 0.0)
    slope, free = g + H @ step, free & (low < high)
    at_low, at_high = free & (low >= step) & (slope > 0), free & (high <= step) & (slope < 0)
    for _ in range(3 * len(g) + 10):
        movable = np.flatnonzero(free & ~at_low & ~at_high)
        by = unit[movable]
        inner = H[np.ix_(movable, movable)] * np.outer(by, by)
        move = by * solved(inner, -by * slope[movable]) if len(movable) else by
        bound = np.where(move < 0, low[movable], high[movable])
        with np.errstate(divide="ignore", over="ignore", invalid="ignore"):
            share = np.where(move != 0, (bound - step[movable]) / move, np.inf)
        nearest = float(np.min(share, initial=1.0))
        step[movable] += min(max(nearest, 0.0), 1.0) * move
        if nearest < 1.0:
            blocking = share <= nearest
            step[movable[blocking]] = bound[blocking]
            at_low[movable[blocking & (move < 0)]] = True
            at_high[movable[blocking & (move > 0)]] = True
            slope = g + H @ step
            continue
        if not np.any(at_low | at_high):
            break
        slope = g + H @ step
        pull = slope * unit
        inward = np.where(at_low, -pull, np.where(at_high, pull, 0.0))
        released = int(np.argmax(inward))
        if inward[released] <= INWARD * max(float(np.max(np.abs(g * unit))), 1e-300):
            break
        at_low[released] = at_high[released] = False
    return step


def solved(H: Array, b: Array) -> Array:
    """H^-1 b for a positive definite H, by Cholesky; by least squares where rounding left H singular."""
    _, result, failed = lapack.dposv(H, b)
    return np.asarray(la.lstsq(H, b)[0] if failed else result)
