"""How far a model is from a recording: errors in the signals' own units, in stated protocols.

honest : windows never cross a join; all samples pooled; open loop (fed-back inputs measured).
published : as in the papers on model-structured networks: windows laid across joins, the mean over batches of
    100 windows of each batch's RMSE, an incomplete last batch dropped; open loop with measured a_x and a_y. A
    recording of fewer than 100 windows is pooled. The papers' fractions of variance unexplained are two: that of
    their library's validator (`Error.fvu_published`) and the pooled one of their adaptations (`Error.fvu_pooled`).
closed_loop : no window across a join, pooled; the model runs on its own predictions from the first window of
    each run to its end.

Motion models are scored over horizons instead: so many seconds ahead from the readings of every row, and in free
run from the first row of each run to its end. Hybrid models are scored in free run.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any, Literal

import numpy as np

from ..engine.elements import Sensing
from ..engine.hybrid.cell import free_run
from ..engine.motion.prediction import Predictions, Predictor
from ..engine.motion.runs import MotionRun
from ..engine.motion.simulator import Simulator
from ..engine.series import Run, runs
from ..engine.trace import Trace
from ..fit import FREE_RUN as FREE_RUN
from ..fit import Fit
from ..hybrid_model import HybridModel
from ..memory_model import MemoryModel
from ..model import Model
from ..motion_model import MotionModel
from ..recording import Recording
from ..shorthands import Array, Mask

ASTRAY = 10.0
"""A prediction that is off by more than so many times the range of the readings has diverged."""

Protocol = Literal["honest", "published", "closed_loop"]
PROTOCOLS: tuple[Protocol, ...] = ("honest", "published", "closed_loop")
BATCH = 100


@dataclass(frozen=True)
class Divergence:
    """Where predictions go astray: further from the readings than `ASTRAY` times their range, or no numbers at all.

    Attributes
    ----------
    run : number of the first run in which they do, from 1.
    after : s from the start of that run (free run) or the horizon (so many seconds ahead).
    share : of the runs, or of the predictions so many seconds ahead.
    free : whether it is a free run that diverges.
    """

    run: int
    after: float
    share: float
    free: bool

    @property
    def words(self) -> str:
        """As the end of a sentence."""
        if self.free:
            return f"diverges after {self.after:.3g} s in run {self.run}"
        share = f"{100 * self.share:.2g} %" if self.share < 0.995 else "all"
        return f"diverges in {share} of the predictions {self.after:g} s ahead"


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
    spread : standard deviation of the readings, in the output's unit; NaN where it was not kept.
    diverges : where the model's prediction goes astray; None where it does not. No RMSE is told then: it is infinite.
    fvu_published : (var(error)/var(measured) + var(error)/var(predicted))/2 over full batches, as nnodely's validator
        has it; NaN outside the published protocol.
    fvu_pooled : sum of squared errors over that of the readings about their mean: a bias counts; NaN likewise.
    """

    rmse: float
    rmse_sd: float
    fvu: float
    samples: int
    spread: float = np.nan
    diverges: Divergence | None = None
    fvu_published: float = np.nan
    fvu_pooled: float = np.nan

    @property
    def fit_percent(self) -> float:
        """100 (1 - RMSE / standard deviation of the readings), as system identification has it; 100 is perfect."""
        return 100.0 * (1.0 - self.rmse / self.spread) if self.spread > 0 else np.nan


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


def predictions(
    model: MemoryModel, recording: Recording, protocol: Protocol = "honest", trace: Trace | None = None
) -> Prediction:
    """Predict a recording one sample ahead (open loop) or freely (closed loop); `trace` is the model's, if at hand."""
    trace = Trace(model) if trace is None else trace
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
        horizon = None if name == FREE_RUN else next(own for own in horizons if ahead(own) == name)
        own = prediction_errors(simulator.trace.model.outputs, prediction, recording.sample_time, horizon)
        if own:
            scores[name] = own
    return scores


def prediction_errors(
    outputs: Sequence[str], prediction: Prediction | Predictions, sample_time: float, horizon: float | None = None
) -> dict[str, Error]:
    """Errors of every output that was read; predictions of a free run where no horizon, s, is given."""
    found = {}
    for k, output in enumerate(outputs):
        read = np.isfinite(prediction.measured[:, k]) & ~np.isnan(prediction.predicted[:, k])
        if np.any(read):
            own = _error(prediction.predicted[read, k], prediction.measured[read, k], sample_time, "honest")
            astray = _divergence(prediction, k, read, sample_time, horizon)
            found[output] = own if astray is None else Error(np.inf, np.nan, np.inf, own.samples, own.spread, astray)
    return found


def _divergence(
    prediction: Prediction | Predictions, k: int, read: Mask, sample_time: float, horizon: float | None
) -> Divergence | None:
    """Whether the predictions of an output go astray in the rows that were read."""
    measured, predicted, run = prediction.measured[read, k], prediction.predicted[read, k], prediction.run[read]
    far = ASTRAY * float(np.ptp(measured)) or ASTRAY * max(float(np.max(np.abs(measured))), 1.0)
    with np.errstate(invalid="ignore", over="ignore"):
        astray = ~(np.abs(predicted - measured) <= far)
    if not np.any(astray):
        return None
    first = int(run[astray][0])
    if horizon is not None:
        return Divergence(first + 1, horizon, float(np.mean(astray)), free=False)
    begin = prediction.rows[np.argmax(prediction.run == first)]
    after = (prediction.rows[read][astray][0] - begin) * sample_time
    return Divergence(first + 1, float(after), len(np.unique(run[astray])) / len(np.unique(run)), free=True)


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


