"""Fitting a motion model: short predictions from the readings first, then the horizon that was asked for.

From readings, a few samples ahead, almost any parameters give errors that point the right way; over a whole run a poor
start is far from anything. So the horizon grows: 4 rows, 100 rows, then the one wanted. What is found is certified by
Ipopt on the multiple-shooting program. Where that ends badly, other ways are tried before a user has to ask for them
(`_fallbacks`), and the record says so.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from ..engine.motion.schedule import MOST_STEPS as SEGMENTS
from ..engine.motion.schedule import longest_segment
from ..engine.motion.shooting import MotionProblem
from ..engine.motion.simulator import Simulator
from ..errors import BadInput
from ..motion_model import MotionModel
from ..parameter import Array
from ..processes import apart, side_by_side
from ..provenance import Certificate, Stage
from ..recording import Recording
from ..solvers.gauss_newton import Solution, Status, gauss_newton
from ..solvers.ipopt import ipopt
from ..statistics import MIDDLE_HALF, correlation_time
from .certificate import certified
from .how import How, Say, quiet
from .starts import starting_points

SHORT_HORIZONS = (4, 100)
"""Rows predicted from one start before the horizon that is wanted."""
GUESSED_NOISE = 0.1
"""Noise assumed first, as a share of a signal's spread."""
TOLERANCE, ROUGH = 1e-12, 1e-4
"""Convergence of the last solve, and of those that only settle the noise."""
MOST_STEPS, SHORT_STEPS = 100, 5
SAME_NOISE, SAME_PLACE, ROUNDS = 0.1, 1e-3, 6
"""The noise has settled when the residuals' spread moves it by less than this share, and what an observer carries when
parameters move by less than the second; rounds at most."""
LEAST_NOISE = 1e-9
CARRIED_ON, LOWER = 2, 1e-6
"""How often Gauss-Newton and Ipopt hand an optimum that is not confirmed to each other; share of the objective that
must be gained for another round, or for another way to be taken."""
SHORTER = 1.0
"""Horizon, s, that is fitted first where the one wanted ends badly."""
MORE_STARTS, CLEARLY = 2, 0.01
"""Other starts that are tried; share of the objective for which an optimum that is confirmed is left for one that is
not."""
CORNER = 0.5
"""An optimum with more than this share of its free numbers at bounds is a corner, not an optimum of the vehicle."""


@dataclass(frozen=True)
class _Attempt:
    """Where one start led; about : (parameters,) that the problem was stated near."""

    problem: MotionProblem
    about: Array
    solution: Solution


@dataclass(frozen=True)
class _Sent:
    """The same between processes: the solution without its simulation, and what the problem is stated again with."""

    noise: Array
    about: Array
    solution: Solution


def _sent(found: _Attempt) -> _Sent:
    return _Sent(found.problem.noise, found.about, replace(found.solution, nodes=None))


def _received(own: _Sent, simulator: Simulator, recordings: Sequence[Recording], how: How) -> _Attempt:
    problem = _problem(simulator, recordings, own.noise, how, own.about)
    nodes = problem.simulated_nodes(own.solution.x)
    return _Attempt(problem, own.about, replace(own.solution, nodes=nodes))


