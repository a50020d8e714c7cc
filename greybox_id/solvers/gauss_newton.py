"""Condensed Gauss-Newton with a line search, damping where it fails, and bounds.

Every step solves the small dense normal equations that are left when the nodes are eliminated; the nodes then
follow by simulation, so that every point matches and the objective alone decides whether a step is taken. Models
with memory are stable on their own predictions, which is what makes this safe. (Moving the nodes to first order
only, with a filter on the gaps, was tried on a network of 544 weights: it wandered where this descends.)

A step is shortened before it is bent towards the gradient: on networks, damping alone (Levenberg-Marquardt) creeps
along curved valleys that a shortened Gauss-Newton step walks straight through, ten times as fast.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from enum import Enum

import numpy as np
import scipy.linalg as la

from ..engine.shooting import Nodes, NormalEquations, Problem
from ..parameter import Array

PATIENCE = 4
NEGLIGIBLE = 1e-3
"""Networks have flat, curved valleys in which the objective creeps. A fit that gains less than this share of its
objective in PATIENCE steps has stopped learning anything that its residuals could show."""


class Status(Enum):
    """How a solver ended, in words."""

    CONVERGED = "converged"
    STOPPED = "stopped by the caller before convergence"
    EARLY = "stopped early, where the validation recording is fitted best"
    INTERRUPTED = "interrupted; the best point so far is kept"
    STEP_LIMIT = "step limit reached before convergence"
    SLOW = (
        "progress became negligible before convergence; further steps would change the fit by far less than its error"
    )
    STALLED = "no step improved the fit further, though the gradient is not zero"
    NOT_FINITE = "the model is not finite at the starting point"


@dataclass(frozen=True)
class Solution:
    """Where a solver ended.

    Attributes
    ----------
    x : (unknowns,) parameters.
    nodes : per run, matched predictions (closed loop).
    status : how it ended.
    steps : accepted steps.
    objective : half the sum of squared residuals, priors included.
    decrement : predicted further decrease of the objective, relative to it; 0 at an optimum.
    history : objective after each step, the starting value first.
    """

    x: Array
    nodes: Nodes
    status: Status
    steps: int
    objective: float
    decrement: float
    history: tuple[float, ...]


OnStep = Callable[[int, float, Array], bool]
"""Called after each step with its number, the objective and the unknowns; False stops."""


def gauss_newton(
    problem: Problem,
    x: Array,
    *,
    max_steps: int = 100,
    tolerance: float = 1e-8,
    on_step: OnStep | None = None,
) -> Solution:
    """Minimise a lifted least-squares problem.

    Parameters
    ----------
    problem : the problem.
    x : (unknowns,) starting parameters.
    max_steps : accepted steps at most.
    tolerance : stop when a full Gauss-Newton step promises a decrease of less than this share of the objective.
    on_step : progress, and a way to stop.

    Returns
    -------
    Solution. Ctrl-C ends with `Status.INTERRUPTED` and the best point so far.
    """
    point = _Point(np.clip(x, *problem.bounds), [], np.inf)
    history: list[float] = []
    status, steps, decrement, search = Status.STEP_LIMIT, 0, np.inf, _Search()
    try:
        point = _at(problem, point.x)
        if not np.isfinite(point.objective):
            return Solution(point.x, point.nodes, Status.NOT_FINITE, 0, np.inf, np.inf, ())
        history.append(point.objective)
        while True:
            equations = problem.normal_equations(point.x, point.nodes)
            decrement = _decrease(equations, _step(problem, point.x, equations, 0.0)) / max(point.objective, 1e-300)
            if decrement <= tolerance:
                status = Status.CONVERGED
                break
            if len(history) > PATIENCE and history[-1 - PATIENCE] - history[-1] < NEGLIGIBLE * history[-1]:
                status = Status.SLOW
                break
            if steps == max_steps:
                break
            better = _descent(problem, point, equations, search)
            if better is None:
                status = Status.CONVERGED if decrement <= max(tolerance, 1e-6) else Status.STALLED
                break
            point, steps = better, steps + 1
            history.append(point.objective)
            if on_step is not None and not on_step(steps, point.objective, point.x):
                status = Status.STOPPED
                break
    except KeyboardInterrupt:
        status = Status.INTERRUPTED
    return Solution(point.x, point.nodes, status, steps, point.objective, float(decrement), tuple(history))


@dataclass(frozen=True)
class _Point:
    x: Array
    nodes: Nodes
    objective: float


def _at(problem: Problem, x: Array) -> _Point:
    nodes = problem.simulated_nodes(x)
    return _Point(x, nodes, problem.objective(x, nodes))


@dataclass
class _Search:
    """What the search for a step learned from the last one: the share of a step taken, and the damping."""

    share: float = 1.0
    damping: float = 1e-5


def _descent(problem: Problem, point: _Point, equations: NormalEquations, search: _Search) -> _Point | None:
    """The next point: a step shortened until the objective falls as promised, damped if no share of it helps."""
    while search.damping < 1e8:
        step = _step(problem, point.x, equations, search.damping)
        promised = -float(equations.g @ step)
        share = min(1.0, 2.5 * search.share)
        while share > 1e-3:
            trial = _at(problem, np.clip(point.x + share * step, *problem.bounds))
            if trial.objective < point.objective - 1e-2 * share * promised:
                search.share, search.damping = share, max(search.damping / 10.0, 1e-5)
                return trial
            share *= 0.4
        search.share, search.damping = 1.0, search.damping * 100.0
    return None


def _step(problem: Problem, x: Array, equations: NormalEquations, damping: float) -> Array:
    """The damped Gauss-Newton step within bounds.

    Unknowns that would leave their bounds are put on them and the others solved for again: clipping alone would
    leave the others where they were best only together with what was clipped.
    """
    low, high = problem.bounds
    step = np.zeros_like(x)
    movable = problem.free & ~((x <= low) & (equations.g > 0)) & ~((x >= high) & (equations.g < 0))
    scale = np.diag(equations.H).copy()
    scale[scale <= 0] = 1.0
    H = equations.H + np.diag((damping + 1e-12) * scale)
    unit = 1.0 / np.sqrt(scale)  # unknowns in units of their own curvature: their SI units span orders of magnitude
    while np.any(movable):
        fixed = ~movable
        force = equations.g[movable] + H[np.ix_(movable, fixed)] @ step[fixed]
        by = unit[movable]
        step[movable] = by * la.solve(H[np.ix_(movable, movable)] * np.outer(by, by), -by * force, assume_a="pos")
        outside = movable & ((x + step < low) | (x + step > high))
        if not np.any(outside):
            break
        step[outside] = np.clip(x + step, low, high)[outside] - x[outside]
        movable &= ~outside
    return step


def _decrease(equations: NormalEquations, step: Array) -> float:
    return float(-(equations.g @ step + 0.5 * step @ equations.H @ step))
