"""Fit models with memory: choose a structure by cross-validation, fit its parts one by one, then all together.

Training runs can be aligned by their delays first: a network trained on runs whose time stamps differ by some 30 ms
learns a mixture of them. A brief fit estimates each run's delay and its inputs are shifted, `ROUNDS` times; the final
fit sees runs of one timing.
"""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from ..base.errors import BadInput
from ..base.shorthands import Array
from ..datasets.recording import Recording
from ..engine.series import runs
from ..engine.shooting import Problem
from ..engine.solvers.gauss_newton import Solution, Status, gauss_newton
from ..engine.trace import Trace
from ..models.memory_model import MemoryModel
from ..models.model import must_be
from ..models.parameter import placed, unpack
from .crossvalidation import choose_structure
from .fit import Fit
from .holding import stated_again
from .how import FOR_MOTION, Say, refused
from .provenance import Stage
from .scores.timing import RunDelay, Timing, aligned, aligned_together, calibrated_seconds, run_delays
from .steps import MOST_STEPS, fit_alone, fit_briefly, fit_together
from .uncertainty import uncertainty
from .verb import FitTask, estimated

ROUNDS = 2
"""How often runs are aligned. On the RoboRacer's training runs, with one run held out in turn, one round lowers the
error of the held-out run by 4 %, two by 5 %."""
BRIEFLY = 1e-4
"""Tolerance of a brief fit, relative to the objective: below it, delays change by tenths of a millisecond."""


@dataclass(frozen=True)
class Alignment:
    """Training recordings, aligned separately for each part of a model.

    Attributes
    ----------
    recordings : as recorded, not aligned.
    delays : for each recording, outputs of a part -> delays of its runs.
    """

    recordings: Sequence[Recording]
    delays: Sequence[Mapping[tuple[str, ...], Sequence[RunDelay]]]

    def of(self, part: MemoryModel) -> list[Recording]:
        """The recordings with the inputs of one part shifted."""
        key = tuple(part.outputs)
        return [
            aligned(one, part.inputs, {delay.run: delay.delay for delay in delays[key]})
            for one, delays in zip(self.recordings, self.delays, strict=True)
        ]

    def together(self, model: MemoryModel) -> list[Recording]:
        """The recordings with the inputs of all parts shifted, for closed loop."""
        return [
            aligned_together(model, one, Timing(None, delays))
            for one, delays in zip(self.recordings, self.delays, strict=True)
        ]

    def as_list(self) -> list[dict[str, object]]:
        """`Timing.as_dict` of each recording, as plain data."""
        return [Timing(None, delays).as_dict() for delays in self.delays]


def alignment(model: MemoryModel, recordings: Sequence[Recording], say: Say) -> Alignment:
    """Delays of training runs, estimated by brief fits of each part to all of them."""
    result: list[dict[tuple[str, ...], Sequence[RunDelay]]] = [{} for _ in recordings]
    for part in model.parts or (model,):
        moved = list(recordings)
        for _ in range(ROUNDS):
            fitted, noise = _briefly(part, moved)
            delays_of_each = [run_delays(fitted, one, noise) for one in recordings]
            moved = [
                aligned(one, part.inputs, {delay.run: delay.delay for delay in delays})
                for one, delays in zip(recordings, delays_of_each, strict=True)
            ]
        for by_outputs, delays in zip(result, delays_of_each, strict=True):
            by_outputs[tuple(part.outputs)] = delays
        words = ", ".join(f"{1e3 * delay.delay:+.0f}" for delays in delays_of_each for delay in delays)
        say(f"{part.name}: runs of the training data aligned, delays {words} ms")
    return Alignment(recordings, result)


def _briefly(part: MemoryModel, recordings: Sequence[Recording]) -> tuple[MemoryModel, dict[str, float]]:
    """A part fitted with its priors as stated, and the standard deviation of its residuals by output."""
    trace = Trace(part)
    noise, near, laid = fit_briefly(trace, recordings)
    strengths = {p.prior.strength: 1.0 for p in part.parameters if p.prior is not None and p.prior.strength}
    problem = laid.counted(noise=noise, strengths=strengths)
    solution = gauss_newton(problem, near, max_steps=MOST_STEPS, tolerance=BRIEFLY)
    if solution.status is Status.INTERRUPTED:
        raise KeyboardInterrupt
    return part.with_values(problem.shared(solution.x)), dict(zip(part.outputs, noise.tolist(), strict=True))


NO_OPTIMUM = {
    item.value for item in (Status.INTERRUPTED, Status.STOPPED, Status.STALLED, Status.TOO_FAST, Status.NOT_FINITE)
}
"""Final statuses of a training without an optimum at which an uncertainty could be computed. Slow or early-stopped
trainings are absent: they end near enough."""


@estimated.register(MemoryModel)
def _estimated(model: MemoryModel, task: FitTask) -> Fit:
    structures = [must_be(MemoryModel, one) for one in task.structures]
    if task.validate is not None:
        runs(Trace(model), task.validate)  # raises on bad data before the work, not after it
    if len(structures) < 2:
        return _in_steps(model, task)
    clock = time.process_time()
    chosen, elsewhere = choose_structure(structures, task.recordings, task.say, task.how.jobs)
    choosing = time.process_time() - clock + elsewhere
    fit = _in_steps(structures[chosen], task)
    first, *others = fit.stages
    first = replace(first, cross_validation_seconds=first.cross_validation_seconds + choosing)
    return replace(fit, stages=(first, *others))