def fit_motion(
    model: MotionModel, recordings: Sequence[Recording], how: How, say: Say
) -> tuple[MotionProblem, Solution, Stage]:
    """Fit a motion model.

    Parameters
    ----------
    model : nominal values are the starting point.
    recordings : training data.
    how : horizon, starts, solver, robust loss, seed.
    say : progress.

    Returns
    -------
    The problem that was solved last, where it ended, and the record.

    Raises
    ------
    BadInput : a signal is missing, or the model is not finite where it starts.
    """
    clock = time.process_time()
    simulator = Simulator(model)
    simulator.kernel.prepare()
    points, away = starting_points(model, how), apart(how.starts, how.jobs)

    def name(k: int) -> str:
        return model.name if how.starts == 1 else f"{model.name}, start {k + 1} of {how.starts}"

    def work(k: int) -> _Attempt | _Sent | None:
        found = _attempt(simulator, recordings, points[k], how, quiet if away else say, name(k))
        return _sent(found) if how.starts > 1 and found is not None else found  # alike with one process and several

    def told(k: int, found: _Attempt | _Sent | None) -> bool:
        if away and found is not None:
            say(f"{name(k)}: {found.solution.status.value} after {found.solution.steps} steps")
        return found is None or found.solution.status is not Status.INTERRUPTED

    done = side_by_side(work, len(points), how.jobs, told)
    received = (_received(one, simulator, recordings, how) if isinstance(one, _Sent) else one for one in done.results)
    attempts = [one for one in received if one is not None]
    interrupted = done.interrupted or any(one.solution.status is Status.INTERRUPTED for one in attempts)
    noise = attempts[0].problem.noise if attempts else None  # objectives compare only under one noise
    scores = [_misfit(attempt, simulator, recordings, noise, how) for attempt in attempts]
    order = np.argsort(scores, kind="stable").tolist()
    reached = _Reached(*_of(attempts[order[0]])) if attempts else None
    if not interrupted:
        try:
            if reached is not None:
                reached = _confirmed(reached, how, say)
            why = _trouble(simulator, points[0], reached)
            if why:
                for better in _fallbacks(simulator, recordings, points, reached, why, how, say):
                    reached = better
            if why and reached is not None and _trouble(simulator, points[0], reached) == Status.TOO_FAST.value:
                reached = _not_believed(reached)
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
    spread = _residual_noise(problem, solution)
    stage = Stage(
        model=model.name, closed_loop=True, status=solution.status.value,
        converged=solution.status is Status.CONVERGED, steps=solution.steps, history=solution.history,
        starts=tuple(scores[k] for k in order) or (solution.objective,), strengths={}, strengths_from="given", tried=(),
        noise={n: float(s) for n, s, seen in zip(model.outputs, spread, _seen(problem), strict=True) if seen},
        cpu_seconds=time.process_time() - clock + done.cpu_seconds, cross_validation_seconds=0.0,
        certificate=certificate,
        ended_at=tuple(_free_numbers(model, attempts[k]) for k in order) if len(order) > 1 else (),
        fallbacks=reached.fallbacks,
    )  # fmt: skip
    return problem, solution, stage


def refitted(simulator: Simulator, recordings: Sequence[Recording], p: Array, how: How) -> Array | None:
    """The parameters that one start leads to, no questions asked; None where the model is not finite there."""
    found = _attempt(simulator, recordings, p, how, quiet, simulator.trace.model.name)
    if found is not None and found.solution.status is Status.INTERRUPTED:
        raise KeyboardInterrupt
    return None if found is None else found.problem.shared(found.solution.x)


def _free_numbers(model: MotionModel, attempt: _Attempt) -> dict[str, float]:
    """Where an attempt ended, of single numbers that are free."""
    p = attempt.problem.shared(attempt.solution.x)
    places = np.concatenate([[0], np.cumsum([own.size for own in model.parameters])])
    free = {own.name: places[k] for k, own in enumerate(model.parameters) if own.shape == () and not own.fixed}
    return {name: float(p[place]) for name, place in free.items()}


@dataclass(frozen=True)
class _Reached:
    """The best so far, what Ipopt says of it, and which other ways were tried to get there."""

    problem: MotionProblem
    about: Array
    solution: Solution
    certificate: Certificate | None = None
    fallbacks: tuple[str, ...] = ()


def _not_believed(reached: _Reached) -> _Reached:
    """The same as no optimum: where the motion cannot be simulated any more, curvature is the integrator's."""
    certificate = None if reached.certificate is None else replace(reached.certificate, confirmed=False)
    return replace(reached, solution=replace(reached.solution, status=Status.TOO_FAST), certificate=certificate)


def _of(attempt: _Attempt) -> tuple[MotionProblem, Array, Solution]:
    return attempt.problem, attempt.about, attempt.solution


def _confirmed(reached: _Reached, how: How, say: Say) -> _Reached:
    """The same with Ipopt's word on it, where it is asked."""
    if how.solver != "auto":
        return reached
    solution, certificate = _certified(reached.problem, reached.solution, say)
    return replace(reached, solution=solution, certificate=certificate)


