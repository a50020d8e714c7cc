"""The fit of a motion model from one starting point, and the certificate of its optimum.

Short prediction horizons from readings come first, then the requested horizon, which is solved again until the noise
estimated from its residuals has settled. Ipopt then confirms the optimum of the same problem, or continues from it.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from copy import copy
from dataclasses import dataclass, replace

import numpy as np

from ..base.shorthands import Array
from ..base.statistics import MIDDLE_HALF, correlation_time
from ..datasets.recording import Recording
from ..engine.motion.shooting import MotionProblem
from ..engine.motion.simulator import Simulator
from ..engine.shooting import Problem
from ..engine.solvers.gauss_newton import Solution, Status, gauss_newton, predicted_reduction
from ..engine.solvers.ipopt import CONFIRMED_WITHIN, SAME, ipopt
from ..engine.solvers.quasi_newton import refine, settle
from ..models.motion_model import MotionModel
from ..models.parameter import free_places
from .how import FitOptions, Say, quiet
from .provenance import Certificate
from .sizes import EVERY_SIZE, NEAR_SIZES, at_best_sizes

SHORT_HORIZONS = (4, 100)
"""Rows predicted from one start before the requested horizon."""
SHORT_ROWS = 4800
"""Rows used by the short horizons, which only lead to the start of the search over the requested horizon and all rows.

Twice the number from which 60 of 60 random starts led to the optimum (`benchmarks/starts.py`).
"""
GUESSED_NOISE = 0.1
"""First guess of the noise, as a share of a signal's spread."""
TOLERANCE, COMPARED, ROUGH = 1e-12, 1e-6, 1e-4
"""Tolerance of the last solve, of the last solve if only errors are compared, and of solves that settle the noise."""
MOST_STEPS, SHORT_STEPS = 100, 5
SAME_NOISE, SAME_PLACE, ROUNDS = 0.1, 1e-3, 6
"""The noise has settled when the residuals' spread changes it by less than SAME_NOISE, the observer's states when the
parameters change by less than SAME_PLACE, relatively; largest number of rounds."""
MOST_WALLS = 3
"""How often a stalled search continues with bounds where its objective jumps."""
LEAST_NOISE = 1e-9
SPREAD = 0.7
"""Standard deviation of the logarithm of positive parameters over random starts."""


def starting_points(model: MotionModel, how: FitOptions) -> list[Array]:
    """Nominal values, and random points around them, (parameters,) each: positive parameters keep their sign."""
    random = np.random.default_rng(how.seed)
    nominal = off_bounds(model, model.values)
    low = np.concatenate([np.full(p.size, p.bounds[0]) for p in model.parameters])
    high = np.concatenate([np.full(p.size, p.bounds[1]) for p in model.parameters])
    free = np.concatenate([np.full(p.size, not p.fixed) for p in model.parameters])
    points = [nominal]
    for _ in range(how.starts - 1):
        draw = random.standard_normal(model.size)
        factor = np.exp(SPREAD * draw)
        with np.errstate(invalid="ignore"):
            moved = np.where(low >= 0, nominal * factor, nominal + SPREAD * np.abs(nominal) * draw)
        moved = np.where(np.isfinite(moved), moved, nominal)
        points.append(np.where(free, np.clip(moved, low, high), nominal))
    return points


def off_bounds(model: MotionModel, p: Array) -> Array:
    """(parameters,) with free parameters at their lower bound moved inside by their prior's standard deviation.

    At a delay of zero, readings just after a command jump with the delay, and no derivative shows this jump: a search
    that starts with all delays at zero stays there, and other parameters compensate.
    """
    result, start = np.array(p), 0
    for parameter in model.parameters:
        entries, start = slice(start, start + parameter.size), start + parameter.size
        if not parameter.fixed and parameter.prior is not None:
            (low, high), sd = (
                parameter.bounds,
                np.broadcast_to(np.asarray(parameter.prior.sd, float), parameter.shape).ravel(),
            )
            inside = np.where(np.isfinite(sd), np.minimum(low + sd, 0.5 * (low + high)), low)
            result[entries] = np.where(result[entries] <= low, inside, result[entries])
    return result


