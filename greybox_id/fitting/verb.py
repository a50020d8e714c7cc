"""The verb `fit`: from recordings and a model to a `Fit`.

A model with parts is fitted in two steps, as the papers on model-structured networks do: each part alone, on
measured inputs (step 1), then everything together with its own predictions fed back (step 2).
"""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from threadpoolctl import threadpool_limits

from ..checks.finding import Finding
from ..engine.hybrid.stretches import stretches
from ..engine.motion.runs import motion_runs, recorded_as
from ..engine.motion.shooting import MotionProblem
from ..engine.series import runs
from ..engine.shooting import Problem
from ..engine.trace import Trace
from ..errors import BadInput
from ..fit import Fit
from ..hybrid_model import HybridModel
from ..memory_model import MemoryModel
from ..model import Model
from ..motion_model import MotionModel
from ..parameter import unpack
from ..provenance import DataRecord, Stage, data_record
from ..recording import Recording, join
from ..scores.metrics import Scores, as_dict, score, score_beside_hold, unfitted_scores
from ..scores.timing import calibrated_errors, calibrated_seconds, calibrated_timing, calibration_words
from ..scores.verdict import distrust, judged, used_signals
from ..shorthands import Array
from ..solvers.gauss_newton import Solution, Status
from ..uncertainty import uncertainty
from ..verdict import USABLE, Verdict
from .aligning import alignment
from .carrying import carried
from .crossvalidation import choose_structure
from .how import How, Say, Solver, quiet
from .hybrid import TrainedBefore, fit_hybrid, update_hybrid
from .memory import fit_alone, fit_together
from .motion import fit_motion
from .networks import fit_network
from .pretraining import Pretraining

__all__ = ["How", "Say", "Solver", "fit"]

NO_OPTIMUM = {
    own.value for own in (Status.INTERRUPTED, Status.STOPPED, Status.STALLED, Status.TOO_FAST, Status.NOT_FINITE)
}
"""How a training of weights may end that leaves no optimum to be uncertain about. One that crept or stopped early is as
near as its error allows."""


def fit(
    model: Model | Sequence[Model],
    recordings: Sequence[Recording],
    *,
    validate: Recording | None = None,
    how: How | None = None,
    say: Say | None = None,
    command: str = "",
    pretraining: Pretraining | TrainedBefore | None = None,
) -> Fit:
    """Fit a model to recordings.

    Parameters
    ----------
    model : nominal values are the starting point. Of several structures the one is fitted that blocked
        cross-validation on the training data prefers.
    recordings : training data, in SI units.
    validate : only scored, except under early stopping, where it chooses when to stop.
    how : strengths, solver, starts, seed.
    say : called with one line of progress at a time.
    command : what reproduces the fit, for the record.
    pretraining : a known vehicle that a feed-forward network learns from first; or a trained hybrid model with a
        memory, whose training is carried on in place of the model's.

    Returns
    -------
    Fit. Ctrl-C keeps the best point so far and says so in the stage's status.

    Raises
    ------
    BadInput : the recordings lack a signal, differ in sample time, are too short, or their time does not run.
    """
    say = say or quiet
    for recording in [*recordings, *([] if validate is None else [validate])]:
        recording.must_run()
    with threadpool_limits(1):  # the matrices are small: a second thread only waits for the first, at full power
        models = [model] if isinstance(model, Model) else list(model)
        if isinstance(models[0], MotionModel):
            return _fit_motion(models[0], recordings, validate, how or How(), say, command)
        if isinstance(models[0], HybridModel):
            return _fit_hybrid(models[0], recordings, validate, how or How(), say, command, pretraining)
        structures = [one for one in models if isinstance(one, MemoryModel)]
        if validate is not None:
            runs(Trace(structures[0]), validate)  # what is wrong with it is better said before the work than after
        clock = time.process_time()
        jobs = how.jobs if how is not None else 1
        chosen, elsewhere = choose_structure(structures, recordings, say, jobs) if len(structures) > 1 else (0, 0.0)
        choosing = time.process_time() - clock + elsewhere
        found = _fit_memory(structures[chosen], recordings, validate, how or How(), say, command)
        first, *others = found.stages
        first = replace(first, cross_validation_seconds=first.cross_validation_seconds + choosing)
        return replace(found, stages=(first, *others))


