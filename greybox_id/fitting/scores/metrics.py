"""Errors of a model on a recording, in the signals' units, by defined protocols; the verbs `simulate` and `predict`.

Predictions and protocols of each kind of model are in the module of its name.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field
from typing import Any

import numpy as np
import pandas as pd

from ...base.errors import BadInput
from ...base.shorthands import Array, Mask
from ...datasets.recording import Recording
from ...engine.simulation import Prediction
from ...models.model import Model, by_kind
from ..fit import FREE_RUN as FREE_RUN
from ..fit import Fit


@by_kind
def simulate(model: Model, recording: Recording, start: Mapping[str, float] | None = None) -> Prediction:
    """Free run of every unbroken run, to its end, from the recorded inputs alone.

    Parameters
    ----------
    model : the model, at its values.
    recording : its inputs; outputs may be missing.
    start : states at the start of every run, in SI units; others start from the readings of the first row or, without
        readings, as the model says.

    Raises
    ------
    BadInput : an input is missing, or the model cannot run freely.
    """
    raise BadInput(f"{model.name} is not simulated.")


@by_kind
def predict(model: Model, recording: Recording, horizon: float | None = None, *, open_loop: bool = False) -> Prediction:
    """Predictions of a recording's rows.

    Parameters
    ----------
    model : equations of motion, a model with memory, or a hybrid of physics and network.
    recording : inputs and readings.
    horizon : s; equations of motion predict every row from the readings this much earlier. None runs freely from
        the first row of each run.
    open_loop : models with memory predict one sample ahead from measured inputs; those without feedback always do.

    Raises
    ------
    BadInput : a signal is missing, the horizon does not suit the recording, or the model does not have this option.
    """
    if horizon is not None or open_loop:
        raise BadInput(f"{model.name} runs freely from the start of each run; omit ‹horizon› and ‹open_loop›.")
    return simulate(model, recording)


@by_kind
def predicted_how(model: Model, horizon: float | None, open_loop: bool) -> tuple[str, dict[str, Any]]:
    """The kind of prediction that `predict` makes, in words and as data."""
    return "free run", {}


def must_suit(horizon: float, recordings: Sequence[Recording]) -> None:
    """Raise `BadInput` if a horizon is shorter than a sample or longer than every run of a recording."""
    for recording in recordings:
        step = recording.sample_time
        longest = max(float(recording.time[stop - 1] - recording.time[start]) for start, stop in recording.runs)
        if horizon < 0.5 * step:
            raise BadInput(f"A horizon of {horizon:g} s is shorter than a sample of {recording.name}, {step:.4g} s.")
        if horizon > longest * (1 + 1e-9):
            raise BadInput(
                f"A horizon of {horizon:g} s is longer than the longest unbroken run of {recording.name}, "
                f"{longest:.4g} s."
            )


@by_kind
def assumed(model: Model, recording: Recording, start: Mapping[str, float]) -> list[str]:
    """Sentences on states that are neither recorded nor given, and for which the model assumes a fixed start."""
    return []


def as_table(model: Model, recording: Recording, prediction: Prediction, suffix: str) -> pd.DataFrame:
    """Predictions with the readings, if any: time, run, and every output as read and as predicted."""
    table = pd.DataFrame({"time": recording.time[prediction.rows], "run": prediction.run + 1})
    for k, name in enumerate(model.outputs):
        if name in recording:
            table[name] = prediction.measured[:, k]
        table[f"{name}_{suffix}"] = prediction.predicted[:, k]
    return table


ASTRAY = 10.0
"""Error, in ranges of the readings, beyond which a prediction has diverged."""


@dataclass(frozen=True)
class Divergence:
    """Divergence of predictions: errors beyond `ASTRAY` times the range of readings, or not finite.

    Attributes
    ----------
    run : number of the first run with divergence, from 1.
    after : s from the start of that run (free run) or the horizon (predictions over a horizon).
    share : share of the runs, or of the predictions over the horizon.
    free : whether a free run diverges.
    """

    run: int
    after: float
    share: float
    free: bool

    @property
    def words(self) -> str:
        """The divergence, as the end of a sentence."""
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
    spread : standard deviation of the readings, in the output's unit; NaN if it was not kept.
    diverges : divergence of the predictions; None without. The RMSE is then infinite.
    fvu_published : (var(error)/var(measured) + var(error)/var(predicted))/2 over full batches, as in nnodely's
        validator; NaN outside the published protocol.
    fvu_pooled : sum of squared errors over that of the readings around their mean, which includes a bias; NaN likewise.
    blocks : mean square of each block of one second over that of all, in order of time; empty if it was not kept.
    """

    rmse: float
    rmse_sd: float
    fvu: float
    samples: int
    spread: float = np.nan
    diverges: Divergence | None = None
    fvu_published: float = np.nan
    fvu_pooled: float = np.nan
    blocks: Array = field(default_factory=lambda: np.zeros(0), repr=False, compare=False)

    @property
    def fit_percent(self) -> float:
        """100 (1 - RMSE / standard deviation of the readings), as usual in system identification; 100 is perfect."""
        return 100.0 * (1.0 - self.rmse / self.spread) if self.spread > 0 else np.nan