@dataclass(frozen=True)
class Attempt:
    """Result from one start; about : (parameters,) near which the problem was set up."""

    problem: MotionProblem
    about: Array
    solution: Solution

    def sent(self) -> SentAttempt:
        """The attempt without its problem and simulation, for sending between processes."""
        return SentAttempt(self.problem.noise, self.about, replace(self.solution, nodes=None))

    def simulated(self) -> Attempt:
        """The attempt with the simulation at its solution."""
        x = self.solution.x
        return replace(self, solution=replace(self.solution, nodes=self.problem.simulated_nodes(x)))


@dataclass(frozen=True)
class SentAttempt:
    """An attempt between processes: the solution without its simulation, and the data to set up its problem again."""

    noise: Array
    about: Array
    solution: Solution

    def received(self, simulator: Simulator, recordings: Sequence[Recording], how: FitOptions) -> Attempt:
        """The attempt with its problem, but without the simulation."""
        return Attempt(_problem(simulator, recordings, self.noise, how, self.about), self.about, self.solution)


def attempted(
    simulator: Simulator,
    recordings: Sequence[Recording],
    p: Array,
    how: FitOptions,
    say: Say,
    name: str,
    short: Sequence[int] = SHORT_HORIZONS,
    tolerance: float = TOLERANCE,
) -> Attempt | None:
    """Fit from one start; the last point reached if interrupted; None if the model is not finite."""
    reached: Attempt | None = None  # only the last one: each has layouts of all rows
    try:
        for latest in _attempts(simulator, recordings, p, how, say, name, short, tolerance):
            if latest.solution.status is Status.NOT_FINITE:
                return None
            reached = latest
            if latest.solution.status is Status.INTERRUPTED:
                break
        else:
            return reached
    except KeyboardInterrupt:
        if reached is None:
            raise
    assert reached is not None
    problem, p, solution = reached.problem, reached.about, reached.solution
    if problem.horizon != how.horizon:  # interrupted during a short horizon: state the requested problem
        p = problem.shared(solution.x)
        problem = _problem(simulator, recordings, problem.noise, how, p)
        x = problem.unknowns(p)
        nodes = problem.simulated_nodes(x)
        solution = replace(solution, x=x, nodes=nodes, objective=problem.objective(x, nodes))
    return Attempt(problem, p, replace(solution, status=Status.INTERRUPTED))


def refitted(simulator: Simulator, recordings: Sequence[Recording], p: Array, how: FitOptions) -> Array | None:
    """The parameters fitted from one start, without messages; None if the model is not finite there."""
    attempt = attempted(simulator, recordings, p, how, quiet, simulator.trace.model.name, tolerance=COMPARED)
    if attempt is not None and attempt.solution.status is Status.INTERRUPTED:
        raise KeyboardInterrupt
    return None if attempt is None else attempt.problem.shared(attempt.solution.x)


def predicted_share(simulator: Simulator, recordings: Sequence[Recording], p: Array, how: FitOptions) -> float:
    """Share of the squared errors at p that a fit would remove if predictions were linear in the parameters.

    Each output is weighted by the spread of its errors.
    """
    problem = _problem(simulator, recordings, np.ones(len(simulator.trace.model.outputs)), how, p)
    x = problem.unknowns(p)
    nodes = problem.simulated_nodes(x)
    problem = _problem(simulator, recordings, _spread_of(problem, problem.errors(nodes)), how, p, problem)
    reduction = predicted_reduction(problem, x, problem.normal_equations(x, nodes))
    return reduction / max(problem.misfit(x, nodes), LEAST_NOISE)


