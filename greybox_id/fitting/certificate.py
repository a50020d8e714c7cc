"""Certifying an optimum: Ipopt on the same problem confirms it, or carries on from it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ..engine.motion.shooting import MotionProblem
from ..engine.shooting import Problem
from ..engine.solvers.gauss_newton import Solution, Status, gauss_newton
from ..engine.solvers.ipopt import NEAR, SAME, ipopt
from ..engine.solvers.quasi_newton import refine, settle
from .how import Say
from .provenance import Certificate

CERTIFYING_ITERATIONS, CERTIFYING_CLOSED_LOOP, CONTINUING_ITERATIONS, CORNER_ITERATIONS = 30, 15, 8, 3
"""Ipopt's iterations where Gauss-Newton converged, open and closed loop (each costs up to half a second with 544
weights), where it only carries on, and at a corner, where no gradient is zero and it can only try to gain."""
NOTHING = 1e-3
"""The objective is a number of squared standard deviations: a gain of so much moves no parameter by a twentieth of its
own. Where a few parameters are to be told, an optimum is confirmed only if there is not even that to gain."""


REFINED, REFINING_STEPS, QUICK_STEPS = 1e-8, 10, 30
"""Share of the objective that a step may still promise when a network's optimum is shown to Ipopt, and steps that get
it there, the last those that do not linearise. Where Gauss-Newton ends, its steps gain a decade each, and Ipopt's first
iterations hardly any."""


def certified(problem: Problem | MotionProblem, result: Solution, say: Say) -> tuple[Solution, Certificate]:
    """Ask Ipopt; keep what it found where that is better."""
    corner = np.inf
    if isinstance(problem, Problem) and result.status in (Status.CONVERGED, Status.SLOW):
        result, corner = _settled(problem, result) if problem.closed_loop else (_refined(problem, result), corner)
    converged = result.status is Status.CONVERGED
    slow = isinstance(problem, Problem) and problem.closed_loop
    certifying = CERTIFYING_CLOSED_LOOP if slow else CERTIFYING_ITERATIONS
    carrying = CORNER_ITERATIONS if corner <= NEAR else CONTINUING_ITERATIONS if slow and not converged else certifying
    say(f"{problem.trace.model.name}: Ipopt {'certifies' if converged else 'carries on'}")
    solution, verdict = ipopt(problem, result.x, warm=True, max_iterations=carrying, lifted=False)
    gained = (result.objective - solution.objective) / max(result.objective, 1e-300)
    same = SAME if isinstance(problem, Problem) else min(SAME, NOTHING / max(result.objective, 1e-300))
    optimum = solution.status is Status.CONVERGED
    in_corner = not optimum and corner <= NEAR
    certificate = Certificate(
        status=verdict.words + (IN_A_CORNER if in_corner else ""),
        confirmed=(optimum or in_corner) and gained < same,
        iterations=verdict.iterations,
        objective_before=result.objective,
        objective_after=min(solution.objective, result.objective),
        gradient=corner if in_corner else verdict.gradient,
        violation=verdict.violation,
        cpu_seconds=verdict.cpu_seconds,
    )
    if solution.status is Status.INTERRUPTED:
        return replace(result, status=Status.INTERRUPTED), certificate
    if isinstance(problem, MotionProblem) and certificate.confirmed:
        return replace(result, status=Status.CONVERGED), certificate  # Ipopt stays a little off its bounds
    if gained <= 0:
        return result, certificate
    status = Status.CONVERGED if solution.status is Status.CONVERGED else result.status
    return replace(solution, status=status, steps=result.steps, history=result.history), certificate


CLOSE, GRADIENTS = float(np.sqrt(2.0 * NOTHING)), 60
"""How far about an optimum gradients are averaged, in standard deviations by its curvature: so far, the objective
changes by `NOTHING`; gradients that are looked at."""
IN_A_CORNER = "; the optimum lies at a kink between local models, where the gradients on both sides balance"


def _settled(problem: Problem, solution: Solution) -> tuple[Solution, float]:
    """An optimum in closed loop, and the average of the gradients about it: feeding back crosses corners."""
    x, objective, average = settle(
        problem, solution.x, problem.gradient, radius=CLOSE, least=NEAR, steps=GRADIENTS
    )  # fmt: skip
    status = Status.CONVERGED if average <= NEAR else solution.status
    nodes = problem.simulated_nodes(x)
    history = (*solution.history, objective) if objective < solution.objective else solution.history
    return replace(solution, x=x, nodes=nodes, objective=objective, status=status, history=history), average


def _refined(problem: Problem, result: Solution) -> Solution:
    """The same optimum, some steps nearer; as it was found where they gain nothing."""
    x, history = refine(problem, result.x, problem.gradient, tolerance=REFINED, steps=QUICK_STEPS)
    nearer = gauss_newton(problem, x, tolerance=REFINED, negligible=0.0, max_steps=REFINING_STEPS)
    if nearer.status is Status.INTERRUPTED or nearer.objective > result.objective:
        return result
    steps = result.steps + len(history) - 1 + nearer.steps
    known = (*result.history, *history[1:], *nearer.history[1:])
    status = Status.CONVERGED if nearer.status is Status.CONVERGED else result.status
    return replace(nearer, status=status, steps=steps, history=known)