def _trouble(simulator: Simulator, start: Array, reached: _Reached | None) -> str:
    """Why an optimum is none to be left at, as the beginning of a sentence; "" where there is nothing against it."""
    if reached is None:
        return "no finite prediction at the start"
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
        return ""  # it was getting on, slowly; from elsewhere it would be no faster
    if not confirmed:
        return "the optimum is not confirmed"
    if np.any(free) and np.mean((p <= low)[free] | (p >= high)[free]) > CORNER:
        return "most parameters ended at bounds"
    errors = problem.errors(problem.simulated_nodes(solution.x) if solution.nodes is None else solution.nodes)
    explained = [
        np.mean(errors[there, k] ** 2) < np.var(problem.target[there, k])
        for k in range(errors.shape[1])
        if np.any(there := np.isfinite(errors[:, k]) & (problem.weight[:, k] > 0))
    ]
    return "" if any(explained) or not explained else "the predictions are no better than the mean of the readings"


def _fast(simulator: Simulator, problem: MotionProblem, p: Array) -> bool:
    """Whether a motion needs more steps per row than are ever taken: its parameters then show in no reading.

    An inertia that is next to none gives one. Poorly excited recordings lead there: what decays from a noisy reading
    within rows is noise, and predictions a few rows ahead take it for the vehicle.
    """
    shortest = min(run.sample_time for run in problem.runs)
    return longest_segment(simulator.trace, problem.runs, p) * SEGMENTS < shortest


def _fallbacks(
    simulator: Simulator,
    recordings: Sequence[Recording],
    points: Sequence[Array],
    reached: _Reached | None,
    why: str,
    how: How,
    say: Say,
) -> Iterator[_Reached]:
    """Other ways to the optimum, one after the other until one leads to an optimum: the best so far after each."""
    model = simulator.trace.model
    near = replace(how, horizon=SHORTER, start_from="measured")
    more = starting_points(model, replace(how, starts=len(points) + MORE_STARTS))[len(points) :]

    def ahead_first() -> _Attempt | None:
        short = _attempt(simulator, recordings, points[0], near, quiet, model.name)
        if short is None or short.solution.status is Status.INTERRUPTED:
            return short
        return _attempt(simulator, recordings, short.problem.shared(short.solution.x), how, quiet, model.name)

    ways: list[tuple[str, Callable[[], _Attempt | None]]] = []
    if why == Status.TOO_FAST.value:
        straight = partial(_attempt, simulator, recordings, points[0], how, quiet, model.name, ())
        ways.append(("the start, without predictions ahead", straight))
    if how.horizon is None or how.horizon > SHORTER:
        ways.append((f"predictions {SHORTER:g} s ahead first", ahead_first))
    for k, p in enumerate(more, 1):
        another = partial(_attempt, simulator, recordings, p, how, quiet, model.name)
        ways.append((f"start {k} of other starts", another))
    if how.solver == "auto" and (reached is None or reached.solution.steps == 0):
        of_ipopt = replace(how, solver="ipopt")
        ways.append(("Ipopt from the start", partial(_attempt, simulator, recordings, points[0], of_ipopt, quiet, "")))
    told: tuple[str, ...] = ()
    for words, way in ways:
        say(f"{model.name}: {why}; trying {words}")
        found = way()
        if found is None:
            told = (*told, f"{words}: no finite prediction")
            if reached is not None:
                yield replace(reached, fallbacks=told)
            continue
        own = _Reached(*_of(found))
        if found.solution.status is Status.INTERRUPTED:
            yield replace(reached or own, fallbacks=told)
            raise KeyboardInterrupt
        own = _confirmed(own, how, say)
        gained = np.inf
        if reached is not None:
            noise = reached.problem.noise
            before, after = (
                _misfit(_Attempt(one.problem, one.about, one.solution), simulator, recordings, noise, how)
                for one in (reached, own)
            )
            gained = (before - after) / max(abs(before), 1e-300) if np.isfinite(before) else np.inf
        own_trouble = _trouble(simulator, points[0], own)
        least = CLEARLY if _is_confirmed(reached) and not _is_confirmed(own) else LOWER
        if reached is None or gained > least or (gained > -LOWER and not own_trouble):
            reached = own
            why = own_trouble
            told = (*told, f"{words}: " + (f"objective {_percent(gained)} lower" if np.isfinite(gained) else "finite"))
        else:
            told = (*told, f"{words}: no better")
        yield replace(reached, fallbacks=told)
        if not why:
            return


def _is_confirmed(reached: _Reached | None) -> bool:
    if reached is None:
        return False
    if reached.certificate is None:
        return reached.solution.status is Status.CONVERGED
    return reached.certificate.confirmed


def _percent(share: float) -> str:
    return f"{100 * max(share, 0.0):.2g} %"