def _attempts(
    simulator: Simulator,
    recordings: Sequence[Recording],
    p: Array,
    how: FitOptions,
    say: Say,
    name: str,
    short: Sequence[int],
    tolerance: float,
) -> Iterator[Attempt]:
    """Growing horizons, then the requested one until the noise has settled."""
    outputs = simulator.trace.model.outputs
    spread = np.array([_spread(recordings, output) for output in outputs])
    noise = np.maximum(GUESSED_NOISE * spread, LEAST_NOISE)
    sample_time, ahead = _sample_time(recordings), None
    for rows in short if how.solver != "ipopt" else ():
        if how.horizon is not None and rows * sample_time >= how.horizon:
            break
        ahead = MotionProblem(
            simulator, recordings, noise=noise, horizon=rows * sample_time, most_rows=SHORT_ROWS, starts="measured",
            about=p, like=ahead,
        )  # fmt: skip
        solution = gauss_newton(
            ahead, ahead.unknowns(p), max_steps=SHORT_STEPS, tolerance=1e-3, search="levenberg_marquardt"
        )
        yield Attempt(ahead, p, solution)
        say(f"{name}: {rows} rows ahead, {solution.steps} steps; {_place(ahead, solution.x)}", passing=True)
        p, noise = off_bounds(simulator.trace.model, ahead.shared(solution.x)), residual_noise(ahead, solution)
    problem = _problem(simulator, recordings, noise, how, p, ahead)
    del ahead
    x, noise_stated = problem.unknowns(p), how.noise.keys() >= {*outputs}
    x = at_best_sizes(problem, recordings, x if short else with_starts(problem, x), EVERY_SIZE, say)
    settled, steps_taken = noise_stated and not problem.carries, 0
    for rounds_left in reversed(range(ROUNDS)):
        solution = _solved(problem, x, how, tolerance if settled else ROUGH, say, name)
        steps_taken += solution.steps  # if earlier rounds ended at the optimum, the last one has no step left to take
        solution = replace(solution, steps=steps_taken)
        yield Attempt(problem, p, solution)
        x, noise = solution.x, _counted_noise(problem, solution)
        change = 0.0 if noise_stated else float(np.max(np.abs(np.log(noise / problem.noise)), initial=0.0))
        if problem.carries:
            change = max(change, SAME_NOISE / SAME_PLACE * _relative_change(p, problem.shared(x)))
        if settled and (change < SAME_NOISE or rounds_left == 0):
            break
        settled, p = change < SAME_NOISE or rounds_left == 1, problem.shared(x)
        problem.forget_targets()
        problem = _problem(simulator, recordings, noise, how, p, problem)
        x = at_best_sizes(problem, recordings, x, NEAR_SIZES, say)
    say(f"{name}: {solution.status.value} after {solution.steps} steps")


def with_starts(problem: MotionProblem, x: Array) -> Array:
    """The same parameters with optimal initial states; at optimal parameters this gives the whole optimum.

    From initial states as measured, parameters would first compensate for them, and then return along flat valleys.
    """
    if not len(problem.loose):
        return x
    starts_only = copy(problem)
    starts_only.free = problem.free & (np.arange(len(x)) >= problem.parameters.size)
    return gauss_newton(starts_only, x, max_steps=SHORT_STEPS, tolerance=TOLERANCE, search="levenberg_marquardt").x


def _solved(problem: MotionProblem, x: Array, how: FitOptions, tolerance: float, say: Say, name: str) -> Solution:
    if how.solver == "ipopt":
        say(f"{name}: Ipopt, {problem.layout.size} unknowns (parameters and initial states)")
        return ipopt(problem, x)[0]

    def report(step: int, objective: float, x: Array) -> bool:
        say(f"{name}: step {step}, objective {objective:.6g}; {_place(problem, x)}", passing=True)
        return True

    def searched(x: Array) -> Solution:
        return gauss_newton(
            problem,
            x,
            max_steps=MOST_STEPS,
            tolerance=tolerance,
            negligible=0.0,
            search="levenberg_marquardt",
            on_step=report,
        )

    solution = searched(x)
    for _ in range(MOST_WALLS):
        if solution.status is not Status.STALLED or not _bounded_at_jumps(problem, solution):
            break
        further = searched(solution.x)
        solution = replace(further, steps=solution.steps + further.steps, history=solution.history + further.history)
    return solution


def _place(problem: MotionProblem, x: Array) -> str:
    """The search's current free parameters, in SI units, as text in the format of the command line's options."""
    p = problem.shared(x)
    return " ".join(f"{name}={p[place]:.6g}" for name, place in free_places(problem.model.parameters).items())


def _bounded_at_jumps(problem: MotionProblem, solution: Solution) -> bool:
    """Bound unknowns where the problem's objective jumps up; return whether there are any.

    A delay meets such a wall where a reading would come before a command rather than after it: a search presses against
    it, and the decrease that a smooth objective predicts beyond it keeps all other parameters from their optimum.
    """
    x, (low, high) = solution.x, (bound.copy() for bound in problem.bounds)
    equations = problem.normal_equations(x, solution.nodes)
    g, curvature, result = equations.g, np.diag(equations.H), False
    for k in np.flatnonzero(problem.free & (curvature > 0.0) & (np.where(g > 0.0, x > low, x < high))):
        moved = x.copy()
        moved[k] = np.clip(x[k] - g[k] / curvature[k], low[k], high[k])
        if problem.objective(moved, problem.simulated_nodes(moved)) > solution.objective:
            result, (low if g[k] > 0.0 else high)[k] = True, x[k]
    problem.bounds = low, high
    return result


