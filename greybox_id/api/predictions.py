"""Free runs, predictions and residuals of a model as recordings, and its errors as a table.

Validation of a fit on recordings that it was not fitted to.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from rich.console import RenderableType

from ..api import given
from ..base.declared import understood
from ..base.errors import BadInput
from ..base.numbers import counted, pretty_unit, with_sd
from ..base.signals import unit_of
from ..base.units import Quantity
from ..datasets.recording import Recording
from ..datasets.result_table import claimed_table, write_table
from ..engine.simulation import Prediction
from ..fitting.fit import Fit, Verdict
from ..fitting.holding import as_fitted
from ..fitting.posterior.posterior import Posterior, load_posterior
from ..fitting.posterior.predictive import banded_table, predictive_band
from ..fitting.provenance import data_record
from ..fitting.requested_model import doubts_of_drive, must_be_recorded, state_values, with_choices
from ..fitting.scores.metrics import (
    FREE_RUN,
    Error,
    Scores,
    as_dict,
    as_table,
    assumed,
    predicted_how,
    prediction_errors,
)
from ..fitting.scores.metrics import predict as predict_rows
from ..fitting.scores.metrics import score as score_model
from ..fitting.scores.metrics import simulate as simulate_runs
from ..fitting.scores.timing import (
    calibrated_predictions,
    calibrated_seconds,
    calibrated_timing,
    calibration_words,
    must_have_timing,
)
from ..fitting.scores.verdict import HELD_OUT, distrust, used_signals
from ..fitting.verb import judgement
from ..models.model import Model
from ..reports.text.fit import errors_table, verdict_table
from ..reports.text.memory import timing_lines
from ..reports.text.motion import motion_errors_table
from ..reports.text.screen import as_text
from .given import Columns, Effects, ModelLike, Numbers, VehicleLike

PREDICTIONS, SIMULATIONS = "a table of predictions", "a table of simulations"


@understood
def simulate(
    model: ModelLike | Fit,
    recording: Recording | str | Path,
    *,
    start: Mapping[str, Quantity] | None = None,
    vehicle: VehicleLike = None,
    effects: Effects = (),
    columns: Columns = "canonical",
) -> Recording:
    """Simulate every run of a recording freely, from its first row to its end, given only its inputs.

    Parameters
    ----------
    model : a fit, a model, or a model's name.
    recording : with the inputs; measurements of outputs are needed only in the first row of each run.
    start : state -> value at the start of every run, a number in SI or a text with a unit; other states start from the
        measurements in the first row.
    vehicle, effects : for a model given by name: initial values, and effects that are added.
    columns : column map for a file.

    Returns
    -------
    Recording
        The outputs (n,) in SI units, on the time and runs of `recording`; NaN in rows without prediction.

    Raises
    ------
    BadInput : if an input is missing, a name is unknown, or the model cannot run in closed loop.

    Examples
    --------
    >>> import greybox_id as gb
    >>> lap = gb.read(gb.datasets.shipped("racer_train"), columns="roboracer").rows(0, 400)
    >>> gb.simulate("kinematic", lap, vehicle="roboracer")
    Recording racer_train, kinematic: 400 rows in 1 run, 19.95 s at 20 Hz
      yaw_rate [rad/s], a_y [m/s²]
    """
    return simulated(model, recording, start, vehicle, effects, columns).as_recording()


@understood
def predict(
    model: ModelLike | Fit,
    recording: Recording | str | Path,
    horizon: float | None = None,
    *,
    open_loop: bool = False,
    calibrate: str | None = None,
    vehicle: VehicleLike = None,
    effects: Effects = (),
    columns: Columns = "canonical",
) -> Recording:
    """Predict every row of a recording from earlier measurements.

    Parameters
    ----------
    model : a fit, a model, or a model's name.
    recording : inputs and measurements.
    horizon : s; equations of motion predict every row from the measurements that much earlier. None for the free run.
    open_loop : whether models with memory predict one sample ahead from measured inputs.
    calibrate : for fits of models with memory, "timing" or "timing=8s": the delay of each run is estimated from its
        first 5 s, or 8 s, of motion and then kept; the rest is predicted.
    vehicle, effects, columns : as in `simulate`.

    Returns
    -------
    Recording
        The outputs (n,) in SI units, on the time and runs of `recording`; NaN in rows without prediction.

    Raises
    ------
    BadInput : if a signal is missing, or the horizon is not positive, shorter than a sample or longer than every run.

    Examples
    --------
    >>> import greybox_id as gb
    >>> lap = gb.read(gb.datasets.shipped("racer_train"), columns="roboracer").rows(0, 400)
    >>> ahead = gb.predict("kinematic", lap, horizon=0.5, vehicle="roboracer")
    >>> len(ahead) == len(lap)
    True
    """
    return predicted(
        model, recording, horizon, open_loop=open_loop, calibrate=calibrate, vehicle=vehicle, effects=effects,
        columns=columns,
    ).as_recording()  # fmt: skip


@dataclass(frozen=True)
class Predicted:
    """Predictions of a recording by a model.

    Attributes
    ----------
    model, recording : the model and the recording.
    prediction : row by row.
    how : in words, such as "0.5 s ahead".
    called : suffix for the name of the predicted recording.
    facts : further plain data: timing, posterior, start, warnings.
    table : time, run, and every output as measured and as predicted.
    words : kind of the table's file, for messages.
    """

    model: Model
    recording: Recording
    prediction: Prediction
    how: str
    called: str
    facts: Mapping[str, Any]
    table: pd.DataFrame
    words: str = PREDICTIONS

    def as_recording(self) -> Recording:
        """The predicted outputs on the recording's time."""
        return _as_recording(self.model, self.recording, self.prediction, self.called)

    @cached_property
    def errors(self) -> dict[str, Error]:
        """Output -> its error."""
        return prediction_errors(self.model.outputs, self.prediction, self.recording.sample_time)

    @property
    def runs(self) -> int:
        """Number of predicted runs."""
        return len(np.unique(self.prediction.run))

    @property
    def not_finite(self) -> int:
        """Number of rows without a finite value of every output."""
        return int(np.sum(~np.all(np.isfinite(self.prediction.predicted), axis=1)))

    def save(self, path: Path) -> Path:
        """Write the table in the format of the file's suffix."""
        write_table(self.table, path, self.words)
        return path

    def as_dict(self) -> dict[str, Any]:
        """All attributes except the rows, as plain data."""
        counts = {"rows": len(self.prediction.rows), "runs": self.runs, "not_finite": self.not_finite}
        return counts | dict(self.facts) | {"errors": as_dict({self.how: self.errors})[self.how]}

    def parts(self) -> Iterator[str]:
        """The text of the predictions, line by line; the first line follows the file's name."""
        yield f"{counted(len(self.prediction.rows), 'row')} in {counted(self.runs, 'run')}, {self.how}"
        for name, error in self.errors.items():
            yield f"         {name}: RMSE {with_sd(error.rmse, error.rmse_sd)} {pretty_unit(self.model.unit(name))}"
        for line in timing_lines(self.facts["timing"]) if "timing" in self.facts else ():
            yield f"timing   {line}"
        for name, share in self.facts.get("posterior", {}).get("coverage", {}).items():
            if np.isfinite(share):
                yield f"         {name}: {100 * share:.1f} % of the readings within the 95 % band"
        if self.not_finite:
            yield f"         {counted(self.not_finite, 'row')} without a finite value of every output"


