"""Predictions of models with memory, and their errors in the protocols of papers.

honest : windows never cross a join; all samples pooled; open loop (fed-back inputs measured).
published : as in the papers on model-structured networks: windows cross joins, the mean over batches of
    100 windows of each batch's RMSE, an incomplete last batch dropped; open loop with measured a_x and a_y. A
    recording of fewer than 100 windows is pooled. The papers have two fractions of variance unexplained: that of
    their library's validator (`Error.fvu_published`) and the pooled one of their adaptations (`Error.fvu_pooled`).
closed_loop : no window across a join, pooled; the model is fed its own predictions from the first window of
    each run to its end.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any, Literal

import numpy as np

from ...base.errors import BadInput
from ...base.shorthands import Array
from ...datasets.recording import Recording
from ...engine.elements import Sensing
from ...engine.series import Run, runs
from ...engine.simulation import Prediction
from ...engine.trace import Trace
from ...models.memory_model import MemoryModel
from .metrics import Error, Scores, error_of, predict, predicted_how, score, simulate, standard_error

Protocol = Literal["honest", "published", "closed_loop"]
PROTOCOLS: tuple[Protocol, ...] = ("honest", "published", "closed_loop")
BATCH = 100


def predictions(
    model: MemoryModel, recording: Recording, protocol: Protocol = "honest", trace: Trace | None = None
) -> Prediction:
    """Predict a recording one sample ahead (open loop) or freely (closed loop); `trace`: the model's, if available."""
    trace = Trace(model) if trace is None else trace
    result = runs(trace, recording, across_joins=protocol == "published")
    sensing = Sensing(trace.model)
    p = model.values
    predicted = [sensing(_predicted(run, p, protocol), None, p)[0] for run in result]
    return Prediction(
        rows=np.concatenate([np.arange(run.rows.start + run.first, run.rows.stop) for run in result]),
        predicted=np.vstack(predicted),
        measured=np.vstack([run.measured[run.predicted] for run in result]),
        run=np.concatenate([np.full(len(run) - run.first, k) for k, run in enumerate(result)]),
    )


def _predicted(run: Run, p: Array, protocol: Protocol) -> Array:
    if protocol == "closed_loop":
        return run.simulate(p)[run.predicted]
    if not run.complete:
        return run.predict(p, run.measured)
    return run.predict(p)


@simulate.register(MemoryModel)
def _simulated(model: MemoryModel, recording: Recording, start: Mapping[str, float] | None = None) -> Prediction:
    if start:
        raise BadInput(f"{model.name} has no states: it starts from a window of the recording. Give it no start.")
    if model.feedback is None:
        raise BadInput(
            f"{model.name} predicts one sample ahead from measured inputs and cannot run freely; use greybox predict."
        )
    return predictions(model, recording, "closed_loop")


@predict.register(MemoryModel)
def _predicted_rows(
    model: MemoryModel, recording: Recording, horizon: float | None = None, *, open_loop: bool = False
) -> Prediction:
    if horizon is not None:
        raise BadInput(
            f"{model.name} is a model with memory: it predicts freely or, with ‹open_loop›, one sample ahead; omit "
            "‹horizon›."
        )
    return predictions(model, recording, "closed_loop" if model.feedback is not None and not open_loop else "honest")


@predicted_how.register(MemoryModel)
def _predicted_how(model: MemoryModel, horizon: float | None, open_loop: bool) -> tuple[str, dict[str, Any]]:
    loop = "open" if open_loop or model.feedback is None else "closed"
    return f"{loop} loop", {"loop": loop}


def protocols(model: MemoryModel) -> tuple[Protocol, ...]:
    """The protocols that a model has: without feedback there is no closed loop."""
    return PROTOCOLS if model.feedback is not None else PROTOCOLS[:2]


@score.register(MemoryModel)
def _score(model: MemoryModel, recording: Recording) -> Scores:
    trace = Trace(model)
    return {
        protocol: errors(model, predictions(model, recording, protocol, trace), protocol)
        for protocol in protocols(model)
    }


def errors(model: MemoryModel, prediction: Prediction, protocol: Protocol) -> dict[str, Error]:
    """Errors of every output of one set of predictions."""
    return {
        name: _error(prediction.predicted[:, k], prediction.measured[:, k], model.sample_time, protocol)
        for k, name in enumerate(model.outputs)
    }


def _error(predicted: Array, measured: Array, sample_time: float, protocol: Protocol) -> Error:
    error = error_of(predicted, measured, sample_time)
    if protocol != "published":
        return error
    with np.errstate(over="ignore", invalid="ignore"):
        square = (predicted - measured) ** 2
        if len(square) >= BATCH:
            batches = square[: _full_batches(len(square))].reshape(-1, BATCH).mean(axis=1)
            error = replace(error, rmse=float(np.mean(np.sqrt(batches))), rmse_sd=standard_error(np.sqrt(batches)))
        validator, pooled = _as_published(predicted, measured)
    return replace(error, fvu_published=validator, fvu_pooled=pooled)


def _as_published(predicted: Array, measured: Array) -> tuple[float, float]:
    """Both fractions of variance unexplained of the papers: the validator's and the pooled one."""
    error = predicted - measured
    full = slice(0, _full_batches(len(error)))
    variances = [float(np.var(item[full])) for item in (error, measured, predicted)]
    about_mean = float(np.sum((measured - np.mean(measured)) ** 2))
    validator = 0.5 * (variances[0] / variances[1] + variances[0] / variances[2]) if min(variances[1:]) > 0 else np.nan
    return validator, float(np.sum(error**2)) / about_mean if about_mean > 0 else np.nan


def _full_batches(samples: int) -> int:
    """Samples in full batches; all, if there is no full batch."""
    return samples // BATCH * BATCH or samples


def aic(residual: Array, parameters: int, effective: float | None = None) -> float:
    """Akaike's criterion as published: n ln 2 pi + n ln var(e) + sum e^2/var(e) + 2 k.

    Parameters
    ----------
    residual : (samples,) errors of one output; an incomplete batch is dropped, as published.
    parameters : k.
    effective : effective number of independent samples; None counts each, as published.
    """
    used = residual[: _full_batches(len(residual))] if effective is None else residual
    n = float(len(used)) if effective is None else effective
    variance = float(np.var(used))
    return float(n * np.log(2 * np.pi * variance) + n * np.mean(used**2) / variance + 2 * parameters)