def _certified(problem: MotionProblem, found: Solution, say: Say) -> tuple[Solution, Certificate]:
    """Ask Ipopt; where it went on, Gauss-Newton takes what is close to a bound to it, and they ask each other again."""
    solution, certificate = _asked(problem, found, say)
    for rounds_left in reversed(range(CARRIED_ON)):
        if certificate.confirmed:
            break
        most = MOST_STEPS if rounds_left and certificate.gained > LOWER else SHORT_STEPS
        polished = gauss_newton(
            problem, solution.x, max_steps=most, tolerance=TOLERANCE, negligible=0.0, search="levenberg_marquardt"
        )
        if polished.status is Status.INTERRUPTED:
            raise KeyboardInterrupt
        if polished.objective > solution.objective:
            break
        lower = found.objective - polished.objective > LOWER * max(abs(found.objective), 1e-300)
        solution = replace(solution, x=polished.x, nodes=polished.nodes, objective=polished.objective)
        if not (rounds_left and lower and polished.status is Status.CONVERGED):
            break
        before = certificate.objective_before
        found = replace(solution, status=Status.CONVERGED)
        solution, certificate = _asked(problem, found, say)
        certificate = replace(certificate, objective_before=before)
    return solution, certificate


def _asked(problem: MotionProblem, found: Solution, say: Say) -> tuple[Solution, Certificate]:
    """Ipopt's word. Raises `KeyboardInterrupt` where it was stopped."""
    solution, certificate = certified(problem, found, say)
    if solution.status is Status.INTERRUPTED:
        raise KeyboardInterrupt
    return solution, certificate


def _attempt(
    simulator: Simulator,
    recordings: Sequence[Recording],
    p: Array,
    how: How,
    say: Say,
    name: str,
    short: Sequence[int] = SHORT_HORIZONS,
) -> _Attempt | None:
    """From one start to the end, or as far as it got when interrupted; None where the model is not finite."""
    reached: list[_Attempt] = []
    try:
        for attempt in _on_the_way(simulator, recordings, p, how, say, name, short):
            if attempt.solution.status is Status.NOT_FINITE:
                return None
            reached.append(attempt)
            if attempt.solution.status is Status.INTERRUPTED:
                break
        else:
            return reached[-1]
    except KeyboardInterrupt:
        if not reached:
            raise
    problem, p, solution = reached[-1].problem, reached[-1].about, reached[-1].solution
    if problem.horizon != how.horizon:  # of what is wanted, not of what is on the way to it
        p = problem.shared(solution.x)
        problem = _problem(simulator, recordings, problem.noise, how, p)
        x = problem.unknowns(p)
        nodes = problem.simulated_nodes(x)
        solution = replace(solution, x=x, nodes=nodes, objective=problem.objective(x, nodes))
    return _Attempt(problem, p, replace(solution, status=Status.INTERRUPTED))


def _on_the_way(
    simulator: Simulator, recordings: Sequence[Recording], p: Array, how: How, say: Say, name: str, short: Sequence[int]
) -> Iterator[_Attempt]:
    """Growing horizons, then the one that is wanted until the noise has settled."""
    outputs = simulator.trace.model.outputs
    spread = np.array([_spread(recordings, output) for output in outputs])
    noise = np.maximum(GUESSED_NOISE * spread, LEAST_NOISE)
    usual = _sample_time(recordings)
    for rows in short if how.solver != "ipopt" else ():
        if how.horizon is not None and rows * usual >= how.horizon:
            break
        ahead = MotionProblem(simulator, recordings, noise=noise, horizon=rows * usual, starts="measured", about=p)
        solution = gauss_newton(
            ahead, ahead.unknowns(p), max_steps=SHORT_STEPS, tolerance=1e-3, search="levenberg_marquardt"
        )
        yield _Attempt(ahead, p, solution)
        say(f"{name}: {rows} rows ahead, {solution.steps} steps", passing=True)
        p, noise = ahead.shared(solution.x), _residual_noise(ahead, solution)
    problem = _problem(simulator, recordings, noise, how, p)
    x, known = problem.unknowns(p), how.noise.keys() >= {*outputs}
    settled, taken = known and not problem.carries, 0
    for rounds_left in reversed(range(ROUNDS)):
        solution = _solved(problem, x, how, TOLERANCE if settled else ROUGH, say, name)
        taken += solution.steps  # where rounds before ended at the optimum, the last one has none left to take
        solution = replace(solution, steps=taken)
        yield _Attempt(problem, p, solution)
        x, noise = solution.x, _counted_noise(problem, solution)
        moved = 0.0 if known else float(np.max(np.abs(np.log(noise / problem.noise)), initial=0.0))
        if problem.carries:
            moved = max(moved, SAME_NOISE / SAME_PLACE * _relative_change(p, problem.shared(x)))
        if settled and (moved < SAME_NOISE or rounds_left == 0):
            break
        settled, p = moved < SAME_NOISE or rounds_left == 1, problem.shared(x)
        problem = _problem(simulator, recordings, noise, how, p)
    say(f"{name}: {solution.status.value} after {solution.steps} steps")


