"""The steps of fitting a model with memory: each part alone on measured inputs, then all parts in closed loop."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace

import numpy as np

from ..base.errors import BadInput
from ..base.processes import apart, side_by_side
from ..base.shorthands import Array
from ..datasets.recording import Recording, join
from ..engine.shooting import Problem
from ..engine.solvers.gauss_newton import Solution, Status, gauss_newton
from ..engine.solvers.ipopt import ipopt
from ..engine.trace import Trace
from ..models.memory_model import MemoryModel
from .attempt import certified
from .crossvalidation import choose_strengths
from .how import FitOptions, Say, quiet
from .provenance import Certificate, Stage

MOST_STEPS = 150
TOLERANCE = 1e-5
"""With some thousand residuals this is a hundredth of a unit of the objective, of which half a unit is one standard
deviation of a parameter: the gain of a further step would be invisible."""
PATIENCE = 5
"""Early stopping ends after this many steps in a row without a lower validation error."""
GUESSED_NOISE, SHORT, SPREAD = 0.35, 12, 0.3
"""Noise assumed for the first brief fit, as a share of the signal's spread; its number of steps; spread of random
starts. A large share makes the first fit a strongly regularised one: a network fitted loosely first ends in worse
optima (MS-NN-long, share 0.15 against 0.35)."""
WEAK = 0.3
"""Strength of priors under early stopping: the stopping itself regularises."""


def fit_alone(
    part: MemoryModel,
    recordings: Sequence[Recording],
    validate: Recording | None,
    how: FitOptions,
    say: Say,
    alone: bool,
) -> tuple[Problem, Solution, Stage]:
    """Step 1: fit one part on measured inputs; `alone` if no step 2 follows."""
    clock = time.process_time()
    trace = Trace(part)
    noise, near, laid = fit_briefly(trace, recordings)
    checked = time.process_time()
    tried: tuple[tuple[Mapping[str, float], float], ...] = ()
    interrupted = False
    if how.strengths == "cross-validation":
        choice = choose_strengths(trace, recordings, noise, near, say)
        strengths, tried, interrupted = choice.strengths, choice.tried, choice.interrupted
        near = near if choice.x is None else choice.x
    else:
        factor = WEAK if how.strengths == "early stopping" else float(how.strengths)
        strengths = {p.prior.strength: factor for p in part.parameters if p.prior is not None and p.prior.strength}
    checking = time.process_time() - checked
    problem = laid.counted(noise=noise, strengths=strengths)
    first = problem.start if how.strengths == "early stopping" else near
    starts, away = _starts(problem, first, how), apart(how.starts, how.jobs)

    def name(k: int) -> str:
        return part.name if how.starts == 1 else f"{part.name}, start {k + 1} of {how.starts}"

    def report_progress(k: int, solution: Solution) -> bool:
        if away:
            say(f"{name(k)}: {solution.status.value} after {solution.steps} steps")
        return solution.status is not Status.INTERRUPTED

    done = side_by_side(
        lambda k: _solve(problem, starts[k], validate, how, quiet if away else say, name(k)),
        how.starts,
        how.jobs,
        report_progress,
    )
    solutions = done.results
    best = min(solutions, key=lambda solution: solution.objective)
    if done.interrupted:
        best = replace(best, status=Status.INTERRUPTED)
    best, certificate = _checked(problem, best, how, say) if alone else (best, None)
    stage = Stage(
        model=part.name, closed_loop=False, status=best.status.value, converged=best.status is Status.CONVERGED,
        steps=best.steps, history=best.history, starts=tuple(sorted(s.objective for s in solutions)),
        strengths=strengths, strengths_from=how.mode + (", interrupted" if interrupted else ""), tried=tried,
        noise=dict(zip(part.outputs, noise.tolist(), strict=True)),
        cpu_seconds=time.process_time() - clock - checking + done.cpu_seconds,
        cross_validation_seconds=checking, certificate=certificate,
    )  # fmt: skip
    return problem, best, stage


def fit_together(
    problem: Problem,
    strengths: Mapping[str, float],
    validate: Recording | None,
    how: FitOptions,
    say: Say,
    interrupted: bool,
) -> tuple[Solution, Stage]:
    """Step 2: fit all parts in closed loop; if step 1 was interrupted, the start is returned."""
    clock = time.process_time()
    model = problem.trace.model
    if interrupted:
        say(f"{model.name}: interrupted; what was fitted so far is kept")
        nodes = problem.simulated_nodes(problem.start)
        objective = problem.objective(problem.start, nodes)
        solution = Solution(problem.start, nodes, Status.INTERRUPTED, 0, objective, np.nan, (objective,))
    else:
        solution = _solve(problem, problem.start, validate, how, say, f"{model.name}, closed loop")
    solution, certificate = _checked(problem, solution, how, say)
    return solution, Stage(
        model=model.name, closed_loop=True, status=solution.status.value,
        converged=solution.status is Status.CONVERGED, steps=solution.steps, history=solution.history,
        starts=(solution.objective,), strengths=strengths, strengths_from=how.mode, tried=(),
        noise=dict(zip(model.outputs, problem.noise.tolist(), strict=True)),
        cpu_seconds=time.process_time() - clock, cross_validation_seconds=0.0, certificate=certificate,
    )  # fmt: skip


def _solve(problem: Problem, x: Array, validate: Recording | None, how: FitOptions, say: Say, name: str) -> Solution:
    def report(step: int, objective: float, _: Array) -> bool:
        say(f"{name}: step {step}, objective {objective:.6g}", passing=True)
        return True

    if how.solver == "ipopt":
        say(f"{name}: Ipopt, {problem.layout.size} parameters")
        return ipopt(problem, x)[0]
    if how.strengths != "early stopping" or validate is None:
        solution = gauss_newton(problem, x, max_steps=MOST_STEPS, tolerance=TOLERANCE, on_step=report)
        say(f"{name}: {solution.status.value} after {solution.steps} steps")
        return solution
    watch = _Watch(problem, x, validate, report)
    solution = gauss_newton(problem, x, max_steps=MOST_STEPS, tolerance=TOLERANCE, on_step=watch)
    say(f"{name}: stopped early, best on the validation recording at step {watch.best_step} of {solution.steps}")
    nodes = problem.simulated_nodes(watch.best)
    status = solution.status if solution.status is Status.INTERRUPTED else Status.EARLY
    return replace(solution, x=watch.best, nodes=nodes, objective=problem.objective(watch.best, nodes), status=status)


class _Watch:
    """Keeps the point with the lowest validation error, the start included; stops after PATIENCE steps without one."""

    def __init__(
        self, problem: Problem, start: Array, validate: Recording, report: Callable[[int, float, Array], bool]
    ) -> None:
        self._problem, self._report = problem, report
        self._validation = Problem(
            problem.trace, [validate], closed_loop=problem.closed_loop, noise=problem.noise, strengths={}
        )
        self.best, self.best_step, self._least = start, 0, self._error(start)

    def __call__(self, step: int, objective: float, x: Array) -> bool:
        error = self._error(x)
        if error < self._least:
            self.best, self.best_step, self._least = x, step, error
        return self._report(step, objective, x) and step - self.best_step < PATIENCE

    def _error(self, x: Array) -> float:
        shared = self._validation.unknowns(self._problem.shared(x))
        return self._validation.misfit(shared, self._validation.simulated_nodes(shared))


def _checked(problem: Problem, solution: Solution, how: FitOptions, say: Say) -> tuple[Solution, Certificate | None]:
    """The solution certified by Ipopt; as it is after early stopping, which by intent ends off the optimum."""
    if how.solver != "auto" or how.strengths == "early stopping" or solution.status is Status.INTERRUPTED:
        return solution, None
    try:
        return certified(problem, solution, say)
    except KeyboardInterrupt:
        return replace(solution, status=Status.INTERRUPTED), None


def fit_briefly(trace: Trace, recordings: Sequence[Recording]) -> tuple[Array, Array, Problem]:
    """A short first fit: residual standard deviation of each output, the final unknowns, and the problem."""
    model = trace.model
    measured = join(recordings, "training data")
    guess = np.array([max(GUESSED_NOISE * float(np.nanstd(measured[name])), 1e-9) for name in model.outputs])
    problem = Problem(trace, recordings, noise=guess)
    solution = gauss_newton(problem, problem.start, max_steps=SHORT, tolerance=1e-3)
    if solution.status is Status.INTERRUPTED:
        raise KeyboardInterrupt
    if solution.status is Status.NOT_FINITE:
        raise BadInput(
            f"Model {model.name} gives no finite predictions of {measured.name} at its nominal parameters. "
            "Check the recording's units, or start from other values."
        )
    pairs = zip(problem.runs, problem.simulated(solution.x, solution.nodes), strict=True)
    errors = np.concatenate([simulated - run.measured[run.predicted] for run, simulated in pairs])
    return np.maximum(np.sqrt(np.mean(errors**2, axis=0)), 1e-9), solution.x, problem


def _starts(problem: Problem, first: Array, how: FitOptions) -> list[Array]:
    """The first start, and random ones around the nominal values."""
    random = np.random.default_rng(how.seed)
    start = problem.start
    size = np.where(np.isfinite(start), np.abs(start), 0.0)  # an effect's null may be infinite
    scale = size + np.sqrt(np.mean(size**2)) * 0.1
    others = [start + SPREAD * scale * random.standard_normal(len(start)) for _ in range(how.starts - 1)]
    return [first, *(np.where(problem.free, np.clip(x, *problem.bounds), start) for x in others)]
