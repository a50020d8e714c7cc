"""Fitting a motion model: short predictions from the readings first, then the horizon that was asked for.

From readings, a few samples ahead, almost any parameters give errors that point the right way; over a whole run a poor
start is far from anything. So the horizon grows: 4 rows, 100 rows, then the one wanted. What is found is certified by
Ipopt on the multiple-shooting program.
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from .blocks import correlation_time
from .certificate import certified
from .engine.motion.shooting import MotionProblem
from .engine.motion.simulator import Simulator
from .errors import BadInput
from .how import How, Say
from .motion_model import MotionModel
from .parameter import Array
from .provenance import Stage
from .recording import Recording
from .solvers.gauss_newton import Solution, Status, gauss_newton
from .solvers.ipopt import ipopt

SHORT_HORIZONS = (4, 100)
"""Rows predicted from one start before the horizon that is wanted."""
GUESSED_NOISE = 0.1
"""Noise assumed first, as a share of a signal's spread."""
TOLERANCE, ROUGH = 1e-12, 1e-4
"""Convergence of the last solve, and of those that only settle the noise."""
MOST_STEPS, SHORT_STEPS = 100, 5
SAME_NOISE, NOISE_ROUNDS = 0.1, 3
"""The noise has settled when the residuals' spread moves it by less than this share; rounds at most."""
SPREAD = 0.7
"""Standard deviation of the logarithm of positive parameters over random starts."""
LEAST_NOISE = 1e-9


@dataclass(frozen=True)
class _Attempt:
    """Where one start led."""

    problem: MotionProblem
    solution: Solution


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
    attempts, ends = [], []
    for k, p in enumerate(_starting_points(model, how)):
        name = model.name if how.starts == 1 else f"{model.name}, start {k + 1} of {how.starts}"
        found = _attempt(simulator, recordings, p, how, say, name)
        if found is not None:
            attempts.append(found)
            ends.append(found)
            if found.solution.status is Status.INTERRUPTED:
                break
    if not attempts:
        raise BadInput(
            f"Model {model.name} gives no finite predictions of {recordings[0].name} at its nominal parameters. "
            "Check the recording's units, or start from other values (--vehicle, --start)."
        )
    noise = attempts[0].problem.noise  # objectives compare only under one noise
    scores = [_misfit(attempt, simulator, recordings, noise, how) for attempt in attempts]
    best = attempts[int(np.argmin(scores))]
    problem, solution = best.problem, best.solution
    certificate = None
    if how.solver == "auto" and solution.status is not Status.INTERRUPTED:
        solution, certificate = certified(problem, solution, say)
    spread = _residual_noise(problem, solution)
    stage = Stage(
        model=model.name, closed_loop=True, status=solution.status.value,
        converged=solution.status is Status.CONVERGED, steps=solution.steps, history=solution.history,
        starts=tuple(sorted(scores)), strengths={}, strengths_from="given", tried=(),
        noise={n: float(s) for n, s, seen in zip(model.outputs, spread, _seen(problem), strict=True) if seen},
        cpu_seconds=time.process_time() - clock, cross_validation_seconds=0.0, certificate=certificate,
    )  # fmt: skip
    return problem, solution, stage


def _attempt(
    simulator: Simulator, recordings: Sequence[Recording], p: Array, how: How, say: Say, name: str
) -> _Attempt | None:
    """From one start through growing horizons; None where the model is not finite."""
    spread = np.array([_spread(recordings, output) for output in simulator.trace.model.outputs])
    noise = np.maximum(GUESSED_NOISE * spread, LEAST_NOISE)
    if how.solver == "ipopt":
        problem = _problem(simulator, recordings, noise, how)
        solution, _ = ipopt(problem, problem.unknowns(p))
        noise = _residual_noise(problem, solution)
        problem = _problem(simulator, recordings, noise, how)
        say(f"{name}: Ipopt, {problem.layout.size} unknowns")
        return _Attempt(problem, ipopt(problem, solution.x)[0])
    usual = _sample_time(recordings)
    for rows in SHORT_HORIZONS:
        if how.horizon is not None and rows * usual >= how.horizon:
            break
        short = MotionProblem(simulator, recordings, noise=noise, horizon=rows * usual, starts="measured")
        solution = gauss_newton(short, short.unknowns(p), max_steps=SHORT_STEPS, tolerance=1e-3, search="damp")
        if solution.status is Status.NOT_FINITE:
            return None
        if solution.status is Status.INTERRUPTED:
            return _Attempt(short, solution)
        say(f"{name}: {rows} rows ahead, {solution.steps} steps", passing=True)
        p, noise = short.shared(solution.x), _residual_noise(short, solution)
    problem = _problem(simulator, recordings, noise, how)
    x = problem.unknowns(p)

    def report(step: int, objective: float, _: Array) -> bool:
        say(f"{name}: step {step}, objective {objective:.6g}", passing=True)
        return True

    for _ in range(0 if how.noise.keys() >= {*simulator.trace.model.outputs} else NOISE_ROUNDS):
        solution = gauss_newton(
            problem, x, max_steps=MOST_STEPS, tolerance=ROUGH, negligible=0.0, search="damp", on_step=report
        )
        if solution.status is Status.NOT_FINITE:
            return None
        if solution.status is Status.INTERRUPTED:
            return _Attempt(problem, solution)
        x, settled = solution.x, _counted_noise(problem, solution)
        moved = float(np.max(np.abs(np.log(settled / problem.noise)), initial=0.0))
        problem = _problem(simulator, recordings, settled, how)
        if moved < SAME_NOISE:
            break
    solution = gauss_newton(
        problem, x, max_steps=MOST_STEPS, tolerance=TOLERANCE, negligible=0.0, search="damp", on_step=report
    )
    if solution.status is Status.NOT_FINITE:
        return None
    say(f"{name}: {solution.status.value} after {solution.steps} steps")
    return _Attempt(problem, solution)