def as_dict(scores: Mapping[str, Mapping[str, Error]]) -> dict[str, dict[str, dict[str, Any]]]:
    """Scores as plain data for JSON."""
    return {
        protocol: {
            name: {"rmse": e.rmse, "rmse_sd": e.rmse_sd, "fvu": e.fvu, "samples": e.samples}
            | ({} if e.diverges is None else {"diverges": asdict(e.diverges)})
            | ({"fvu_published": e.fvu_published, "fvu_pooled": e.fvu_pooled} if protocol == "published" else {})
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
    with np.errstate(over="ignore", invalid="ignore"):  # a simulation that diverged leaves the range of numbers
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
        fvu = float(np.var(residual)) / variance if variance > 0 else float("nan")
        of_papers = _as_published(predicted, measured) if protocol == "published" else (np.nan, np.nan)
    return Error(rmse, sd, fvu, len(residual), float(np.sqrt(variance)), None, *of_papers)


def _as_published(predicted: Array, measured: Array) -> tuple[float, float]:
    """Both fractions of variance unexplained of the papers: the validator's and the pooled one."""
    error = predicted - measured
    full = slice(0, _full_batches(len(error)))
    variances = [float(np.var(own[full])) for own in (error, measured, predicted)]
    about_mean = float(np.sum((measured - np.mean(measured)) ** 2))
    validator = 0.5 * (variances[0] / variances[1] + variances[0] / variances[2]) if min(variances[1:]) > 0 else np.nan
    return validator, float(np.sum(error**2)) / about_mean if about_mean > 0 else np.nan


def _full_batches(samples: int) -> int:
    """Samples in full batches; all, where there is not one."""
    return samples // BATCH * BATCH or samples


def aic(residual: Array, parameters: int, effective: float | None = None) -> float:
    """Akaike's criterion as published: n ln 2 pi + n ln var(e) + sum e^2/var(e) + 2 k.

    Parameters
    ----------
    residual : (samples,) errors of one output; what is no full batch is left out, as published.
    parameters : k.
    effective : number of independent samples that they count as; None counts each, as published.
    """
    own = residual[: _full_batches(len(residual))] if effective is None else residual
    n = float(len(own)) if effective is None else effective
    variance = float(np.var(own))
    return float(n * np.log(2 * np.pi * variance) + n * np.mean(own**2) / variance + 2 * parameters)


def _standard_error(blocks: Array) -> float:
    """Standard error of the mean of blocks; NaN where one block cannot tell."""
    return float(np.std(blocks, ddof=1) / np.sqrt(len(blocks))) if len(blocks) > 1 else float("nan")


Scores = Mapping[str, Mapping[str, Error]]


def score_beside_hold(
    simulator: Simulator, recording: Recording, horizons: Sequence[float] = HORIZONS
) -> tuple[Scores, Scores]:
    """Errors of its model over every horizon and in free run, and those of holding the reading it started from.

    Both are taken over the same rows. In free run what is held is the reading of the run's first row.
    """
    model = simulator.trace.model
    predictor = Predictor(simulator, recording, model.values)
    own: dict[str, Mapping[str, Error]] = {}
    held: dict[str, Mapping[str, Error]] = {}
    for horizon in (*horizons, None):
        name = FREE_RUN if horizon is None else ahead(horizon)
        found = predictor.free_run() if horizon is None else predictor.ahead(horizon)
        for scores, predictions in ((own, found), (held, hold(found, predictor.runs, horizon))):
            told = prediction_errors(model.outputs, predictions, recording.sample_time, horizon)
            if told:
                scores[name] = told
    return own, held


def unfitted_scores(fit: Fit, simulator: Simulator, recording: Recording) -> Scores:
    """Errors of a fit's model, which the simulator is of, before it was fitted; empty where that was not kept."""
    before = {name: value for name, value in fit.how.get("unfitted", {}).items() if name in fit.model}
    if not isinstance(fit.model, MotionModel) or not before:
        return {}
    model = fit.model.with_parameters(*(fit.model[name].with_value(value) for name, value in before.items()))
    return score_motion(simulator.of(model), recording, model.values)


def hold(predictions: Predictions, runs: Sequence[MotionRun], horizon: float | None) -> Predictions:
    """The same rows predicted by the last reading a horizon before, or in free run by the run's first."""
    held = np.full(predictions.predicted.shape, np.nan)
    order = np.argsort(predictions.run, kind="stable")
    edges = np.searchsorted(predictions.run[order], np.arange(len(runs) + 1))
    for run, begin, end in zip(runs, edges[:-1], edges[1:], strict=True):
        own = order[begin:end]
        last = _last_read(run.measured)
        if horizon is None:
            if len(own):
                held[own] = last[predictions.rows[own[0]] - run.rows.start]
        else:
            held[own] = last[predictions.rows[own] - run.rows.start - max(1, round(horizon / run.sample_time))]
    return Predictions(predictions.rows, predictions.run, held, predictions.measured)


def _last_read(measured: Array) -> Array:
    """Every output's last reading up to each row; NaN before the first."""
    rows = np.where(np.isfinite(measured), np.arange(len(measured))[:, None], -1)
    last = np.maximum.accumulate(rows, axis=0)
    return np.where(last >= 0, np.take_along_axis(measured, np.maximum(last, 0), axis=0), np.nan)
