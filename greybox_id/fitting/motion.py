"""Fit a motion model: starting points, each led over growing horizons to the requested one, and the resulting fit.

From readings, a few samples ahead, almost any parameters give errors that point towards the optimum; over a whole run a
poor start is far from anything (attempt.py). Ipopt certifies the optimum on the same problem. If that fails, other ways
are tried before a user has to ask for them (`_fallbacks`), and the record says so.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np

from ..base.errors import BadInput
from ..base.numbers import counted, number
from ..base.processes import apart, side_by_side
from ..base.shorthands import Array
from ..datasets.recording import Recording
from ..engine.lane_targets import HOURS
from ..engine.motion.schedule import MOST_STEPS as SEGMENTS
from ..engine.motion.schedule import longest_segment, motion_runs, recorded_as
from ..engine.motion.shooting import MotionProblem
from ..engine.motion.simulator import Simulator
from ..engine.solvers.gauss_newton import Solution, Status, gauss_newton
from ..models.model import Model
from ..models.motion_model import MotionModel
from ..models.parameter import placed
from .attempt import (
    MOST_STEPS,
    SHORT_STEPS,
    TOLERANCE,
    Attempt,
    SentAttempt,
    attempted,
    certified,
    free_numbers,
    misfit,
    residual_noise,
    starting_points,
)
from .carrying import carries_over, withstands
from .fit import Fit, conflict
from .holding import stated_again
from .how import FOR_MOTION, FitOptions, Say, quiet, refused
from .provenance import Certificate, Stage
from .sizes import error_of_sizes
from .uncertainty import uncertainty
from .uncertainty.form import FormError, form_error
from .uncertainty.stated import of_stated
from .verb import FitTask, carried, estimated, refuted

CARRIED_ON, LOWER = 2, 1e-6
"""How often Gauss-Newton and Ipopt hand an unconfirmed optimum to each other; relative decrease of the objective that
justifies another round, or another way."""
SHORTER = 1.0
"""Horizon, s, that is fitted first if the requested one ends badly."""
MORE_STARTS, CLEARLY = 2, 0.01
"""Number of further starts; relative decrease of the objective for which an unconfirmed optimum replaces a confirmed
one."""
CORNER = 0.5
"""An optimum with more than this share of its free parameters at bounds is a corner, not an optimum of the vehicle."""


@estimated.register(MotionModel)
def _estimated(model: MotionModel, task: FitTask) -> Fit:
    recordings, validate, how, say = task.recordings, task.validate, task.how, task.say
    if validate is not None:
        motion_runs(model, validate)  # raises on bad data before the work, not after it
    input_signals = recorded_as(model, recordings if validate is None else [*recordings, validate])
    problem, solution, stage = fit_motion(model, recordings, how, say)
    fitted = model.with_values(problem.shared(solution.x))
    result = Fit(
        model=fitted,
        sd={p.name: np.full(p.shape, 0.0 if p.fixed else np.nan) for p in fitted.parameters},
        per_run={
            name: values
            for name, values in _named_rows(fitted, problem.per_run(solution.x)).items()
            if fitted[name].scope == "run"
        },
        stages=(stage,),
        metrics={},
        seed=task.how.seed,
        data=(),
        mode="given",
        how={
            "solver": how.solver,
            "horizon": how.horizon,
            "start_from": how.start_from,
            "robust": how.robust,
            "inputs": input_signals,
            "counted": dict(zip(model.outputs, problem.noise.tolist(), strict=True)),
            "unfitted": {p.name: float(p.array) for p in model.parameters if p.shape == () and not p.fixed},
        },
    )
    if not np.isfinite(solution.objective):
        return result
    if _of_hours(problem):
        solution = replace(solution, nodes=None)
    form = form_error(problem, solution.x, solution.nodes)
    if solution.nodes is None:
        solution = replace(solution, nodes=problem.simulated_nodes(solution.x))
    if stage.confirmed:  # away from an optimum, the curvature is meaningless
        free = int(np.sum(problem.free[: problem.parameters.size]))
        starts = int(np.sum(problem.free[problem.parameters.size : problem.layout.size]))
        and_starts = f" and {counted(starts, 'initial state')}" if starts else ""
        say(f"{model.name}: computing the uncertainty of {counted(free, 'parameter')}{and_starts}")
        result = replace(result, **_uncertain(fitted, problem, recordings, solution, form, say))
        result = replace(result, how={**result.how, **of_stated(result, problem.simulator, recordings)})
    return replace(result, how={**result.how, "form": form.as_dict()})


def fit_motion(
    model: MotionModel, recordings: Sequence[Recording], how: FitOptions, say: Say
) -> tuple[MotionProblem, Solution, Stage]:
    """Fit a motion model.

    Parameters
    ----------
    model : its nominal values are the starting point.
    recordings : training data.
    how : horizon, starts, solver, robust loss, seed.
    say : receives progress.

    Returns
    -------
    The last problem, its solution, and the record.

    Raises
    ------
    BadInput : a signal is missing, or the model is not finite at its start.
    """
    clock = time.process_time()
    simulator = Simulator(model)
    simulator.kernel.prepare()
    points, away = starting_points(model, how), apart(how.starts, how.jobs)

    def name(k: int) -> str:
        return model.name if how.starts == 1 else f"{model.name}, start {k + 1} of {how.starts}"

    def work(k: int) -> Attempt | SentAttempt | None:
        result = attempted(simulator, recordings, points[k], how, quiet if away else say, name(k))
        return result.sent() if how.starts > 1 and result is not None else result  # the same for any number of jobs

    def report_progress(k: int, attempt: Attempt | SentAttempt | None) -> bool:
        if away and attempt is not None:
            say(f"{name(k)}: {attempt.solution.status.value} after {attempt.solution.steps} steps")
        return attempt is None or attempt.solution.status is not Status.INTERRUPTED

    done = side_by_side(work, len(points), how.jobs, report_progress)
    received = (
        one.received(simulator, recordings, how) if isinstance(one, SentAttempt) else one for one in done.results
    )
    attempts = [one for one in received if one is not None]
    interrupted = done.interrupted or any(one.solution.status is Status.INTERRUPTED for one in attempts)
    noise = attempts[0].problem.noise if attempts else None  # objectives compare only under one noise
    scores = [misfit(attempt, simulator, recordings, noise, how) for attempt in attempts]
    order = np.argsort(scores, kind="stable").tolist()
    reached = _Reached(*_of(attempts[order[0]].simulated() if how.starts > 1 else attempts[0])) if attempts else None
    if not interrupted:
        try:
            if reached is not None:
                reached = _confirmed(reached, how, say)
            trouble = _trouble(simulator, points[0], reached)
            if trouble:
                for better in _fallbacks(simulator, recordings, points, reached, trouble, how, say):
                    reached = better
            if trouble and reached is not None and _trouble(simulator, points[0], reached) == Status.TOO_FAST.value:
                reached = _rejected(reached)
        except KeyboardInterrupt:
            interrupted = True
    if reached is None:
        raise BadInput(
            f"Model {model.name} gives no finite predictions of {recordings[0].name} at its nominal parameters. "
            "Check the recording's units, or start from other values (‹vehicle›, ‹start›)."
        )
    problem, solution, certificate = reached.problem, reached.solution, reached.certificate
    if interrupted:
        solution = replace(solution, status=Status.INTERRUPTED)
    if solution.nodes is None:
        solution = replace(solution, nodes=problem.simulated_nodes(solution.x))
    spread = residual_noise(problem, solution)
    stage = Stage(
        model=model.name, closed_loop=True, status=solution.status.value,
        converged=solution.status is Status.CONVERGED, steps=solution.steps, history=solution.history,
        starts=tuple(scores[k] for k in order) or (solution.objective,), strengths={}, strengths_from="given", tried=(),
        noise={n: float(s) for n, s, read in zip(model.outputs, spread, _seen(problem), strict=True) if read},
        cpu_seconds=time.process_time() - clock + done.cpu_seconds, cross_validation_seconds=0.0,
        certificate=certificate,
        ended_at=tuple(free_numbers(model, attempts[k]) for k in order) if len(order) > 1 else (),
        fallbacks=reached.fallbacks,
    )  # fmt: skip
    return problem, solution, stage


@dataclass(frozen=True)
class _Reached:
    """The best solution so far, Ipopt's report on it, and the other ways that were tried."""

    problem: MotionProblem
    about: Array
    solution: Solution
    certificate: Certificate | None = None
    fallbacks: tuple[str, ...] = ()