def _solved(problem: MotionProblem, x: Array, how: How, tolerance: float, say: Say, name: str) -> Solution:
    if how.solver == "ipopt":
        say(f"{name}: Ipopt, {problem.layout.size} unknowns")
        return ipopt(problem, x)[0]

    def report(step: int, objective: float, _: Array) -> bool:
        say(f"{name}: step {step}, objective {objective:.6g}", passing=True)
        return True

    return gauss_newton(
        problem,
        x,
        max_steps=MOST_STEPS,
        tolerance=tolerance,
        negligible=0.0,
        search="levenberg_marquardt",
        on_step=report,
    )


def _relative_change(before: Array, after: Array) -> float:
    """Largest change of a parameter relative to its size."""
    with np.errstate(invalid="ignore"):
        change = np.abs(after - before) / np.maximum(np.maximum(np.abs(before), np.abs(after)), 1e-9)
    return float(np.nanmax(change, initial=0.0))


def _problem(
    simulator: Simulator, recordings: Sequence[Recording], noise: Array, how: How, about: Array
) -> MotionProblem:
    outputs = simulator.trace.model.outputs
    noise = np.array([how.noise.get(name, own) for name, own in zip(outputs, noise, strict=True)])
    return MotionProblem(
        simulator, recordings, noise=noise, horizon=how.horizon, starts=how.start_from, robust=how.robust, about=about
    )


def _residual_noise(problem: MotionProblem, solution: Solution) -> Array:
    """Spread of the residuals, output by output; where there are none, the noise stays what it was.

    Where outliers are to be expected, the middle half of the residuals tells it.
    """
    errors = problem.errors(solution.nodes)
    seen = np.any(np.isfinite(errors), axis=0)
    errors = np.where(seen, errors, 0.0)
    if problem.targets.robust is None:
        spread = np.sqrt(np.nanmean(errors**2, axis=0))
    else:
        spread = MIDDLE_HALF * np.nanmedian(np.abs(errors), axis=0)
    return np.where(seen, np.maximum(spread, LEAST_NOISE), problem.noise)


def _counted_noise(problem: MotionProblem, solution: Solution) -> Array:
    """What one residual counts as, output by output: its spread times the root of its correlation time in rows.

    Neighbouring residuals repeat each other. Taken as independent, a long recording sampled fast would outvote every
    prior, and the output whose error drifts most slowly would outvote the others.
    """
    errors = problem.errors(solution.nodes)
    times = [correlation_time(np.nan_to_num(errors[:, [k]])) for k in range(errors.shape[1])]
    return _residual_noise(problem, solution) * np.sqrt(times)


def _misfit(
    attempt: _Attempt, simulator: Simulator, recordings: Sequence[Recording], noise: Array | None, how: How
) -> float:
    noise = attempt.problem.noise if noise is None else noise
    p = attempt.problem.shared(attempt.solution.x)
    problem = _problem(simulator, recordings, noise, how, p)
    x = attempt.solution.x if len(attempt.solution.x) == problem.layout.size else problem.unknowns(p)
    return problem.objective(x, problem.simulated_nodes(x))


def _spread(recordings: Sequence[Recording], output: str) -> float:
    values = [recording[output] for recording in recordings if output in recording]
    if not values or not np.any(np.isfinite(np.concatenate(values))):
        return 1.0
    return max(float(np.nanstd(np.concatenate(values))), LEAST_NOISE)


def _sample_time(recordings: Sequence[Recording]) -> float:
    return float(np.median([recording.sample_time for recording in recordings]))


def _seen(problem: MotionProblem) -> Array:
    return np.asarray(np.any(problem.weight > 0, axis=0))