def _problem(
    simulator: Simulator,
    recordings: Sequence[Recording],
    noise: Array,
    how: FitOptions,
    about: Array,
    like: MotionProblem | None = None,
) -> MotionProblem:
    outputs = simulator.trace.model.outputs
    noise = np.array([how.noise.get(name, item) for name, item in zip(outputs, noise, strict=True)])
    return MotionProblem(
        simulator, recordings, noise=noise, horizon=how.horizon, starts=how.start_from, robust=how.robust, about=about,
        like=like,
    )  # fmt: skip


def misfit(
    attempt: Attempt, simulator: Simulator, recordings: Sequence[Recording], noise: Array | None, how: FitOptions
) -> float:
    """The objective of an attempt's solution, under another noise if given: objectives compare only under one noise."""
    noise = attempt.problem.noise if noise is None else noise
    p = attempt.problem.shared(attempt.solution.x)
    attempt.problem.forget_targets()
    problem = _problem(simulator, recordings, noise, how, p, attempt.problem)
    x = attempt.solution.x if len(attempt.solution.x) == problem.layout.size else problem.unknowns(p)
    return problem.objective(x, problem.simulated_nodes(x))


def errors_at(simulator: Simulator, recordings: Sequence[Recording], noise: Array, how: FitOptions, p: Array) -> Array:
    """(readings, outputs) prediction errors at parameters p, (parameters,); NaN where nothing is read."""
    problem = _problem(simulator, recordings, noise, how, p)
    return problem.errors(problem.simulated_nodes(problem.unknowns(p)))


def residual_noise(problem: MotionProblem, solution: Solution) -> Array:
    """Standard deviation of the residuals of each output; without residuals, the noise stays as it was.

    With a robust loss it is estimated from the median of their absolute values.
    """
    return _spread_of(problem, problem.errors(solution.nodes))


def _spread_of(problem: MotionProblem, errors: Array) -> Array:
    """As `residual_noise`, for errors (N, outputs); column by column: for hours of data a copy of all is large."""
    result = np.array(problem.noise, dtype=float)
    for k, column in enumerate(errors.T):
        finite = column[np.isfinite(column)]
        if len(finite):
            robust = problem.targets.robust is not None
            spread = MIDDLE_HALF * np.median(np.abs(finite)) if robust else np.sqrt(np.mean(finite**2))
            result[k] = max(float(spread), LEAST_NOISE)
    return result


def _counted_noise(problem: MotionProblem, solution: Solution) -> Array:
    """Effective noise per output: the residuals' spread times the root of their correlation time in rows.

    Neighbouring residuals are correlated. If they counted as independent, a long recording sampled fast would outweigh
    every prior, and the output whose error drifts most slowly would outweigh the others.
    """
    errors = problem.errors(solution.nodes)
    times = [correlation_time(np.nan_to_num(errors[:, [k]])) for k in range(errors.shape[1])]
    return _spread_of(problem, errors) * np.sqrt(times)


def _spread(recordings: Sequence[Recording], output: str) -> float:
    values = [recording[output] for recording in recordings if output in recording]
    if not values or not np.any(np.isfinite(np.concatenate(values))):
        return 1.0
    return max(float(np.nanstd(np.concatenate(values))), LEAST_NOISE)


def _sample_time(recordings: Sequence[Recording]) -> float:
    return float(np.median([recording.sample_time for recording in recordings]))


def _relative_change(before: Array, after: Array) -> float:
    """Largest change of a parameter relative to its size."""
    with np.errstate(invalid="ignore"):
        change = np.abs(after - before) / np.maximum(np.maximum(np.abs(before), np.abs(after)), 1e-9)
    return float(np.nanmax(change, initial=0.0))


def free_numbers(model: MotionModel, attempt: Attempt) -> dict[str, float]:
    """Values of the free scalar parameters at an attempt's solution."""
    p = attempt.problem.shared(attempt.solution.x)
    return {name: float(p[place]) for name, place in free_places(model.parameters).items()}


