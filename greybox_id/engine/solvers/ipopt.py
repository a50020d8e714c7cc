"""Ipopt on the same problem: it certifies an optimum of Gauss-Newton, or continues from its last point.

The objective is the least-squares objective with states and predictions eliminated by simulation, so bounds are the
only constraints; the Hessian is Gauss-Newton's.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import casadi as cs
import numpy as np

from ...base.shorthands import Array, Mask
from ..least_squares import LeastSquares
from ..motion.shooting import MotionProblem
from ..shooting import Problem
from .gauss_newton import Solution, Status

UNLIMITED = 1e10
"""Ipopt accepts no infinite values: an effect at its infinite null (no limit at all) is fixed to this value."""
SAME = 2e-5
"""An optimum is confirmed when Ipopt improves the objective by less than this share."""
CONFIRMED_WITHIN = 5e-3
"""Gradient, in units of the unknowns' curvature, at which an optimum of a network is confirmed: no single weight would
move by more than a two-hundredth of its standard deviation with all others fixed. Ipopt takes Gauss-Newton steps, which
gain slowly along a network's bent valleys; therefore the objective must hardly fall either."""


@dataclass(frozen=True)
class IpoptVerdict:
    """Ipopt's own report on its solution.

    Attributes
    ----------
    words : Ipopt's return status.
    iterations : its iterations.
    gradient : infinity norm of the dual infeasibility at the end.
    violation : largest constraint violation at the end; bounds are the only constraints.
    cpu_seconds : CPU time, s.
    """

    words: str
    iterations: int
    gradient: float
    violation: float
    cpu_seconds: float


def ipopt(
    problem: Problem | MotionProblem, x: Array, *, max_iterations: int = 200, warm: bool = False
) -> tuple[Solution, IpoptVerdict]:
    """Minimise a least-squares problem with Ipopt.

    Parameters
    ----------
    problem : the problem.
    x : (unknowns,) starting parameters.
    warm : x is thought to be the optimum: start Ipopt there, close to bounds if necessary.

    Returns
    -------
    Solution and Ipopt's verdict.
    """
    clock = time.process_time()
    least_squares: LeastSquares = problem
    start_equations = least_squares.normal_equations(x, least_squares.simulated_nodes(x))
    scale = _units(start_equations.H, problem.free)
    Z, gamma, none = cs.MX.sym("Z", len(x)), cs.MX.sym("gamma"), cs.MX.sym("none", 0)
    objective, equations = _computed(problem, scale)
    f, (g, H) = objective(cs.DM(scale) * Z), equations(cs.DM(scale) * Z)
    options: dict[str, Any] = {
        "print_time": False,
        "ipopt.print_level": 0,
        "ipopt.sb": "yes",
        "ipopt.max_iter": max_iterations,
        "ipopt.tol": (CONFIRMED_WITHIN if isinstance(problem, Problem) else 1e-4) if warm else 1e-6,
        "ipopt.linear_solver": "mumps",
        "ipopt.mu_strategy": "adaptive",
        "ipopt.fixed_variable_treatment": "make_parameter",
        "error_on_fail": False,
        "show_eval_warnings": False,  # a trial point beyond all bounds is Ipopt's affair; it shortens the step
        "grad_f": cs.Function("grad_f", [Z, none], [f, g]),
        "hess_lag": cs.Function("hess_lag", [Z, none, gamma, cs.MX.sym("lam", 0)], [gamma * cs.triu(H)]),
        "no_nlp_grad": True,  # callbacks have no derivatives of their own
    }
    if warm:
        options |= {
            "ipopt.warm_start_init_point": "yes",
            "ipopt.mu_strategy": "monotone",
            "ipopt.mu_init": 1e-9,
            **{f"ipopt.warm_start_{kind}_push": 1e-9 for kind in ("bound", "slack_bound", "mult_bound")},
            **{f"ipopt.warm_start_{kind}_frac": 1e-9 for kind in ("bound", "slack_bound")},
        }
    solver = cs.nlpsol("ipopt", "ipopt", {"x": Z, "f": f}, options)
    limited = np.clip(x, -UNLIMITED, UNLIMITED)
    start, low, high = (value / scale for value in (limited, *_bounds(problem, limited)))
    moving = low < high
    if np.any(np.isnan([start, low, high])) or not np.all(np.isfinite(start_equations.g[moving])):
        at_start = Solution(x, problem.simulated_nodes(x), Status.NOT_FINITE, 0, np.inf, np.nan, ())
        return at_start, IpoptVerdict("Invalid number at the start", 0, np.nan, np.nan, time.process_time() - clock)
    result = solver(x0=start, lbx=low, ubx=high, lbg=0.0, ubg=0.0)
    stats = solver.stats()
    unknowns = np.clip(np.asarray(result["x"].full()).ravel() * scale, *problem.bounds)
    unknowns[np.isinf(x)] = x[np.isinf(x)]
    matched = least_squares.simulated_nodes(unknowns)
    final_objective = least_squares.objective(unknowns, matched)
    trajectory = stats.get("iterations", {})
    status = {
        "Solve_Succeeded": Status.CONVERGED,
        "Solved_To_Acceptable_Level": Status.CONVERGED,
        "Maximum_Iterations_Exceeded": Status.STEP_LIMIT,
        "User_Requested_Stop": Status.INTERRUPTED,
    }.get(stats["return_status"], Status.STALLED)
    solution = Solution(
        unknowns, matched, status, int(stats["iter_count"]), final_objective, np.nan, tuple(trajectory.get("obj", ()))
    )
    return solution, IpoptVerdict(
        words=stats["return_status"].replace("_", " "),
        iterations=int(stats["iter_count"]),
        gradient=float(trajectory.get("inf_du", [np.nan])[-1]),
        violation=float(trajectory.get("inf_pr", [np.nan])[-1]),
        cpu_seconds=time.process_time() - clock,
    )


