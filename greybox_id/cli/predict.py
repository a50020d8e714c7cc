"""`greybox predict` and `greybox simulate`: a model meets a recording, row by row."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import click
import numpy as np

from ..base.guard import claim
from ..base.numbers import counted, pretty_unit, with_sd
from ..base.quantity import pairs
from ..base.signals import unit_of
from ..datasets.recording import Recording
from ..datasets.result_table import target_of, write_table
from ..engine.simulation import Prediction
from ..fitting.choices.parameters import Choices, state_values, with_choices
from ..fitting.choices.requested_model import doubts_of_drive, must_be_recorded
from ..fitting.fit import Fit
from ..fitting.restated import as_fitted
from ..fitting.scores.metrics import as_dict, prediction_errors
from ..fitting.scores.prediction import as_table, assumed, predicted_how
from ..fitting.scores.prediction import predict as predict_rows
from ..fitting.scores.prediction import simulate as simulate_runs
from ..fitting.scores.timing import calibrated_predictions, calibrated_seconds, calibrated_timing, must_have_timing
from ..models.model import Model
from ..reports.text.memory import timing_lines
from .options import (
    calibrate_option,
    columns_option,
    fit_of,
    json_option,
    own_option,
    parameter_values,
    read_part,
    requested,
    simulated_model_options,
)
from .output import console, print_json, working
from .terminal import tell

PREDICTIONS, SIMULATIONS = "a table of predictions", "a table of simulations"


@click.command(name="predict")
@click.argument("fit_file", metavar="FIT", type=click.Path())
@click.argument("file", metavar="RECORDING", type=click.Path())
@columns_option
@click.option(
    "--horizon",
    type=click.FloatRange(min=0, min_open=True),
    metavar="SECONDS",
    help="Equations of motion: every row from the readings so much earlier; default: a free run of every run.",
)
@click.option(
    "--posterior",
    metavar="FILE",
    type=click.Path(),
    help="Draws of greybox sample: the mean over them, and a 95 % band of readings.",
)
@calibrate_option
@click.option("--open-loop", is_flag=True, help="Models with memory: measured inputs throughout, one sample ahead.")
@click.option(
    "--out", default="prediction.csv", show_default=True, metavar="FILE", help="A .csv, .parquet, .mf4 or .mcap file."
)
@own_option
@json_option
def predict(
    fit_file: str,
    file: str,
    columns: str,
    horizon: float | None,
    posterior: str | None,
    calibrate: str | None,
    open_loop: bool,
    out: str,
    as_json: bool,
) -> None:
    """Predict RECORDING with FIT: so many seconds ahead, or freely from the start of each run.

    \b
    greybox predict run/fit.json lap7.csv --columns roboracer --horizon 0.5 --out lap7_predicted.csv
    greybox predict msnn_full/fit.json lap7.csv --columns roboracer --calibrate timing
    """  # fmt: skip
    target = claim(target_of(out), becomes=PREDICTIONS)
    fit = fit_of(fit_file)
    model = fit.model
    more: dict[str, Any] = {}
    seconds = calibrated_seconds(calibrate)
    if seconds is not None and (posterior is not None or horizon is not None):
        raise click.UsageError("--calibrate is for models with memory, which have no --posterior and no --horizon.")
    if posterior is not None and open_loop:
        raise click.UsageError("--open-loop is for models with memory, which have no --posterior.")
    with working(f"predicting {file}"):
        recording = as_fitted(fit, read_part(file, columns))
        must_be_recorded(model, [recording])
        if seconds is not None:
            timing = calibrated_timing(fit, recording, seconds)
            result = calibrated_predictions(must_have_timing(model), recording, timing, open_loop=open_loop)
            table, more = as_table(model, recording, result, "predicted"), {"timing": timing.as_dict()}
        elif posterior is None:
            result = predict_rows(model, recording, horizon, open_loop=open_loop)
            table = as_table(model, recording, result, "predicted")
        else:
            from ..fitting.posterior.posterior import load_posterior
            from ..fitting.posterior.predictive import banded_table, predictive_band

            band = predictive_band(fit, load_posterior(posterior), recording, horizon)
            result, table = band.mean, banded_table(model, recording, band)
            covered = dict(zip(model.outputs, band.coverage().tolist(), strict=True))
            more = {"posterior": {"file": posterior, "draws": band.draws, "level": band.level, "coverage": covered}}
        write_table(table, target, PREDICTIONS)
    how, known = predicted_how(model, horizon, open_loop)
    _tell(model, recording, result, target, how, known | more, as_json)


@click.command(name="simulate")
@click.argument("paths", nargs=-1, required=True, metavar="[FIT] RECORDING", type=click.Path())
@simulated_model_options
@columns_option
@click.option(
    "--start-state",
    multiple=True,
    metavar="NAME=VALUE",
    help="A state at the start of every run; others start from the first row's readings.",
)
@click.option(
    "--out", default="simulation.csv", show_default=True, metavar="FILE", help="A .csv, .parquet, .mf4 or .mcap file."
)
@own_option
@json_option
def simulate(
    paths: Sequence[str],
    columns: str,
    start_state: Sequence[str],
    out: str,
    as_json: bool,
    fix: Sequence[str],
    **options: Any,
) -> None:
    """Simulate every run of RECORDING freely on its inputs, with FIT or with a model made from options.

    A vehicle that names no model is a single_track.

    \b
    greybox simulate run/fit.json lap7.csv --columns roboracer --out lap7_simulated.csv
    greybox simulate --model single_track --vehicle full_size_car --with steering_delay=30ms lap.csv
    """  # fmt: skip
    target = claim(target_of(out), becomes=SIMULATIONS)
    asks = any(options.values())
    if len(paths) != (1 if asks else 2):
        raise click.UsageError(
            "With --model or --vehicle, name one RECORDING and no FIT."
            if asks
            else "Name a FIT and a RECORDING, or a RECORDING and --model NAME."
        )
    fitted = None if asks else fit_of(paths[0])
    model = requested(**options, fix=fix).or_single_track().model() if fitted is None else _changed(fitted, fix)
    with working(f"reading {paths[-1]}"):
        recording = read_part(paths[-1], columns)
    if fitted is not None:
        recording = as_fitted(fitted, recording)
    must_be_recorded(model, [recording])
    start = state_values(pairs(start_state, "NAME=VALUE, as in ‹start_state› v_x=10"), model)
    warnings = [*assumed(model, recording, start), *doubts_of_drive(model, [recording])]
    for warning in warnings:
        tell(f"warning: {warning}")
    with working(f"simulating {recording.name}"):
        result = simulate_runs(model, recording, start)
        write_table(as_table(model, recording, result, "simulated"), target, SIMULATIONS)
    _tell(model, recording, result, target, "free run", {"start": start, "warnings": warnings}, as_json)


def _changed(fit: Fit, fix: Sequence[str]) -> Model:
    return with_choices(fit.model, Choices(**parameter_values(fix)))


def _tell(
    model: Model,
    recording: Recording,
    prediction: Prediction,
    target: Path,
    how: str,
    known: dict[str, Any],
    as_json: bool,
) -> None:
    errors = prediction_errors(model.outputs, prediction, recording.sample_time)
    lost = int(np.sum(~np.all(np.isfinite(prediction.predicted), axis=1)))
    if as_json:
        body = {
            "written": str(target),
            "rows": len(prediction.rows),
            "runs": len(np.unique(prediction.run)),
            "not_finite": lost,
        }
        print_json(body | known | {"errors": as_dict({how: errors})[how]})
        return
    out, runs = console(), counted(len(np.unique(prediction.run)), "run")
    out.print(f"written  {target}: {counted(len(prediction.rows), 'row')} in {runs}, {how}")
    for name, error in errors.items():
        out.print(f"         {name}: RMSE {with_sd(error.rmse, error.rmse_sd)} {pretty_unit(unit_of(name))}")
    for line in timing_lines(known["timing"]) if "timing" in known else ():
        out.print(f"timing   {line}")
    for name, share in known.get("posterior", {}).get("coverage", {}).items():
        if np.isfinite(share):
            out.print(f"         {name}: {100 * share:.1f} % of the readings within the 95 % band")
    if lost:
        out.print(f"         {counted(lost, 'row')} without a finite value of every output")
