"""Certifying an optimum: Ipopt on the same problem confirms it, or carries on from it."""

from __future__ import annotations

from dataclasses import replace

from ..engine.motion.shooting import MotionProblem
from ..engine.shooting import Problem
from ..provenance import Certificate
from ..solvers.gauss_newton import Solution, Status, gauss_newton
from ..solvers.ipopt import SAME, ipopt
from ..solvers.quasi_newton import refine
from .how import Say

CERTIFYING_ITERATIONS, CERTIFYING_CLOSED_LOOP, CONTINUING_ITERATIONS = 30, 15, 8
"""Ipopt's iterations where Gauss-Newton converged, open and closed loop (each costs up to half a second with 544
weights), and where it only carries on."""
NOTHING = 1e-3
"""The objective is a number of squared standard deviations: a gain of so much moves no parameter by a twentieth of its
own. Where a few parameters are to be told, an optimum is confirmed only if there is not even that to gain."""


REFINED, REFINING_STEPS, QUICK_STEPS = 1e-8, 10, 30
"""Share of the objective that a step may still promise when a network's optimum is shown to Ipopt, and steps that get
it there, the last those that do not linearise. Where Gauss-Newton ends, its steps gain a decade each, and Ipopt's first
iterations hardly any."""


def certified(problem: Problem | MotionProblem, found: Solution, say: Say) -> tuple[Solution, Certificate]:
    """Ask Ipopt; keep what it found where that is better."""
    converged = found.status is Status.CONVERGED
    if isinstance(problem, Problem) and converged:
        found = _refined(problem, found)
    slow = isinstance(problem, Problem) and problem.closed_loop
    certifying = CERTIFYING_CLOSED_LOOP if slow else CERTIFYING_ITERATIONS
    iterations = CONTINUING_ITERATIONS if slow and not converged else certifying
    say(f"{problem.trace.model.name}: Ipopt {'certifies' if converged else 'carries on'}")
    solution, verdict = ipopt(problem, found.x, warm=True, max_iterations=iterations, lifted=False)
    gained = (found.objective - solution.objective) / max(found.objective, 1e-300)
    same = SAME if isinstance(problem, Problem) else min(SAME, NOTHING / max(found.objective, 1e-300))
    certificate = Certificate(
        status=verdict.words,
        confirmed=solution.status is Status.CONVERGED and gained < same,
        iterations=verdict.iterations,
        objective_before=found.objective,
        objective_after=min(solution.objective, found.objective),
        gradient=verdict.gradient,
        violation=verdict.violation,
        cpu_seconds=verdict.cpu_seconds,
    )
    if solution.status is Status.INTERRUPTED:
        return replace(found, status=Status.INTERRUPTED), certificate
    if isinstance(problem, MotionProblem) and certificate.confirmed:
        return replace(found, status=Status.CONVERGED), certificate  # Ipopt stays a little off its bounds
    if gained <= 0:
        return found, certificate
    status = Status.CONVERGED if solution.status is Status.CONVERGED else found.status
    return replace(solution, status=status, steps=found.steps, history=found.history), certificate


def _refined(problem: Problem, found: Solution) -> Solution:
    """The same optimum, some steps nearer; as it was found where they gain nothing."""
    history: list[float] = []
    if not problem.closed_loop:
        x, history = refine(problem, found.x, problem.gradient, tolerance=REFINED, steps=QUICK_STEPS)
        found = replace(
            found,
            x=x,
            objective=history[-1],
            steps=found.steps + len(history) - 1,
            history=(*found.history, *history[1:]),
        )
    nearer = gauss_newton(problem, found.x, tolerance=REFINED, negligible=0.0, max_steps=REFINING_STEPS)
    if nearer.status is Status.INTERRUPTED or nearer.objective > found.objective:
        return found
    return replace(
        nearer, status=found.status, steps=found.steps + nearer.steps, history=(*found.history, *nearer.history[1:])
    )