def _rejected(reached: _Reached) -> _Reached:
    """The same, not as an optimum: if the motion is too fast to simulate, the curvature is that of the integrator."""
    certificate = None if reached.certificate is None else replace(reached.certificate, confirmed=False)
    return replace(reached, solution=replace(reached.solution, status=Status.TOO_FAST), certificate=certificate)


def _of(attempt: Attempt) -> tuple[MotionProblem, Array, Solution]:
    return attempt.problem, attempt.about, attempt.solution


def _confirmed(reached: _Reached, how: FitOptions, say: Say) -> _Reached:
    """The same with Ipopt's report, if it is requested."""
    if how.solver != "auto":
        return reached
    solution, certificate = _certified(reached.problem, reached.solution, say)
    return replace(reached, solution=solution, certificate=certificate)


def _trouble(simulator: Simulator, start: Array, reached: _Reached | None) -> str:
    """Reason not to accept an optimum, as the beginning of a sentence; "" if there is none."""
    if reached is None:
        return "no finite prediction at the starting point"
    solution, problem = reached.solution, reached.problem
    p = problem.shared(solution.x)
    free = problem.free[problem.parameters.index[0]]
    low, high = (bound[problem.parameters.index[0]] for bound in problem.bounds)
    if not np.all(np.isfinite(p[free])) or not np.isfinite(solution.objective):
        return "the solution is not finite"
    if _fast(simulator, problem, p) and not _fast(simulator, problem, start):
        return Status.TOO_FAST.value
    confirmed = _is_confirmed(reached)
    if not confirmed and solution.steps == 0:
        return "no step was taken"
    if not confirmed and solution.status is Status.STEP_LIMIT:
        return ""  # it made progress, slowly; another start would be no faster
    if not confirmed:
        return "the optimum is not confirmed"
    if np.any(free) and np.mean((p <= low)[free] | (p >= high)[free]) > CORNER:
        return "most parameters ended at bounds"
    errors = problem.errors(problem.simulated_nodes(solution.x) if solution.nodes is None else solution.nodes)
    explained = [
        np.mean(errors[read, k] ** 2) < np.var(problem.target[read, k])
        for k in range(errors.shape[1])
        if np.any(read := np.isfinite(errors[:, k]) & (problem.weight[:, k] > 0))
    ]
    return "" if any(explained) or not explained else "the predictions are no better than the mean of the readings"


