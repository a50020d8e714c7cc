"""Condensed Gauss-Newton with Levenberg-Marquardt damping, bounds and a filter.

Every step solves the small dense normal equations that are left when the nodes are eliminated. A trial point is
accepted when it improves the objective or the matching conditions and no earlier point was better in both
(Fletcher & Leyffer, Math. Program. 91, 2002): an L1 merit would have to guess a penalty, and stalls.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from enum import Enum

import numpy as np
import scipy.linalg as la
from numpy.typing import NDArray

from ..parameter import Array
from ..engine.shooting import Nodes, NormalEquations, Problem


class Status(Enum):
    """How a solver ended, in words."""

    CONVERGED = "converged"
    STOPPED = "stopped by the caller before convergence"
    INTERRUPTED = "interrupted; the best point so far is kept"
    STEP_LIMIT = "step limit reached before convergence"
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
    nodes: Nodes | None = None,
    max_steps: int = 100,
    tolerance: float = 1e-8,
    on_step: OnStep | None = None,
) -> Solution:
    """Minimise a lifted least-squares problem.

    Parameters
    ----------
    problem : the problem.
    x : (unknowns,) starting parameters.
    nodes : starting nodes; None starts at the measurements.
    max_steps : accepted steps at most.
    tolerance : stop when the next step promises a decrease of less than this share of the objective.
    on_step : progress, and a way to stop.

    Returns
    -------
    Solution. Ctrl-C ends with `Status.INTERRUPTED` and the best point so far.
    """
    damping = 1e-7
    nodes = problem.measured_nodes() if nodes is None else nodes
    equations = problem.normal_equations(x, nodes)
    history = [equations.objective]
    if not np.isfinite(equations.objective):
        return Solution(x, nodes, Status.NOT_FINITE, 0, np.inf, np.inf, tuple(history))
    passed: list[tuple[float, float]] = []
    status, steps, decrement = Status.STEP_LIMIT, 0, np.inf
    try:
        while steps < max_steps:
            movable = _movable(problem, x, equations.g)
            step = _step(equations, movable, 0.0)
            decrement = _decrease(equations, step) / max(equations.objective, 1e-300)
            if decrement <= tolerance and equations.violation <= 1e-6 * len(problem.runs):
                status = Status.CONVERGED
                break
            trial = _accepted(problem, x, nodes, equations, movable, passed, damping)
            if trial is None:
                status = Status.CONVERGED if decrement <= 1e3 * tolerance else Status.STALLED
                break
            x, nodes, damping = trial
            equations = problem.normal_equations(x, nodes)
            history.append(equations.objective)
            steps += 1
            if on_step is not None and not on_step(steps, equations.objective, x):
                status = Status.STOPPED
                break
    except KeyboardInterrupt:
        status = Status.INTERRUPTED
    nodes = problem.simulated_nodes(x)
    objective, _ = problem.merit(x, nodes)
    return Solution(x, nodes, status, steps, objective, float(decrement), tuple(history))


def _accepted(
    problem: Problem,
    x: Array,
    nodes: Nodes,
    equations: NormalEquations,
    movable: NDArray[np.bool_],
    passed: list[tuple[float, float]],
    damping: float,
) -> tuple[Array, Nodes, float] | None:
    """The next point and damping, raising the damping until the filter accepts; None when no step helps."""
    here = (equations.objective, equations.violation)
    while damping < 1e10:
        step = _step(equations, movable, damping)
        target = np.clip(x + step, *problem.bounds)
        there = problem.moved(nodes, equations, target - x) if nodes else []
        objective, violation = problem.merit(target, there)
        if _acceptable((objective, violation), [*passed, here]):
            if here[1] > 1e-9:
                passed.append(here)
            return target, there, max(damping / 8, 1e-10)
        damping = max(damping * 5, 1e-6)
    return None


def _acceptable(point: tuple[float, float], others: list[tuple[float, float]]) -> bool:
    objective, violation = point
    if not np.isfinite(objective):
        return False
    margin = 1e-5
    return all(objective < f - margin * v - 1e-13 * abs(f) or violation < (1 - margin) * v - 1e-12 for f, v in others)


def _movable(problem: Problem, x: Array, g: Array) -> NDArray[np.bool_]:
    """Free unknowns that are not held at a bound by the gradient."""
    low, high = problem.bounds
    return np.asarray(problem.free & ~((x <= low) & (g > 0)) & ~((x >= high) & (g < 0)))


def _step(equations: NormalEquations, movable: NDArray[np.bool_], damping: float) -> Array:
    step = np.zeros_like(equations.g)
    H = equations.H[np.ix_(movable, movable)].copy()
    scale = np.diag(H).copy()
    scale[scale <= 0] = 1.0
    H[np.diag_indices_from(H)] += (damping + 1e-13) * scale
    step[movable] = la.solve(H, -equations.g[movable], assume_a="sym" if damping == 0.0 else "pos")
    return step


def _decrease(equations: NormalEquations, step: Array) -> float:
    return float(-(equations.g @ step + 0.5 * step @ equations.H @ step))