def _problem(simulator: Simulator, recordings: Sequence[Recording], noise: Array, how: How) -> MotionProblem:
    outputs = simulator.trace.model.outputs
    noise = np.array([how.noise.get(name, own) for name, own in zip(outputs, noise, strict=True)])
    return MotionProblem(
        simulator, recordings, noise=noise, horizon=how.horizon, starts=how.start_from, robust=how.robust
    )


def _residual_noise(problem: MotionProblem, solution: Solution) -> Array:
    """Spread of the residuals, output by output; where there are none, the noise stays what it was."""
    errors = problem.errors(solution.nodes)
    seen = np.any(np.isfinite(errors), axis=0)
    spread = np.sqrt(np.nanmean(np.where(seen, errors, 0.0) ** 2, axis=0))
    return np.where(seen, np.maximum(spread, LEAST_NOISE), problem.noise)


def _counted_noise(problem: MotionProblem, solution: Solution) -> Array:
    """What one residual counts as, output by output: its spread times the root of its correlation time in rows.

    Neighbouring residuals repeat each other. Taken as independent, a long recording sampled fast would outvote every
    prior, and the output whose error drifts most slowly would outvote the others.
    """
    errors = problem.errors(solution.nodes)
    times = [correlation_time(np.nan_to_num(errors[:, [k]])) for k in range(errors.shape[1])]
    return _residual_noise(problem, solution) * np.sqrt(times)


def _misfit(attempt: _Attempt, simulator: Simulator, recordings: Sequence[Recording], noise: Array, how: How) -> float:
    problem = _problem(simulator, recordings, noise, how)
    x = (
        attempt.solution.x
        if len(attempt.solution.x) == problem.layout.size
        else problem.unknowns(attempt.problem.shared(attempt.solution.x))
    )
    return problem.objective(x, problem.simulated_nodes(x))


def _starting_points(model: MotionModel, how: How) -> list[Array]:
    """Nominal values, and others drawn about them: positive parameters keep their sign."""
    random = np.random.default_rng(how.seed)
    low = np.concatenate([np.full(p.size, p.bounds[0]) for p in model.parameters])
    high = np.concatenate([np.full(p.size, p.bounds[1]) for p in model.parameters])
    free = np.concatenate([np.full(p.size, not p.fixed) for p in model.parameters])
    points = [model.values]
    for _ in range(how.starts - 1):
        draw = random.standard_normal(model.size)
        factor = np.exp(SPREAD * draw)
        with np.errstate(invalid="ignore"):
            moved = np.where(low >= 0, model.values * factor, model.values + SPREAD * np.abs(model.values) * draw)
        moved = np.where(np.isfinite(moved), moved, model.values)
        points.append(np.where(free, np.clip(moved, low, high), model.values))
    return points


def _spread(recordings: Sequence[Recording], output: str) -> float:
    values = [recording[output] for recording in recordings if output in recording]
    if not values or not np.any(np.isfinite(np.concatenate(values))):
        return 1.0
    return max(float(np.nanstd(np.concatenate(values))), LEAST_NOISE)


def _sample_time(recordings: Sequence[Recording]) -> float:
    return float(np.median([recording.sample_time for recording in recordings]))


def _seen(problem: MotionProblem) -> Array:
    return np.asarray(np.any(problem.weight > 0, axis=0))
