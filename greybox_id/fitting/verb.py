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

from ..engine.hybrid.stretches import stretches
from ..engine.motion.runs import motion_runs, recorded_as
from ..engine.series import runs
from ..engine.shooting import Problem
from ..engine.trace import Trace
from ..errors import BadInput
from ..fit import Fit
from ..hybrid_model import HybridModel
from ..memory_model import MemoryModel
from ..model import Model
from ..motion_model import MotionModel
from ..parameter import Array, unpack
from ..provenance import DataRecord, Stage, data_record
from ..recording import Recording, join
from ..scores.metrics import as_dict, score
from ..solvers.gauss_newton import Solution, Status
from ..uncertainty import uncertainty
from .crossvalidation import choose_structure
from .how import How, Say, Solver, quiet
from .hybrid import fit_hybrid
from .memory import fit_alone, fit_together
from .motion import fit_motion

__all__ = ["How", "Say", "Solver", "fit"]


def fit(
    model: Model | Sequence[Model],
    recordings: Sequence[Recording],
    *,
    validate: Recording | None = None,
    how: How | None = None,
    say: Say | None = None,
    command: str = "",
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

    Returns
    -------
    Fit. Ctrl-C keeps the best point so far and says so in the stage's status.

    Raises
    ------
    BadInput : the recordings lack a signal, differ in sample time or are too short.
    """
    say = say or quiet
    with threadpool_limits(1):  # the matrices are small: a second thread only waits for the first, at full power
        models = [model] if isinstance(model, Model) else list(model)
        if isinstance(models[0], MotionModel):
            return _fit_motion(models[0], recordings, validate, how or How(), say, command)
        if isinstance(models[0], HybridModel):
            return _fit_hybrid(models[0], recordings, validate, how or How(), say, command)
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
        raise BadInput("Early stopping needs a validation recording; name one with --validate.")
    values = dict(zip((p.name for p in model.parameters), (p.array for p in model.parameters), strict=True))
    stages: list[Stage] = []
    sd: dict[str, Array] = {}
    interrupted = False
    for part in model.parts or (model,):
        try:
            problem, solution, stage = fit_alone(
                _with(part, values), recordings, validate, how, say, alone=not model.parts
            )
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
        problem = Problem(Trace(whole), recordings, closed_loop=True, noise=spread, strengths=strengths)
        solution, stage = fit_together(problem, strengths, validate, how, say, interrupted)
        stages.append(stage)
        values |= _by_name(problem, solution)
    fitted = _with(model, values)
    say(f"{model.name}: uncertainty of {fitted.size} parameters")
    return Fit(
        model=fitted,
        sd=_standard_deviations(problem, solution) | {name: sd[name] for name in model.step_2_holds if name in sd},
        per_run=_per_run(problem, solution),
        stages=tuple(stages),
        metrics=_metrics(fitted, recordings, validate),
        data=_records(recordings, validate),
        mode=how.mode,
        seed=how.seed,
        command=command,
    )


def _fit_motion(
    model: MotionModel, recordings: Sequence[Recording], validate: Recording | None, how: How, say: Say, command: str
) -> Fit:
    if validate is not None:
        motion_runs(model, validate)  # what is wrong with it is better said before the work than after
    drives = recorded_as(model, recordings if validate is None else [*recordings, validate])
    problem, solution, stage = fit_motion(model, recordings, how, say)
    fitted = model.with_values(problem.shared(solution.x))
    say(f"{model.name}: uncertainty of {int(np.sum(problem.free[: problem.layout.size]))} unknowns")
    told = uncertainty(problem, solution.x, solution.nodes)
    first = problem.parameters.index[0]
    mean = np.zeros((fitted.size, problem.layout.size))  # of the runs' parameters
    for index in problem.parameters.index:
        mean[np.arange(fitted.size), index] += 1.0 / len(problem.parameters.index)
    covariance = mean @ np.where(np.isfinite(told.covariance), told.covariance, 0.0) @ mean.T
    shared = np.array([p.scope == "model" for p in fitted.parameters for _ in range(p.size)])
    sd = np.where(shared, told.sd[first], np.sqrt(np.maximum(np.diag(covariance), 0.0)))
    dof = told.dof[first]
    per_run = problem.per_run(solution.x)
    return Fit(
        model=fitted,
        sd=_named(fitted, sd),
        dof=_named(fitted, dof),
        covariance=covariance,
        per_run={name: values for name, values in _named_rows(fitted, per_run).items() if fitted[name].scope == "run"},
        stages=(stage,),
        metrics=_metrics(fitted, recordings, validate),
        data=_records(recordings, validate),
        mode="given",
        seed=how.seed,
        how={
            "horizon": how.horizon,
            "start_from": how.start_from,
            "robust": how.robust,
            "inputs": drives,
            "counted": dict(zip(model.outputs, problem.noise.tolist(), strict=True)),
        },
        command=command,
    )


def _fit_hybrid(
    model: HybridModel, recordings: Sequence[Recording], validate: Recording | None, how: How, say: Say, command: str
) -> Fit:
    if how.solver == "ipopt":
        raise BadInput(f"{model.name} is trained by its gradient, stopped by held-out manoeuvres; leave --solver away.")
    if validate is not None:
        stretches(model, validate)  # what is wrong with it is better said before the work than after
    trained = fit_hybrid(model, recordings, how, say)
    return Fit(
        model=trained.model,
        sd={p.name: np.full(p.shape, np.nan) for p in model.parameters},  # trainings from several seeds tell a spread
        stages=(trained.stage,),
        metrics=_metrics(trained.model, recordings, validate),
        data=_records(recordings, validate),
        mode="early stopping",
        seed=how.seed,
        how={"stopped_by": list(trained.held_out), "errors_over_windows": list(trained.errors)},
        command=command,
    )


def _named(model: Model, vector: Array) -> dict[str, Array]:
    return {name: rows[0] for name, rows in _named_rows(model, vector[None]).items()}


def _named_rows(model: Model, rows: Array) -> dict[str, Array]:
    found, start = {}, 0
    for parameter in model.parameters:
        found[parameter.name] = rows[:, start : start + parameter.size].reshape(len(rows), *parameter.shape)
        start += parameter.size
    return found


def _metrics(model: Model, recordings: Sequence[Recording], validate: Recording | None) -> dict[str, Any]:
    return {
        "train": as_dict(score(model, join(recordings, "training data"))),
        **({"validate": as_dict(score(model, validate))} if validate is not None else {}),
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
