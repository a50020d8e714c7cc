"""How far a model is from a recording: errors in the signals' own units, in stated protocols.

honest : windows never cross a join; all samples pooled; open loop (fed-back inputs measured).
published : as in the papers on model-structured networks: windows laid across joins, the mean over batches of
    100 windows of each batch's RMSE, an incomplete last batch dropped; open loop with measured a_x and a_y. A
    recording of fewer than 100 windows is pooled.
closed_loop : no window across a join, pooled; the model runs on its own predictions from the first window of
    each run to its end.

Motion models are scored over horizons instead: so many seconds ahead from the readings of every row, and in free
run from the first row of each run to its end. Hybrid models are scored in free run.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from ..engine.hybrid.free_run import free_run
from ..engine.motion.prediction import Predictions, Predictor
from ..engine.motion.simulator import Simulator
from ..engine.sensing import Sensing
from ..engine.series import Run, runs
from ..engine.trace import Trace
from ..hybrid_model import HybridModel
from ..memory_model import MemoryModel
from ..model import Model
from ..motion_model import MotionModel
from ..parameter import Array
from ..recording import Recording

Protocol = Literal["honest", "published", "closed_loop"]
PROTOCOLS: tuple[Protocol, ...] = ("honest", "published", "closed_loop")
BATCH = 100


@dataclass(frozen=True)
class Error:
    """Error of one output under one protocol.

    Attributes
    ----------
    rmse : root mean square error, in the output's unit.
    rmse_sd : its standard error, from the scatter over blocks of one second (residuals are correlated within),
        or over the batches of the published protocol.
    fvu : fraction of variance unexplained, var(error)/var(measured), over all samples.
    samples : predictions scored.
    """

    rmse: float
    rmse_sd: float
    fvu: float
    samples: int


@dataclass(frozen=True)
class Prediction:
    """Predictions of one recording.

    Attributes
    ----------
    rows : (samples,) rows of the recording they belong to.
    predicted, measured : (samples, outputs).
    run : (samples,) number, from 0, of the unbroken stretch that was predicted; missing values break one too.
    """

    rows: Array
    predicted: Array
    measured: Array
    run: Array


def predictions(model: MemoryModel, recording: Recording, protocol: Protocol = "honest") -> Prediction:
    """Predict a recording one sample ahead (open loop) or freely (closed loop)."""
    trace = Trace(model)
    found = runs(trace, recording, across_joins=protocol == "published")
    sensing = Sensing(trace)
    p = model.values
    predicted = [sensing(_predicted(run, p, protocol), None, p)[0] for run in found]
    return Prediction(
        rows=np.concatenate([np.arange(run.rows.start + run.first, run.rows.stop) for run in found]),
        predicted=np.vstack(predicted),
        measured=np.vstack([run.measured[run.predicted] for run in found]),
        run=np.concatenate([np.full(len(run) - run.first, k) for k, run in enumerate(found)]),
    )


def hybrid_predictions(model: HybridModel, recording: Recording) -> Prediction:
    """Free run of a hybrid model over every stretch with complete inputs."""
    found = free_run(model, recording)
    predicted = np.array([found[name] for name in model.outputs]).T
    read = [model.read(name, recording) for name in model.outputs]
    measured = np.array([np.full(len(recording), np.nan) if own is None else own for own in read]).T
    rows = np.flatnonzero(np.any(np.isfinite(predicted), axis=1))
    joins = np.searchsorted([start for start, _ in recording.runs], rows, side="right")
    apart = np.concatenate(([False], (np.diff(rows) > 1) | (np.diff(joins) > 0))) if len(rows) else np.empty(0, bool)
    return Prediction(
        rows=np.asarray(rows, dtype=np.intp), predicted=predicted[rows], measured=measured[rows], run=np.cumsum(apart)
    )


HORIZONS = (0.1, 0.5, 1.0, 2.0)
"""Seconds ahead at which motion models are scored."""
FREE_RUN = "free run"


def ahead(horizon: float) -> str:
    """Name of the protocol that predicts so many seconds ahead."""
    return f"{horizon:g} s ahead"


def score(model: Model, recording: Recording) -> dict[str, dict[str, Error]]:
    """Errors of every output under every protocol that the model has."""
    if isinstance(model, MotionModel):
        return score_motion(Simulator(model), recording, model.values)
    if isinstance(model, HybridModel):
        run = hybrid_predictions(model, recording)
        return {FREE_RUN: prediction_errors(model.outputs, run, recording.sample_time)}
    assert isinstance(model, MemoryModel)
    return {str(name): errors for name, errors in _score_memory(model, recording).items()}


def score_motion(
    simulator: Simulator, recording: Recording, p: Array, horizons: Sequence[float] = HORIZONS
) -> dict[str, dict[str, Error]]:
    """Errors of every recorded output over every horizon and in free run; horizons beyond all runs are left out."""
    predictor = Predictor(simulator, recording, p)
    found = {ahead(horizon): predictor.ahead(horizon) for horizon in horizons}
    found[FREE_RUN] = predictor.free_run()
    scores: dict[str, dict[str, Error]] = {}
    for name, prediction in found.items():
        own = prediction_errors(simulator.trace.model.outputs, prediction, recording.sample_time)
        if own:
            scores[name] = own
    return scores


def prediction_errors(
    outputs: Sequence[str], prediction: Prediction | Predictions, sample_time: float
) -> dict[str, Error]:
    """Errors of every output that was read."""
    found = {}
    for k, output in enumerate(outputs):
        read = np.isfinite(prediction.measured[:, k]) & ~np.isnan(prediction.predicted[:, k])
        if np.any(read):
            found[output] = _error(prediction.predicted[read, k], prediction.measured[read, k], sample_time, "honest")
    return found


def _score_memory(model: MemoryModel, recording: Recording) -> dict[Protocol, dict[str, Error]]:
    """Errors of every output under every protocol that the model has."""
    protocols = PROTOCOLS if model.feedback is not None else PROTOCOLS[:2]
    return {protocol: errors(model, predictions(model, recording, protocol), protocol) for protocol in protocols}


def errors(model: MemoryModel, prediction: Prediction, protocol: Protocol) -> dict[str, Error]:
    """Errors of every output of one set of predictions."""
    return {
        name: _error(prediction.predicted[:, k], prediction.measured[:, k], model.sample_time, protocol)
        for k, name in enumerate(model.outputs)
    }


def as_dict(scores: Mapping[str, Mapping[str, Error]]) -> dict[str, dict[str, dict[str, float]]]:
    """Scores as plain data for JSON."""
    return {
        protocol: {
            name: {"rmse": e.rmse, "rmse_sd": e.rmse_sd, "fvu": e.fvu, "samples": e.samples}
            for name, e in by_output.items()
        }
        for protocol, by_output in scores.items()
    }


def _predicted(run: Run, p: Array, protocol: Protocol) -> Array:
    if protocol == "closed_loop":
        return run.simulate(p)[run.predicted]
    if not run.complete:
        return run.predict(p, run.measured)
    return run.predict(p)


def _error(predicted: Array, measured: Array, sample_time: float, protocol: Protocol) -> Error:
    residual = predicted - measured
    square = residual**2
    if protocol == "published" and len(square) >= BATCH:
        batches = square[: len(square) // BATCH * BATCH].reshape(-1, BATCH).mean(axis=1)
        rmse, sd = float(np.mean(np.sqrt(batches))), _standard_error(np.sqrt(batches))
    else:
        rmse = float(np.sqrt(np.mean(square)))
        length = max(1, min(len(square), round(1.0 / sample_time)))
        blocks = square[: len(square) // length * length].reshape(-1, length).mean(axis=1)
        sd = _standard_error(blocks) / (2 * rmse) if rmse > 0 else 0.0
    variance = float(np.var(measured))
    return Error(rmse, sd, float(np.var(residual)) / variance if variance > 0 else float("nan"), len(residual))


def _standard_error(blocks: Array) -> float:
    """Standard error of the mean of blocks; NaN where one block cannot tell."""
    return float(np.std(blocks, ddof=1) / np.sqrt(len(blocks))) if len(blocks) > 1 else float("nan")