def prediction_target(out: str, words: str = PREDICTIONS) -> Path:
    """The file for predictions. Raises `BadInput` for another kind of file."""
    return claimed_table(out, words)


def simulated(
    model: ModelLike | Fit,
    recording: Recording | str | Path,
    start: Mapping[str, Quantity] | None = None,
    vehicle: VehicleLike = None,
    effects: Effects = (),
    columns: Columns = "canonical",
    fix: str | Iterable[str] | Numbers = (),
) -> Predicted:
    """The free run of every run. Other parameters and errors are those of `simulate`.

    Parameters
    ----------
    fix : parameters that are fixed at your own values.
    """
    chosen, read = _both(model, recording, vehicle, effects, columns)
    chosen = with_choices(chosen, given.choices(fix))
    states = state_values(start or {}, chosen)
    warnings = [*assumed(chosen, read, states), *doubts_of_drive(chosen, [read])]
    result = simulate_runs(chosen, read, states)
    table = as_table(chosen, read, result, "simulated")
    return Predicted(chosen, read, result, "free run", chosen.name, {"start": states, "warnings": warnings}, table,
                     SIMULATIONS)  # fmt: skip


def predicted(
    model: ModelLike | Fit,
    recording: Recording | str | Path,
    horizon: float | None = None,
    *,
    open_loop: bool = False,
    calibrate: str | None = None,
    posterior: Posterior | str | Path | None = None,
    vehicle: VehicleLike = None,
    effects: Effects = (),
    columns: Columns = "canonical",
) -> Predicted:
    """Every row from earlier measurements. Parameters and errors are those of `predict`.

    Parameters
    ----------
    posterior : of a fit, or its file: the prediction is the mean over its draws, and the table has a 95 % band.
    """
    must_be_horizon(horizon)
    seconds = calibrated_seconds(calibrate)
    if seconds is not None and (horizon is not None or posterior is not None):
        raise BadInput(
            "With ‹calibrate›, omit ‹horizon› and ‹posterior›: ‹calibrate› is for models with memory, which predict "
            "freely or one sample ahead."
        )
    if posterior is not None and open_loop:
        raise BadInput(
            "‹open_loop› and ‹posterior› cannot be used together: only models with memory predict in open "
            "loop, and they have no posterior."
        )
    if (seconds is not None or posterior is not None) and not isinstance(model, Fit):
        raise BadInput(f"model: a fit is needed, since only a fit knows its noise, not {model!r:.60}.")
    chosen, read = _both(model, recording, vehicle, effects, columns)
    how, facts = predicted_how(chosen, horizon, open_loop)
    called = f"{chosen.name}{f', {horizon:g} s ahead' if horizon is not None else ''}"
    if seconds is not None:
        assert isinstance(model, Fit)
        memory = must_have_timing(chosen)
        timing = calibrated_timing(model, read, seconds)
        result = calibrated_predictions(memory, read, timing, open_loop=open_loop)
        facts, called = facts | {"timing": timing.as_dict()}, f"{chosen.name}, {calibration_words(seconds)}"
    elif posterior is not None:
        assert isinstance(model, Fit)
        draws = posterior if isinstance(posterior, Posterior) else load_posterior(posterior)
        band = predictive_band(model, draws, read, horizon)
        covered = dict(zip(chosen.outputs, band.coverage().tolist(), strict=True))
        file = {} if posterior is draws else {"file": str(posterior)}
        facts = facts | {"posterior": {**file, "draws": band.draws, "level": band.level, "coverage": covered}}
        return Predicted(chosen, read, band.mean, how, called, facts, banded_table(chosen, read, band))
    else:
        result = predict_rows(chosen, read, None if horizon is None else float(horizon), open_loop=open_loop)
    return Predicted(chosen, read, result, how, called, facts, as_table(chosen, read, result, "predicted"))