def _fast(simulator: Simulator, problem: MotionProblem, p: Array) -> bool:
    """Whether a motion needs more steps per row than the limit: its parameters are then invisible in the readings.

    An inertia near zero is an example. Poorly excited recordings lead there: what decays from a noisy reading within a
    few rows is noise, and predictions a few rows ahead mistake it for the vehicle.
    """
    shortest = min(run.sample_time for run in problem.runs)
    return longest_segment(simulator.trace, problem.runs, p) * SEGMENTS < shortest


def _fallbacks(
    simulator: Simulator,
    recordings: Sequence[Recording],
    points: Sequence[Array],
    reached: _Reached | None,
    why: str,
    how: FitOptions,
    say: Say,
) -> Iterator[_Reached]:
    """Try other ways until one leads to an acceptable optimum; yields the best solution so far after each."""
    model = simulator.trace.model
    near = replace(how, horizon=SHORTER, start_from="measured")
    more = starting_points(model, replace(how, starts=len(points) + MORE_STARTS))[len(points) :]

    def ahead_first() -> Attempt | None:
        short = attempted(simulator, recordings, points[0], near, quiet, model.name)
        if short is None or short.solution.status is Status.INTERRUPTED:
            return short
        p = short.problem.shared(short.solution.x)
        del short  # it holds layouts of all rows
        return attempted(simulator, recordings, p, how, quiet, model.name)

    ways: list[tuple[str, Callable[[], Attempt | None]]] = []
    if why == Status.TOO_FAST.value:
        straight = partial(attempted, simulator, recordings, points[0], how, quiet, model.name, ())
        ways.append(("the original starting point, without first fitting short predictions", straight))
    if how.horizon is None or how.horizon > SHORTER:
        ways.append((f"a start at the optimum of a fit with a horizon of {SHORTER:g} s", ahead_first))
    for k, p in enumerate(more, 1):
        another = partial(attempted, simulator, recordings, p, how, quiet, model.name)
        ways.append((f"other starting point {k}", another))
    if how.solver == "auto" and (reached is None or reached.solution.steps == 0):
        of_ipopt = replace(how, solver="ipopt")
        ways.append(
            (
                "Ipopt from the original starting point",
                partial(attempted, simulator, recordings, points[0], of_ipopt, quiet, ""),
            )
        )
    tried: tuple[str, ...] = ()
    reached = None if reached is None else _released(reached)
    for words, way in ways:
        say(f"{model.name}: {why}; trying {words}")
        result = way()
        if result is None:
            tried = (*tried, f"{words}: no finite prediction")
            if reached is not None:
                yield replace(reached, fallbacks=tried)
            continue
        candidate = _Reached(*_of(result))
        if result.solution.status is Status.INTERRUPTED:
            yield replace(reached or candidate, fallbacks=tried)
            raise KeyboardInterrupt
        candidate = _confirmed(candidate, how, say)
        gained = np.inf
        if reached is not None:
            noise = reached.problem.noise
            before, after = (
                misfit(Attempt(one.problem, one.about, one.solution), simulator, recordings, noise, how)
                for one in (reached, candidate)
            )
            gained = (before - after) / max(abs(before), 1e-300) if np.isfinite(before) else np.inf
        remaining = _trouble(simulator, points[0], candidate)
        least = CLEARLY if _is_confirmed(reached) and not _is_confirmed(candidate) else LOWER
        if reached is None or gained > least or (gained > -LOWER and not remaining):
            reached = candidate if not remaining else _released(candidate)
            why = remaining
            tried = (
                *tried,
                f"{words}: "
                + (
                    f"objective {_percent(gained)} lower than the best before"
                    if np.isfinite(gained)
                    else "its predictions are finite"
                ),
            )
        else:
            tried = (*tried, f"{words}: no better")
        del result, candidate  # free their memory before the next way
        yield replace(reached, fallbacks=tried)
        if not why:
            return