HORIZONS = (0.1, 0.5, 1.0, 2.0)
"""Horizons, s, at which motion models are scored."""


def ahead(horizon: float) -> str:
    """Name of the protocol that predicts over a horizon, s."""
    return f"{horizon:g} s ahead"


Scores = Mapping[str, Mapping[str, Error]]
"""Protocol -> output -> its error."""


@by_kind
def score(model: Model, recording: Recording) -> Scores:
    """Errors of every output under every protocol of the model's kind; by default in free run."""
    return {FREE_RUN: prediction_errors(model.outputs, simulate(model, recording), recording.sample_time)}


@by_kind
def score_with_persistence(
    model: Model, recording: Recording, horizons: Sequence[float] = HORIZONS
) -> tuple[Scores, Scores]:
    """`score`, and errors of persistence over the same rows, if the model's kind has them."""
    return score(model, recording), {}


def unfitted_scores(fit: Fit, recording: Recording) -> Scores:
    """Errors of a fit's model at its values before the fit; empty if those were not kept."""
    before = {name: value for name, value in fit.how.get("unfitted", {}).items() if name in fit.model}
    if not before:
        return {}
    return score(fit.model.with_parameters(*(fit.model[n].with_value(v) for n, v in before.items())), recording)


def prediction_errors(
    outputs: Sequence[str], prediction: Prediction, sample_time: float, horizon: float | None = None
) -> dict[str, Error]:
    """Errors of every measured output; the predictions are of a free run if no horizon, s, is given."""
    result = {}
    for k, output in enumerate(outputs):
        read = np.isfinite(prediction.measured[:, k]) & ~np.isnan(prediction.predicted[:, k])
        if np.any(read):
            error = error_of(prediction.predicted[read, k], prediction.measured[read, k], sample_time)
            astray = _divergence(prediction, k, read, sample_time, horizon)
            result[output] = (
                error if astray is None else Error(np.inf, np.nan, np.inf, error.samples, error.spread, astray)
            )
    return result


def _divergence(
    prediction: Prediction, k: int, read: Mask, sample_time: float, horizon: float | None
) -> Divergence | None:
    """Divergence of an output's predictions in the rows with readings, if any."""
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


def error_of(predicted: Array, measured: Array, sample_time: float) -> Error:
    """The error of one output, all samples pooled."""
    with np.errstate(over="ignore", invalid="ignore"):  # a diverging simulation overflows
        residual = predicted - measured
        square = residual**2
        rmse = float(np.sqrt(np.mean(square)))
        length = max(1, min(len(square), round(1.0 / sample_time)))
        blocks = square[: len(square) // length * length].reshape(-1, length).mean(axis=1)
        sd = standard_error(blocks) / (2 * rmse) if rmse > 0 else 0.0
        variance = float(np.var(measured))
        fvu = float(np.var(residual)) / variance if variance > 0 else float("nan")
        relative = blocks / rmse**2 if rmse > 0 else np.zeros(0)
    return Error(rmse, sd, fvu, len(residual), float(np.sqrt(variance)), blocks=relative)


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


def standard_error(blocks: Array) -> float:
    """Standard error of the mean of blocks; NaN for a single block."""
    return float(np.std(blocks, ddof=1) / np.sqrt(len(blocks))) if len(blocks) > 1 else float("nan")