def _fit_memory(
    model: MemoryModel, recordings: Sequence[Recording], validate: Recording | None, how: How, say: Say, command: str
) -> Fit:
    if how.strengths == "early stopping" and validate is None:
        raise BadInput("Early stopping needs a validation recording; name one with ‹validation›.")
    values = dict(zip((p.name for p in model.parameters), (p.array for p in model.parameters), strict=True))
    stages: list[Stage] = []
    sd: dict[str, Array] = {}
    interrupted = False
    seconds = calibrated_seconds(how.calibrate)
    timing = None if seconds is None else alignment(model, recordings, say)
    for part in model.parts or (model,):
        seen = recordings if timing is None else timing.of(part)
        try:
            problem, solution, stage = fit_alone(_with(part, values), seen, validate, how, say, alone=not model.parts)
        except KeyboardInterrupt:
            if not stages:
                raise  # there is nothing yet to keep
            interrupted = True
            break
        values |= _by_name(problem, solution)
        if any(p.name in model.step_2_holds for p in part.parameters):
            sd |= _standard_deviations(problem, solution)
        stages.append(stage)
        interrupted = solution.status is Status.INTERRUPTED
        if interrupted:
            break
    if model.parts:
        noise = {name: sd for stage in stages for name, sd in stage.noise.items()}
        strengths = {name: factor for stage in stages for name, factor in stage.strengths.items()}
        whole = _with(model, values)
        held = (replace(whole[name], fixed=True) for name in model.step_2_holds)
        whole = whole.with_parameters(*held)
        spread = np.array([noise.get(name, 1.0) for name in model.outputs])
        seen = recordings if timing is None else timing.together(whole)
        problem = Problem(Trace(whole), seen, closed_loop=True, noise=spread, strengths=strengths)
        solution, stage = fit_together(problem, strengths, validate, how, say, interrupted)
        stages.append(stage)
        values |= _by_name(problem, solution)
    fitted = _with(model, values)
    if stages[-1].status in NO_OPTIMUM:
        spread_of = {p.name: np.full(p.shape, 0.0 if p.fixed else np.nan) for p in fitted.parameters}
    else:
        say(f"{model.name}: uncertainty of {fitted.size} parameters")
        spread_of = _standard_deviations(problem, solution)
        spread_of |= {name: sd[name] for name in model.step_2_holds if name in sd}
    own = _metrics(fitted, recordings, validate)
    result = Fit(
        model=fitted,
        sd=spread_of,
        per_run=_per_run(problem, solution),
        stages=tuple(stages),
        metrics={role: as_dict(scores) for role, scores in own.items()},
        data=_records(recordings, validate),
        mode=how.mode,
        seed=how.seed,
        how={} if timing is None else {"timing": {"train": timing.as_list()}},
        command=command,
    )
    result = replace(result, verdict=judged(result, own, findings=_findings(result, recordings, validate)))
    return result if seconds is None or validate is None else _calibrated(result, validate, seconds)


def _calibrated(fit: Fit, validate: Recording, seconds: float) -> Fit:
    """The fit with what it does on the validation recording where each run told its delay first."""
    assert isinstance(fit.model, MemoryModel)
    told = calibrated_timing(fit, validate, seconds)
    own = as_dict({calibration_words(seconds): calibrated_errors(fit.model, validate, told)})
    metrics = {**fit.metrics, "validate": {**fit.metrics["validate"], **own}}
    return replace(fit, metrics=metrics, how={**fit.how, "timing": {**fit.how["timing"], "validate": told.as_dict()}})


def _fit_motion(
    model: MotionModel, recordings: Sequence[Recording], validate: Recording | None, how: How, say: Say, command: str
) -> Fit:
    if validate is not None:
        motion_runs(model, validate)  # what is wrong with it is better said before the work than after
    drives = recorded_as(model, recordings if validate is None else [*recordings, validate])
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
        data=_records(recordings, validate),
        mode="given",
        seed=how.seed,
        how={
            "solver": how.solver,
            "horizon": how.horizon,
            "start_from": how.start_from,
            "robust": how.robust,
            "inputs": drives,
            "counted": dict(zip(model.outputs, problem.noise.tolist(), strict=True)),
            "unfitted": {p.name: float(p.array) for p in model.parameters if p.shape == () and not p.fixed},
        },
        command=command,
    )
    if stage.confirmed and np.isfinite(solution.objective):  # away from an optimum, its curvature says nothing
        say(f"{model.name}: uncertainty of {int(np.sum(problem.free[: problem.layout.size]))} unknowns")
        result = replace(result, **_uncertain(fitted, problem, solution))
    own, verdict = judged_motion(result, recordings, validate)
    return replace(result, metrics=own, verdict=verdict)


def _uncertain(fitted: MotionModel, problem: MotionProblem, solution: Solution) -> dict[str, Any]:
    """Standard deviations, degrees of freedom and covariance of a fit, as its fields."""
    told = uncertainty(problem, solution.x, solution.nodes)
    first = problem.parameters.index[0]
    mean = np.zeros((fitted.size, problem.layout.size))  # of the runs' parameters
    for index in problem.parameters.index:
        mean[np.arange(fitted.size), index] += 1.0 / len(problem.parameters.index)
    covariance = mean @ np.where(np.isfinite(told.covariance), told.covariance, 0.0) @ mean.T
    shared = np.array([p.scope == "model" for p in fitted.parameters for _ in range(p.size)])
    sd = np.where(shared, told.sd[first], np.sqrt(np.maximum(np.diag(covariance), 0.0)))
    return {"sd": _named(fitted, sd), "dof": _named(fitted, told.dof[first]), "covariance": covariance}