def _released(reached: _Reached) -> _Reached:
    """The same, for hours of data without layouts and simulation, which are made again when needed."""
    if not _of_hours(reached.problem):
        return reached
    reached.problem.forget()
    return replace(reached, solution=replace(reached.solution, nodes=None))


def _of_hours(problem: MotionProblem) -> bool:
    """Whether layouts of all rows are large."""
    return bool(problem.targets.reading.size > HOURS)


def _is_confirmed(reached: _Reached | None) -> bool:
    if reached is None:
        return False
    if reached.certificate is None:
        return reached.solution.status is Status.CONVERGED
    return reached.certificate.confirmed


def _percent(share: float) -> str:
    return f"{number(100 * max(share, 0.0), 2)} %"


def _certified(problem: MotionProblem, result: Solution, say: Say) -> tuple[Solution, Certificate]:
    """Check by Ipopt; if it moves the solution, Gauss-Newton takes unknowns close to bounds to them, and so on."""
    solution, certificate = _checked_by_ipopt(problem, result, say)
    for rounds_left in reversed(range(CARRIED_ON)):
        if certificate.confirmed:
            break
        max_steps = MOST_STEPS if rounds_left and certificate.gained > LOWER else SHORT_STEPS
        refined = gauss_newton(
            problem, solution.x, max_steps=max_steps, tolerance=TOLERANCE, negligible=0.0, search="levenberg_marquardt"
        )
        if refined.status is Status.INTERRUPTED:
            raise KeyboardInterrupt
        if refined.objective > solution.objective:
            break
        lower = result.objective - refined.objective > LOWER * max(abs(result.objective), 1e-300)
        solution = replace(solution, x=refined.x, nodes=refined.nodes, objective=refined.objective)
        if not (rounds_left and lower and refined.status is Status.CONVERGED):
            break
        before = certificate.objective_before
        result = replace(solution, status=Status.CONVERGED)
        solution, certificate = _checked_by_ipopt(problem, result, say)
        certificate = replace(certificate, objective_before=before)
    return solution, certificate


