"""Minimise a smooth loss of many unknowns by its gradient, stopping early at the lowest held-out error.

First some steps of Adam (Kingma & Ba 2015): from random weights a line search runs off into vehicles that spin. Then
L-BFGS (scipy's, with bounds), which converges from there ten times as fast.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy.linalg as la

from ...base.shorthands import Array
from ..least_squares import LeastSquares
from .gauss_newton import least_within

Loss = Callable[[Array], tuple[float, Array]]
"""Unknowns -> loss and its gradient."""
_MEAN, _SQUARE, _RATE = 0.9, 0.99, 5e-3
"""Adam's decay rates of the mean and the squared gradient, and its step size."""
_MEMORY = 30
"""Pairs of steps and gradient changes that L-BFGS keeps."""
_RIDGE, _ARMIJO = 1e-12, 1e-4
"""Share of an unknown's curvature added to it against rounding; share of the predicted decrease that a step must
achieve (Nocedal & Wright, Sec. 3.1)."""


@dataclass(frozen=True)
class Descent:
    """Result of a descent.

    Attributes
    ----------
    x : unknowns with the lowest held-out error.
    loss, held_out : training loss and held-out error, from the start on, step by step.
    best : step number of x.
    status : why the descent ended, in words.
    converged : whether the held-out error stopped falling, or the loss could not be lowered.
    """

    x: Array
    loss: tuple[float, ...]
    held_out: tuple[float, ...]
    best: int
    status: str
    converged: bool


class _Stop(Exception):
    """Patience has run out."""


def descend(
    loss: Loss,
    held_out: Callable[[Array], float],
    start: Array,
    bounds: Array,
    *,
    warm_up: int,
    steps: int,
    patience: int,
    say: Callable[[int, float, float], None],
) -> Descent:
    """Minimise a loss by Adam and L-BFGS, with early stopping.

    Parameters
    ----------
    loss : unknowns -> value and gradient.
    held_out : unknowns -> error on held-out data.
    start : (n,) unknowns.
    bounds : (n, 2).
    warm_up : steps of Adam.
    steps : largest number of L-BFGS steps after them.
    patience : stop after this many steps without a lower held-out error.
    say : progress callback, called with (step, loss, held-out error).

    Returns
    -------
    The best point. Ctrl-C keeps the best so far.
    """
    from scipy.optimize import Bounds, minimize  # imported here: importing it takes longer than many a fit without it

    losses, held_out_errors = [], [held_out(start)]
    best, best_step = start.copy(), 0
    losses.append(loss(start)[0])

    def record(x: Array, value: float) -> None:
        nonlocal best, best_step
        losses.append(value)
        held_out_errors.append(held_out(x))
        if held_out_errors[-1] < held_out_errors[best_step]:
            best, best_step = x.copy(), len(held_out_errors) - 1
        say(len(held_out_errors) - 1, value, held_out_errors[-1])
        if len(held_out_errors) - 1 - max(best_step, warm_up) >= patience:
            raise _Stop

    last: tuple[float, Array] = (losses[0], start)

    def counted_loss(x: Array) -> tuple[float, Array]:
        nonlocal last
        value, slope = loss(x)
        last = (value, x.copy())
        return value, slope

    try:
        x = _adam(loss, start, bounds, warm_up, record)
        result: Any = minimize(
            counted_loss,
            x,
            jac=True,
            method="L-BFGS-B",
            bounds=Bounds(bounds[:, 0], bounds[:, 1]),
            callback=lambda x: record(x, last[0]),
            options={"maxiter": steps, "maxcor": _MEMORY, "maxfun": 3 * steps},
        )
        status, converged = ("most steps", False) if result.nit >= steps else ("loss no lower", True)
    except _Stop:
        status, converged = f"held-out error not lower for {patience} steps", True
    except KeyboardInterrupt:
        status, converged = "interrupted", False
    return Descent(best, tuple(losses), tuple(held_out_errors), best_step, status, converged)


def refine(
    problem: LeastSquares, x: Array, gradient: Callable[[Array, Any], Array], *, tolerance: float, steps: int
) -> tuple[Array, list[float]]:
    """Approach an optimum without linearising again: L-BFGS on top of the Gauss-Newton Hessian at the start.

    Gauss-Newton ignores the curvature of the residuals, and gains a decade or less per step, each with a linearisation;
    differences of gradients, which cost a tenth of that, capture this curvature. Source: Nocedal & Wright, Numerical
    Optimization, 2nd ed., Algorithm 7.4, with the Gauss-Newton Hessian in place of a multiple of the identity.

    Parameters
    ----------
    problem : the problem; nodes follow by simulation.
    x : (unknowns,) a point near an optimum, away from bounds.
    gradient : (unknowns, their nodes) -> gradient of the objective, zero for fixed unknowns.
    tolerance : stop when a step's predicted decrease is below this share of the objective.
    steps : largest number of steps.

    Returns
    -------
    The point, and the objective at the start and after every step.
    """
    free = problem.free
    nodes = problem.simulated_nodes(x)
    metric = _Metric(problem.normal_equations(x, nodes).H[np.ix_(free, free)])
    pairs: list[tuple[Array, Array, float]] = []

    def direction(g: Array) -> Array:
        g, shares = g.copy(), []
        for s, y, curvature in reversed(pairs):
            shares.append(s @ g / curvature)
            g -= shares[-1] * y
        d = metric.solved(g)
        for (s, y, curvature), share in zip(pairs, reversed(shares), strict=True):
            d += s * (share - y @ d / curvature)
        return np.asarray(d)

    history, g = [problem.objective(x, nodes)], gradient(x, nodes)[free]
    while len(history) <= steps:
        step = -direction(g)
        predicted = -float(g @ step)
        if predicted <= 2.0 * tolerance * history[-1]:
            break
        nearer = _moved(x, free, step)
        matched = problem.simulated_nodes(nearer)
        objective = problem.objective(nearer, matched)
        inside = np.all((nearer > problem.bounds[0]) & (nearer < problem.bounds[1]) | ~free)
        if not (inside and objective < history[-1] - _ARMIJO * predicted):
            break
        slope = gradient(nearer, matched)[free]
        curvature = float(step @ (slope - g))
        if curvature > 0.0:
            pairs.append((step, slope - g, curvature))
        x, g = nearer, slope
        history.append(objective)
    return x, history