CERTIFYING_ITERATIONS, CERTIFYING_CLOSED_LOOP, CONTINUING_ITERATIONS, CORNER_ITERATIONS = 30, 15, 8, 1
"""Ipopt's iterations after Gauss-Newton converged, open and closed loop (each costs up to half a second with 544
weights), if Ipopt only continues, and at a corner, where no gradient is zero and Ipopt can only look for a decrease."""
NOTHING = 1e-3
"""The objective is a sum of squared standard deviations: a decrease of this size moves no parameter by a twentieth of
its standard deviation. With few parameters, an optimum is confirmed only if the decrease is smaller."""


REFINED, REFINING_STEPS, QUICK_STEPS = 1e-8, 10, 30
"""Tolerance to which a network's optimum is refined before Ipopt checks it, and largest numbers of refining steps with
and without linearisation. Near the optimum, Gauss-Newton steps gain a decade each, and Ipopt's first iterations hardly
anything."""


def certified(problem: Problem | MotionProblem, result: Solution, say: Say) -> tuple[Solution, Certificate]:
    """Check an optimum by Ipopt, and keep Ipopt's solution if it is better."""
    corner = np.inf
    if isinstance(problem, Problem) and result.status in (Status.CONVERGED, Status.SLOW):
        result, corner = _settled(problem, result) if problem.closed_loop else (_refined(problem, result), corner)
    converged = result.status is Status.CONVERGED
    slow = isinstance(problem, Problem) and problem.closed_loop
    certifying = CERTIFYING_CLOSED_LOOP if slow else CERTIFYING_ITERATIONS
    carrying = (
        CORNER_ITERATIONS
        if corner <= CONFIRMED_WITHIN
        else CONTINUING_ITERATIONS
        if slow and not converged
        else certifying
    )
    say(f"{problem.trace.model.name}: Ipopt {'checks the optimum' if converged else 'continues the optimisation'}")
    solution, verdict = ipopt(problem, result.x, warm=True, max_iterations=carrying)
    gained = (result.objective - solution.objective) / max(result.objective, 1e-300)
    same = SAME if isinstance(problem, Problem) else min(SAME, NOTHING / max(result.objective, 1e-300))
    optimum = solution.status is Status.CONVERGED
    in_corner = not optimum and corner <= CONFIRMED_WITHIN
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
        return replace(result, status=Status.CONVERGED), certificate  # Ipopt's point stays a little off its bounds
    if gained <= 0:
        return result, certificate
    status = Status.CONVERGED if solution.status is Status.CONVERGED else result.status
    return replace(solution, status=status, steps=result.steps, history=result.history), certificate


CLOSE, GRADIENTS = float(np.sqrt(2.0 * NOTHING)), 60
"""Radius around an optimum within which gradients are averaged, in standard deviations by its curvature: over it, the
objective changes by `NOTHING`; largest number of gradients."""
IN_A_CORNER = "; the optimum is at a kink between local models, where the gradients of both sides balance"


def _settled(problem: Problem, solution: Solution) -> tuple[Solution, float]:
    """An optimum in closed loop, and the average of the gradients around it: fed-back predictions cross corners."""
    x, objective, average = settle(
        problem, solution.x, problem.gradient, radius=CLOSE, least=CONFIRMED_WITHIN, steps=GRADIENTS
    )  # fmt: skip
    status = Status.CONVERGED if average <= CONFIRMED_WITHIN else solution.status
    nodes = problem.simulated_nodes(x)
    history = (*solution.history, objective) if objective < solution.objective else solution.history
    return replace(solution, x=x, nodes=nodes, objective=objective, status=status, history=history), average


def _refined(problem: Problem, result: Solution) -> Solution:
    """The optimum after some more steps; unchanged if they gain nothing."""
    x, history = refine(problem, result.x, problem.gradient, tolerance=REFINED, steps=QUICK_STEPS)
    nearer = gauss_newton(problem, x, tolerance=REFINED, negligible=0.0, max_steps=REFINING_STEPS)
    if nearer.status is Status.INTERRUPTED or nearer.objective > result.objective:
        return result
    steps = result.steps + len(history) - 1 + nearer.steps
    history_joined = (*result.history, *history[1:], *nearer.history[1:])
    status = Status.CONVERGED if nearer.status is Status.CONVERGED else result.status
    return replace(nearer, status=status, steps=steps, history=history_joined)
