"""Ipopt on the same problem, lifted over time: it certifies what Gauss-Newton found, or carries on from it.

The programs are in `programs.py` and `motion_program.py`. Their objective is the least-squares objective, bounds are
bounds, and the Hessian is Gauss-Newton's.
"""

from __future__ import annotations

import time
from dataclasses import dataclass
from typing import Any

import casadi as cs
import numpy as np

from ...base.shorthands import Array
from ..least_squares import LeastSquares
from ..motion.shooting import MotionProblem
from ..shooting import Problem
from .gauss_newton import Solution, Status
from .motion_program import MotionProgram
from .programs import UNLIMITED, Condensed, Lifted, bounds_of

SAME = 2e-5
"""An optimum is confirmed when Ipopt improves the objective by less than this share."""
NEAR = 5e-3
"""Gradient, by unknowns in units of their curvature, at which an optimum of a network is confirmed: no weight by itself
would move by more than a two-hundredth of the standard deviation that it has where all others stay. Ipopt's steps are
those of Gauss-Newton, which gain slowly along a network's bent valleys; besides, the objective must hardly fall."""


@dataclass(frozen=True)
class IpoptVerdict:
    """What Ipopt said.

    Attributes
    ----------
    words : Ipopt's return status.
    iterations : its iterations.
    gradient : infinity norm of the dual infeasibility at the end.
    violation : largest gap of the constraints at the end, in the outputs' units.
    cpu_seconds : s.
    """

    words: str
    iterations: int
    gradient: float
    violation: float
    cpu_seconds: float


def ipopt(
    problem: Problem | MotionProblem, x: Array, *, max_iterations: int = 200, warm: bool = False, lifted: bool = True
) -> tuple[Solution, IpoptVerdict]:
    """Minimise a lifted least-squares problem with Ipopt.

    Parameters
    ----------
    problem : the problem.
    x : (unknowns,) starting parameters; nodes start at a simulation where `warm`, else at the measurements.
    warm : x is believed to be the optimum: keep it where it is, close to bounds if it must be.
    lifted : closed loop, keep the nodes as unknowns; False eliminates them by simulation, which has the same optima
        and, with hundreds of weights, factorises twenty times faster.

    Returns
    -------
    Solution and Ipopt's verdict.
    """
    clock = time.process_time()
    program = _program(problem, x, lifted)
    options: dict[str, Any] = {
        "print_time": False,
        "ipopt.print_level": 0,
        "ipopt.sb": "yes",
        "ipopt.max_iter": max_iterations,
        "ipopt.tol": (NEAR if isinstance(program, Condensed) else 1e-4) if warm else 1e-6,
        "ipopt.linear_solver": "mumps",
        "ipopt.mu_strategy": "adaptive",
        "ipopt.fixed_variable_treatment": "make_parameter",
        "error_on_fail": False,
        "show_eval_warnings": False,  # a trial point beyond all bounds is Ipopt's affair; it shortens the step
        **program.derivatives,
    }
    if warm:
        options |= {
            "ipopt.warm_start_init_point": "yes",
            "ipopt.mu_strategy": "monotone",
            "ipopt.mu_init": 1e-9,
            **{f"ipopt.warm_start_{kind}_push": 1e-9 for kind in ("bound", "slack_bound", "mult_bound")},
            **{f"ipopt.warm_start_{kind}_frac": 1e-9 for kind in ("bound", "slack_bound")},
        }
    solver = cs.nlpsol("ipopt", "ipopt", program.nlp, options)
    limited = np.clip(x, -UNLIMITED, UNLIMITED)
    scale = np.ones(program.size) if isinstance(program, Lifted) else program.scale
    low, high = (bound / scale for bound in bounds_of(problem, limited, program.size))
    start = program.start(limited, warm)
    if np.any(np.isnan([start, low, high])):
        where = Solution(x, problem.simulated_nodes(x), Status.NOT_FINITE, 0, np.inf, np.nan, ())
        return where, IpoptVerdict("Invalid number at the start", 0, np.nan, np.nan, time.process_time() - clock)
    result = solver(x0=start, lbx=low, ubx=high, lbg=0.0, ubg=0.0)
    stats = solver.stats()
    unknowns = np.clip((np.asarray(result["x"].full()).ravel() * scale)[: len(x)], *problem.bounds)
    unknowns[np.isinf(x)] = x[np.isinf(x)]
    same: LeastSquares = problem
    matched = same.simulated_nodes(unknowns)
    objective = same.objective(unknowns, matched)
    trajectory = stats.get("iterations", {})
    status = {
        "Solve_Succeeded": Status.CONVERGED,
        "Solved_To_Acceptable_Level": Status.CONVERGED,
        "Maximum_Iterations_Exceeded": Status.STEP_LIMIT,
        "User_Requested_Stop": Status.INTERRUPTED,
    }.get(stats["return_status"], Status.STALLED)
    solution = Solution(
        unknowns, matched, status, int(stats["iter_count"]), objective, np.nan, tuple(trajectory.get("obj", ()))
    )
    return solution, IpoptVerdict(
        words=stats["return_status"].replace("_", " "),
        iterations=int(stats["iter_count"]),
        gradient=float(trajectory.get("inf_du", [np.nan])[-1]),
        violation=float(trajectory.get("inf_pr", [np.nan])[-1]),
        cpu_seconds=time.process_time() - clock,
    )


def _program(problem: Problem | MotionProblem, x: Array, lifted: bool) -> Condensed | Lifted | MotionProgram:
    if isinstance(problem, MotionProblem):
        return MotionProgram(problem, x)
    return Lifted(problem) if problem.closed_loop and lifted else Condensed(problem, x)