def _checked_by_ipopt(problem: MotionProblem, result: Solution, say: Say) -> tuple[Solution, Certificate]:
    """Ipopt's solution and report. Raises `KeyboardInterrupt` if it was stopped."""
    solution, certificate = certified(problem, result, say)
    if solution.status is Status.INTERRUPTED:
        raise KeyboardInterrupt
    return solution, certificate


def _seen(problem: MotionProblem) -> Array:
    return np.asarray(np.any(problem.weight > 0, axis=0))


def _uncertain(
    fitted: MotionModel,
    problem: MotionProblem,
    recordings: Sequence[Recording],
    solution: Solution,
    form: FormError,
    say: Say,
) -> dict[str, Any]:
    """Standard deviations, degrees of freedom and covariance of a fit, as its fields.

    They include the model-form error, and the many optima of sizes of rounding effects.
    """
    noise_alone = uncertainty(problem, solution.x, solution.nodes)
    first = problem.parameters.index[0]
    averaging = np.zeros((fitted.size, problem.layout.size))  # of the runs' parameters
    for index in problem.parameters.index:
        averaging[np.arange(fitted.size), index] += 1.0 / len(problem.parameters.index)
    size = problem.layout.size
    beyond_noise = form.covariance[:size, :size] + error_of_sizes(problem, recordings, solution.x, noise_alone, say)
    covariance = (
        averaging
        @ (np.where(np.isfinite(noise_alone.covariance), noise_alone.covariance, 0.0) + beyond_noise)
        @ averaging.T
    )
    shared = np.array([p.scope == "model" for p in fitted.parameters for _ in range(p.size)])
    of_shared = np.sqrt(noise_alone.sd[first] ** 2 + np.diag(beyond_noise)[first])
    factor = conflict(fitted)
    sd = factor * np.where(shared, of_shared, np.sqrt(np.maximum(np.diag(covariance), 0.0)))
    return {
        "sd": _named(fitted, sd),
        "dof": _named(fitted, noise_alone.dof[first]),
        "covariance": factor**2 * covariance,
    }


def _named(model: Model, vector: Array) -> dict[str, Array]:
    return {name: rows[0] for name, rows in _named_rows(model, vector[None]).items()}


def _named_rows(model: Model, rows: Array) -> dict[str, Array]:
    return {item.name: rows[:, place].reshape(len(rows), *item.shape) for item, place in placed(model.parameters)}


carried.register(MotionModel)(carries_over)
refuted.register(MotionModel)(withstands)


@refused.register(MotionModel)
def _refused(model: MotionModel, option: str) -> str:
    if option in FOR_MOTION:
        return ""
    return (
        f"{option} is for models with memory, whose weights have priors to be strengthened; {model.name} is made of "
        "equations of motion. Omit it."
    )


@stated_again.register(MotionModel)
def motion_problem(model: MotionModel, fit: Fit, recordings: Sequence[Recording]) -> tuple[MotionProblem, Array]:
    """See `holding.stated_again`."""
    how = fit.how
    noise = how.get("counted", fit.stages[-1].noise)
    simulator = Simulator(model)
    simulator.kernel.prepare()
    problem = MotionProblem(
        simulator,
        recordings,
        noise=np.array([noise.get(name, 1.0) for name in model.outputs]),
        horizon=how.get("horizon"),
        starts=how.get("start_from", "free"),
        robust=how.get("robust"),
    )
    x = problem.unknowns(model.values)
    for parameter, place in placed(model.parameters):
        if parameter.name in fit.per_run:
            for index, value in zip(problem.parameters.index, fit.per_run[parameter.name], strict=True):
                x[index[place]] = np.ravel(value)
    return problem, x