def settle(
    problem: LeastSquares, x: Array, gradient: Callable[[Array, Any], Array], *, radius: float, least: float, steps: int
) -> tuple[Array, float, float]:
    """Approach an optimum that may lie in a kink, and measure how well the gradients around it balance.

    If a fed-back prediction crosses the corner of a piecewise linear function, the gradient jumps, and at an optimum in
    that corner it is zero nowhere; a weighted average of gradients within a small distance is zero. From the point,
    step along the shortest average of the gradients collected so far; restart from the new point if the objective
    falls, otherwise add the gradient there to the collection. Source: Goldstein, Optimization of Lipschitz continuous
    functions, Mathematical Programming 13 (1977) 14-22, in the metric of the curvature.

    Parameters
    ----------
    problem : the problem; nodes follow by simulation.
    x : (unknowns,) a point near an optimum, away from bounds.
    gradient : (unknowns, their nodes) -> gradient of the objective, zero for fixed unknowns.
    radius : length of a step in the metric of the curvature, in standard deviations of all unknowns together.
    least : largest entry of the average gradient, in units of curvature, at which the point counts as an optimum.
    steps : largest number of steps.

    Returns
    -------
    The point, its objective, and the largest entry of the average gradient in units of curvature.
    """
    free = problem.free
    nodes = problem.simulated_nodes(x)
    metric = _Metric(problem.normal_equations(x, nodes).H[np.ix_(free, free)])
    objective, gradients = problem.objective(x, nodes), [gradient(x, nodes)[free]]
    average = gradients[0]
    for _ in range(steps):
        average = metric.shortest(gradients)
        if float(np.max(np.abs(metric.unit * average))) <= least:
            break
        step = -metric.solved(average)
        step *= radius / np.sqrt(max(-float(average @ step), 1e-300))
        nearer = _moved(x, free, step)
        matched = problem.simulated_nodes(nearer)
        objective_there = problem.objective(nearer, matched)
        slope = gradient(nearer, matched)[free]
        if objective_there < objective + _ARMIJO * float(average @ step):
            x, objective, gradients = nearer, objective_there, [slope]
        else:
            gradients.append(slope)
    return x, objective, float(np.max(np.abs(metric.unit * average)))


class _Metric:
    """The curvature at a point, factorised with unknowns scaled to unit curvature.

    Attributes
    ----------
    unit : (n,) inverse root of each unknown's curvature.
    """

    def __init__(self, H: Array) -> None:
        self.unit = 1.0 / np.sqrt(np.maximum(np.diag(H), 1e-300))
        self._factor = la.cho_factor(H * np.outer(self.unit, self.unit) + _RIDGE * np.eye(len(H)), lower=True)

    def solved(self, g: Array) -> Array:
        """H^-1 g."""
        return np.asarray(self.unit * la.cho_solve(self._factor, self.unit * g))

    def shortest(self, gradients: Sequence[Array]) -> Array:
        """The convex combination of gradients that is shortest in the metric."""
        G = np.array(gradients).T
        sizes = la.solve_triangular(self._factor[0], self.unit[:, None] * G, lower=True)
        products = sizes.T @ sizes
        whole = 1e6 * float(np.max(np.diag(products)))  # penalty: the weights add up to one
        many = len(products)
        share = least_within(
            products + whole, np.full(many, -whole), np.zeros(many), np.full(many, np.inf), np.ones(many, bool)
        )
        return np.asarray(G @ (share / np.sum(share)))


def _moved(x: Array, free: Array, step: Array) -> Array:
    nearer = x.copy()
    nearer[free] += step
    return nearer


def _adam(loss: Loss, start: Array, bounds: Array, steps: int, record: Callable[[Array, float], None]) -> Array:
    x, mean, square = start.copy(), np.zeros(len(start)), np.zeros(len(start))
    for k in range(1, steps + 1):
        value, slope = loss(x)
        mean = _MEAN * mean + (1.0 - _MEAN) * slope
        square = _SQUARE * square + (1.0 - _SQUARE) * slope**2
        step = mean / (1.0 - _MEAN**k) / (np.sqrt(square / (1.0 - _SQUARE**k)) + 1e-10)
        x = np.clip(x - _RATE * step, bounds[:, 0], bounds[:, 1])
        record(x, value)
    return x
