"""Descent of a cost of few unknowns within bounds, by Gauss-Newton steps."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from ...base.shorthands import Array
from ...engine.solvers.gauss_newton import least_within
from .calibration import CAL


@dataclass(frozen=True)
class Curve:
    """Quadratic approximation of a cost.

    Attributes
    ----------
    cost : negative log-likelihood, or negative log posterior.
    g, H : (n,), (n, n) its gradient and its Gauss-Newton Hessian.
    scores : (blocks, n) gradients of the blocks of a single ride, which add up to its gradient.
    """

    cost: float
    g: Array
    H: Array
    scores: Array = field(default_factory=lambda: np.empty((0, 0)))


def descended(
    cost: Callable[[Array], float],
    curve: Callable[[Array], Curve],
    start: Array,
    low: Array,
    high: Array,
    settled: float = CAL.between_settled,
    stride: float = np.inf,
) -> tuple[Array, Curve]:
    """Minimum of a cost within bounds, and its quadratic approximation there.

    Gauss-Newton steps, damped by Nielsen's rule (Madsen, Nielsen & Tingleff, Methods for Non-Linear Least Squares
    Problems, 2nd ed., 2004, Sec. 3.2). Curvature that the Gauss-Newton Hessian lacks (of predicted variances and of
    noise scales) is learned from gradients on the way, and added as long as it predicts better what a step gains
    (structured quasi-Newton: Dennis, Gay & Welsch, ACM Trans. Math. Softw. 7, 1981, Sec. 3 and 5).
    """
    u = np.clip(start, low, high)
    here, lacking, free = curve(u), np.zeros((len(u), len(u))), np.ones(len(u), dtype=bool)
    damping, firmer, still, augmented = 0.0, 2.0, 0, False
    for _ in range(CAL.between_steps):
        B = here.H + lacking if augmented else here.H
        if augmented and np.any(np.linalg.eigvalsh(B) <= 0):  # the learned curvature does not hold here
            B = here.H
        within = np.maximum(low - u, -stride), np.minimum(high - u, stride)
        if _promises(here.g, B, least_within(B, here.g, *within, free)) < settled:
            break  # an undamped step gains no more
        there, gained = u, 0.0
        while not gained > 0:
            step = least_within(B, here.g, *within, free, damping)
            expected = _promises(here.g, B, step)
            if expected < CAL.least_promise * settled:
                break
            there = np.clip(u + step, low, high)
            gained = here.cost - cost(there)
            if not gained > 0:
                damping, firmer = max(damping, CAL.damping) * firmer, 2 * firmer
        if not gained > 0:
            break
        damping, firmer = max(damping, CAL.damping) * max(1 / 3, 1 - (2 * gained / expected - 1) ** 3), 2.0
        damping = damping if damping > CAL.damping else 0.0
        then, step = curve(there), there - u
        plain = _promises(here.g, here.H, step)
        learned = float(step @ lacking @ step)
        augmented = abs(plain - 0.5 * learned - gained) < abs(plain - gained)
        turned = then.g - here.g
        missed = turned - then.H @ step
        if learned != 0:  # the learned curvature fades where it does not hold
            lacking *= min(1.0, abs(float(step @ missed) / learned))
        bend = float(step @ turned)
        if bend > 0:
            missed = missed - lacking @ step
            both = np.outer(missed, turned) / bend
            lacking = lacking + both + both.T - float(step @ missed) * np.outer(turned, turned) / bend**2
        u, here = there, then
        still = still + 1 if gained < settled else 0
        if still == CAL.between_still:
            break
    return u, here


def _promises(g: Array, B: Array, step: Array) -> float:
    """Reduction of the cost by a step that a quadratic model predicts."""
    return -float(step @ (g + 0.5 * B @ step))