def residuals(
    model: ModelLike | Fit,
    recording: Recording | str | Path,
    horizon: float | None = None,
    columns: Columns = "canonical",
) -> Recording:
    """Measured minus predicted, on the recording's time, in SI units."""
    read = given.one_recording(recording, columns)
    predictions = predict(model, read, horizon)
    residual = {name: read[name] - values for name, values in predictions.signals.items() if name in read}
    return replace(predictions, name=f"{predictions.name}, residuals", signals=residual)


@understood
def score(model: ModelLike | Fit, recording: Recording | str | Path, columns: Columns = "canonical") -> pd.DataFrame:
    """Errors of a model on a recording, over horizons and in free run.

    Parameters
    ----------
    model : a fit, a model, or a model's name.
    recording : inputs and measurements.
    columns : column map for a file.

    Returns
    -------
    pandas.DataFrame
        A row per output and protocol: `output`, `unit` (SI), `protocol` ("0.5 s ahead", "free run", or that of a model
        with memory), `horizon` [s] (infinite in free run, NaN one sample ahead), `rmse` and its standard error `stderr`
        [unit], `fit_percent` = ``100 (1 - |e| / |y - mean(y)|)``, the fraction of variance unexplained `fvu`, and
        `samples`.

    Raises
    ------
    BadInput : if a signal is missing.

    Examples
    --------
    >>> import greybox_id as gb
    >>> lap = gb.read(gb.datasets.shipped("racer_train"), columns="roboracer").rows(0, 400)
    >>> gb.score(gb.models.kinematic(vehicle="roboracer"), lap)["protocol"].unique().tolist()
    ['0.1 s ahead', '0.5 s ahead', '1 s ahead', '2 s ahead', 'free run']
    """
    chosen, read = _both(model, recording, None, (), columns)
    rows = [
        {
            "output": name,
            "unit": chosen.unit(name),
            "protocol": protocol,
            "horizon": _seconds(protocol),
            "rmse": error.rmse,
            "stderr": error.rmse_sd,
            "fit_percent": error.fit_percent,
            "fvu": error.fvu,
            "samples": error.samples,
        }
        for protocol, errors in score_model(chosen, read).items()
        for name, error in errors.items()
    ]
    return pd.DataFrame(rows).sort_values(["output", "horizon"], kind="stable", ignore_index=True)