class Computed(cs.Callback):  # type: ignore[misc]
    """A CasADi function of one vector whose results numpy computes, once per point.

    Parameters
    ----------
    name : of the function.
    size : length of the vector.
    patterns : sparsity of each result.
    values : vector -> nonzeros of each result, column by column.
    """

    def __init__(
        self, name: str, size: int, patterns: Sequence[cs.Sparsity], values: Callable[[Array], Sequence[Array]]
    ) -> None:
        cs.Callback.__init__(self)
        self._size, self._patterns, self._values = size, list(patterns), values
        self._last: tuple[Array, Sequence[Array]] | None = None
        self.construct(name, {})

    def get_n_in(self) -> int:
        """One argument: the vector."""
        return 1

    def get_n_out(self) -> int:
        """Number of results."""
        return len(self._patterns)

    def get_sparsity_in(self, _: int) -> cs.Sparsity:
        """Sparsity of the vector."""
        return cs.Sparsity.dense(self._size, 1)

    def get_sparsity_out(self, k: int) -> cs.Sparsity:
        """Sparsity of result k."""
        return self._patterns[k]

    def has_eval_buffer(self) -> bool:
        """Results are written into CasADi's own memory: a dense `cs.DM` of 544 columns takes 40 ms to make."""
        return True

    def eval_buffer(self, arguments: Sequence[memoryview], results: Sequence[memoryview | None]) -> int:
        """Write the requested results; return 0, CasADi's code for success."""
        x = np.frombuffer(arguments[0])
        if self._last is None or not np.array_equal(self._last[0], x):
            self._last = (x.copy(), self._values(x.copy()))
        for result, known in zip(results, self._last[1], strict=True):
            if result is not None and len(result):
                np.frombuffer(result)[:] = known
        return 0


def _units(H: Array, free: Mask) -> Array:
    """(unknowns,) unit of each unknown for Ipopt: the inverse root of its curvature, rounded to a power of two.

    Ipopt has one tolerance for all unknowns, and the curvatures of a network's weights and of a vehicle's parameters
    span ten orders of magnitude. Powers of two scale without rounding, so that results cached at x remain valid.
    """
    curvature = np.diag(H)
    informed = free & np.isfinite(curvature) & (curvature > 0)
    return np.where(informed, np.exp2(-np.round(np.log2(np.where(informed, curvature, 1.0)) / 2.0)), 1.0)


def _computed(problem: LeastSquares, scale: Array) -> tuple[Computed, Computed]:
    """The objective, and its gradient and Gauss-Newton Hessian in units of `scale`, as CasADi functions.

    Far from the optimum they may not be finite; Ipopt then shortens its step.
    """

    @np.errstate(over="ignore", invalid="ignore")
    def objective(x: Array) -> list[Array]:
        return [np.array([problem.objective(x, problem.simulated_nodes(x))])]

    @np.errstate(over="ignore", invalid="ignore")
    def equations(x: Array) -> list[Array]:
        normal = problem.normal_equations(x, problem.simulated_nodes(x))
        return [scale * normal.g, (np.outer(scale, scale) * normal.H).ravel(order="F")]

    size = len(scale)
    one, column, square = (cs.Sparsity.dense(*shape) for shape in ((1, 1), (size, 1), (size, size)))
    return Computed("objective", size, [one], objective), Computed("equations", size, [column, square], equations)


def _bounds(problem: LeastSquares, x: Array) -> tuple[Array, Array]:
    """Bounds of all unknowns; fixed ones, and those that mean no limit at all, are bounded to their value."""
    pinned = ~problem.free | (np.abs(x) >= UNLIMITED)
    low, high = (np.where(pinned, x, bound) for bound in problem.bounds)
    return low, high