def _fit_hybrid(
    model: HybridModel,
    recordings: Sequence[Recording],
    validate: Recording | None,
    how: How,
    say: Say,
    command: str,
    pretraining: Pretraining | TrainedBefore | None = None,
) -> Fit:
    if how.solver == "ipopt":
        raise BadInput(f"{model.name} is trained by its gradient, stopped by held-out manoeuvres; omit ‹solver›.")
    if validate is not None:
        stretches(model, validate)  # what is wrong with it is better said before the work than after
    if isinstance(pretraining, TrainedBefore):
        trained = update_hybrid(pretraining.model, recordings, how, say)
    elif model.recurrent:
        trained = fit_hybrid(model, recordings, how, say)
    else:
        trained = fit_network(model, recordings, how, say, pretraining)
    own = _metrics(trained.model, recordings, validate)
    result = Fit(
        model=trained.model,
        sd={
            p.name: np.full(p.shape, np.nan) for p in trained.model.parameters
        },  # trainings from several seeds tell a spread
        stages=(trained.stage,),
        metrics={role: as_dict(scores) for role, scores in own.items()},
        data=_records(recordings, validate),
        mode="early stopping",
        seed=how.seed,
        how={
            "stopped_by": list(trained.held_out),
            "errors_over_windows": list(trained.errors),
            **({} if pretraining is None else {"pretrained_from": pretraining.source or pretraining.model.name}),
            **({"pretrained_beyond": pretraining.beyond} if isinstance(pretraining, Pretraining) else {}),
        },
        command=command,
    )
    return replace(result, verdict=judged(result, own, findings=_findings(result, recordings, validate)))


def _named(model: Model, vector: Array) -> dict[str, Array]:
    return {name: rows[0] for name, rows in _named_rows(model, vector[None]).items()}


def _named_rows(model: Model, rows: Array) -> dict[str, Array]:
    found, start = {}, 0
    for parameter in model.parameters:
        found[parameter.name] = rows[:, start : start + parameter.size].reshape(len(rows), *parameter.shape)
        start += parameter.size
    return found


def judged_motion(
    fit: Fit, recordings: Sequence[Recording], validate: Recording | None
) -> tuple[dict[str, Any], Verdict]:
    """Errors of a fit of a motion model by role, and the verdict on it."""
    assert isinstance(fit.model, MotionModel)
    whole = {"train": join(recordings, "training data"), **({} if validate is None else {"validate": validate})}
    both = {role: score_beside_hold(fit.model, one) for role, one in whole.items()}
    own, held = ({role: scores[k] for role, scores in both.items()} for k in (0, 1))
    last = list(whole)[-1]
    before = {last: unfitted_scores(fit, whole[last])}
    findings = _findings(fit, recordings, validate)
    verdict = judged(fit, own, held=held, unfitted=before, findings=findings)
    if validate is not None and verdict.usability == USABLE:
        more = carried(fit, validate)
        verdict = judged(fit, own, held=held, unfitted=before, findings=findings, more=more) if more else verdict
    return {role: as_dict(scores) for role, scores in own.items()}, verdict


def _findings(fit: Fit, recordings: Sequence[Recording], validate: Recording | None) -> dict[str, list[Finding]]:
    """What the checks hold against the data of a fit, by role."""
    used = used_signals(fit.model)
    found = {"train": [own for recording in recordings for own in distrust(used, recording)]}
    return found if validate is None else found | {"validate": distrust(used, validate)}


def _metrics(model: Model, recordings: Sequence[Recording], validate: Recording | None) -> dict[str, Scores]:
    return {
        "train": score(model, join(recordings, "training data")),
        **({"validate": score(model, validate)} if validate is not None else {}),
    }


def _records(recordings: Sequence[Recording], validate: Recording | None) -> tuple[DataRecord, ...]:
    return (
        *(data_record(recording, "train") for recording in recordings),
        *((data_record(validate, "validate"),) if validate is not None else ()),
    )


def _standard_deviations(problem: Problem, solution: Solution) -> dict[str, Array]:
    variances = uncertainty(problem, solution.x, solution.nodes).sd ** 2
    found, start = {}, 0
    for parameter in problem.trace.model.parameters:
        own = np.mean([variances[index[start : start + parameter.size]] for index in problem.layout.index], axis=0)
        found[parameter.name] = np.sqrt(np.maximum(own, 0.0)).reshape(parameter.shape)
        start += parameter.size
    return found


def _per_run(problem: Problem, solution: Solution) -> dict[str, Array]:
    found, start = {}, 0
    for parameter in problem.trace.model.parameters:
        if parameter.scope == "run":
            runs = problem.layout.index[: problem.copies]  # a mirror image shares its run's
            rows = [solution.x[index[start : start + parameter.size]] for index in runs]
            found[parameter.name] = np.array(rows).reshape(len(rows), *parameter.shape)
        start += parameter.size
    return found


def _by_name(problem: Problem, solution: Solution) -> dict[str, Array]:
    parameters = unpack(problem.trace.model.parameters, problem.shared(solution.x))
    return {parameter.name: parameter.array for parameter in parameters}


def _with(model: MemoryModel, values: Mapping[str, Array]) -> MemoryModel:
    return model.with_parameters(*(p.with_value(values[p.name]) for p in model.parameters))