def _in_steps(model: MemoryModel, task: FitTask) -> Fit:
    recordings, validate, how, say = task.recordings, task.validate, task.how, task.say
    if how.strengths == "early stopping" and validate is None:
        raise BadInput("Early stopping needs a validation recording; name one with ‹validation›.")
    values = dict(zip((p.name for p in model.parameters), (p.array for p in model.parameters), strict=True))
    stages: list[Stage] = []
    sd: dict[str, Array] = {}
    interrupted = False
    seconds = calibrated_seconds(how.calibrate)
    timing = None if seconds is None else alignment(model, recordings, say)
    for part in model.parts or (model,):
        training = recordings if timing is None else timing.of(part)
        try:
            problem, solution, stage = fit_alone(
                _with(part, values), training, validate, how, say, alone=not model.parts
            )
            values |= _by_name(problem, solution)
            stages.append(stage)
            interrupted = solution.status is Status.INTERRUPTED
            if any(p.name in model.step_2_holds for p in part.parameters):
                sd |= _standard_deviations(problem, solution)
        except KeyboardInterrupt:
            if not stages:
                raise  # nothing to keep yet
            interrupted = True
        if interrupted:
            break
    if model.parts:
        noise = {name: sd for stage in stages for name, sd in stage.noise.items()}
        strengths = {name: factor for stage in stages for name, factor in stage.strengths.items()}
        whole = _with(model, values).with_constants(model.step_2_holds)  # their columns of zeros would take time
        noise_sd = np.array([noise.get(name, 1.0) for name in model.outputs])
        training = recordings if timing is None else timing.together(whole)

        def together(interrupted: bool) -> tuple[Problem, Solution, Stage]:
            problem = Problem(Trace(whole), training, closed_loop=True, noise=noise_sd, strengths=strengths)
            return problem, *fit_together(problem, strengths, validate, how, say, interrupted)

        try:
            problem, solution, stage = together(interrupted)
        except KeyboardInterrupt:  # while the problem was set up
            problem, solution, stage = together(True)
        stages.append(stage)
        values |= _by_name(problem, solution)
    fitted = _with(model, values)
    standard_deviations = {p.name: np.full(p.shape, 0.0 if p.fixed else np.nan) for p in fitted.parameters}
    if stages[-1].status not in NO_OPTIMUM:
        say(f"{model.name}: computing the uncertainty of {fitted.size} parameters")
        try:
            last = _standard_deviations(problem, solution)
            standard_deviations = {name: sd.get(name, np.zeros(fitted[name].shape)) for name in model.step_2_holds}
            standard_deviations |= last
        except KeyboardInterrupt:
            stages[-1] = replace(stages[-1], status=Status.INTERRUPTED.value)
    return Fit(
        model=fitted,
        sd=standard_deviations,
        per_run=_per_run(problem, solution),
        stages=tuple(stages),
        metrics={},
        seed=task.how.seed,
        data=(),
        mode=how.mode,
        how={} if timing is None else {"timing": {"train": timing.as_list()}},
    )


def _standard_deviations(problem: Problem, solution: Solution) -> dict[str, Array]:
    variances = uncertainty(problem, solution.x, solution.nodes).sd ** 2
    result = {}
    for parameter, place in placed(problem.trace.model.parameters):
        variance = np.mean([variances[index[place]] for index in problem.layout.index], axis=0)
        result[parameter.name] = np.sqrt(np.maximum(variance, 0.0)).reshape(parameter.shape)
    return result


def _per_run(problem: Problem, solution: Solution) -> dict[str, Array]:
    result, runs = {}, problem.layout.index[: problem.copies]  # a mirror image shares its run's parameters
    for parameter, place in placed(problem.trace.model.parameters):
        if parameter.scope == "run":
            result[parameter.name] = np.array([solution.x[index[place]].reshape(parameter.shape) for index in runs])
    return result


def _by_name(problem: Problem, solution: Solution) -> dict[str, Array]:
    parameters = unpack(problem.trace.model.parameters, problem.shared(solution.x))
    return {parameter.name: parameter.array for parameter in parameters}


def _with(model: MemoryModel, values: Mapping[str, Array]) -> MemoryModel:
    return model.with_parameters(*(p.with_value(values[p.name]) for p in model.parameters))


@refused.register(MemoryModel)
def _refused(model: MemoryModel, option: str) -> str:
    if option not in FOR_MOTION:
        return ""
    return f"{option} is for equations of motion; {model.name} is a model with memory. Omit it."


@stated_again.register(MemoryModel)
def _stated_again(model: MemoryModel, fit: Fit, recordings: Sequence[Recording]) -> tuple[Problem, Array]:
    """The problem of the last step; what that step held fixed is fixed again."""
    last = fit.stages[-1]
    if "timing" in fit.how:
        raise BadInput(
            f"The fit of {model.name} shifted its runs by their delays; its least-squares problem cannot be set up "
            "again."
        )
    if model.parts:
        model = model.with_parameters(*(replace(model[name], fixed=True) for name in model.step_2_holds))
    noise = np.array([last.noise.get(name, 1.0) for name in model.outputs])
    problem = Problem(Trace(model), recordings, closed_loop=last.closed_loop, noise=noise, strengths=last.strengths)
    x = problem.unknowns(model.values)
    for parameter, place in placed(model.parameters):
        for index, value in zip(problem.layout.index, fit.per_run.get(parameter.name, ()), strict=False):
            x[index[place]] = np.ravel(value)
    return problem, x