def must_be_horizon(horizon: object) -> None:
    """Raise `BadInput` unless a horizon is a positive time, or None for the free run."""
    if horizon is None:
        return
    if not isinstance(horizon, int | float) or isinstance(horizon, bool) or not 0 < horizon < np.inf:
        raise BadInput(f"horizon: seconds above zero are needed, or None for the free run, not {horizon!r:.40}.")


def _seconds(protocol: str) -> float:
    if protocol in (FREE_RUN, "closed_loop"):
        return float("inf")
    head, _, rest = protocol.partition(" s ahead")
    return float(head) if rest == "" and head != protocol else float("nan")


def _both(
    model: ModelLike | Fit, recording: Recording | str | Path, vehicle: VehicleLike, effects: Effects, columns: Columns
) -> tuple[Model, Recording]:
    chosen, read = given.model(model, vehicle, effects), given.one_recording(recording, columns)
    if isinstance(model, Fit):
        read = as_fitted(model, read)
    must_be_recorded(chosen, [read])
    return chosen, read


def _as_recording(model: Model, recording: Recording, prediction: Prediction, suffix: str) -> Recording:
    """Predictions on the time of the recording."""
    signals = {}
    rows = np.asarray(prediction.rows, dtype=int)
    for k, name in enumerate(model.outputs):
        values = np.full(len(recording), np.nan)
        values[rows] = prediction.predicted[:, k]
        signals[name] = values
    units = {name: model.unit(name) for name in model.outputs if not unit_of(name, "")}
    return Recording(
        name=f"{recording.name}, {suffix}", time=recording.time, signals=signals, runs=recording.runs, extra_units=units
    )


@dataclass(frozen=True)
class Validation:
    """Validation of a fit on recordings.

    Attributes
    ----------
    model : name of the fit's model.
    verdict : whether the fit is usable on them, with reasons.
    scores : recording -> protocol or horizon -> output -> error.
    held : likewise for persistence; empty for models with memory.
    units : output -> its SI unit.
    """

    model: str
    verdict: Verdict
    scores: Mapping[str, Scores]
    held: Mapping[str, Scores]
    units: Mapping[str, str]

    def parts(self) -> Iterator[RenderableType]:
        """The text of the validation, part by part."""
        errors, persistence = self._tables()
        yield verdict_table(self.verdict)
        yield ""
        unit = self.units.__getitem__
        yield (
            motion_errors_table(errors, unit_of=unit, beside=persistence) if persistence else errors_table(errors, unit)
        )

    def summary(self) -> str:
        """The text that `greybox validate` prints: the verdict and the errors."""
        return as_text(self.parts())

    def as_dict(self) -> dict[str, Any]:
        """The validation as plain data."""
        errors, persistence = self._tables()
        more = {"persistence": persistence} if persistence else {}
        return {**self.verdict.as_dict(), "model": self.model, "metrics": errors, **more}

    def __repr__(self) -> str:
        return f"Validation of {self.model} on {', '.join(self.scores)}: {self.verdict.usability}"

    def _tables(self) -> tuple[dict[str, Any], dict[str, Any]]:
        errors, persistence = ({name: as_dict(each) for name, each in of.items()} for of in (self.scores, self.held))
        return errors, persistence


def validation(fit: Fit, recordings: Mapping[str, Recording]) -> Validation:
    """Score a fit on recordings, by name.

    Equations of motion are compared with persistence, and with the model before the fit.
    """
    model = fit.model
    must_be_recorded(model, list(recordings.values()))
    distrusts = {
        name: distrust(used_signals(fit.model), recording, faults=True) for name, recording in recordings.items()
    }
    data = [data_record(recording, HELD_OUT) for recording in recordings.values()]
    judged = judgement(fit, recordings, distrusts, data)
    units = {name: model.unit(name) for name in model.outputs}
    return Validation(model.name, judged.verdict, judged.scores, judged.persistence, units)
