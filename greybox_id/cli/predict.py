"""`greybox predict` and `greybox simulate`: a model meets a recording, row by row."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import click
import numpy as np

from ..api.predictions import Predicted, predicted, simulated
from ..base.guard import claim
from ..base.numbers import counted, pretty_unit, with_sd
from ..base.quantity import pairs
from ..base.signals import unit_of
from ..datasets.result_table import target_of, write_table
from ..fitting.choices.parameters import Choices, with_choices
from ..fitting.choices.requested_model import RequestedModel
from ..fitting.fit import Fit
from ..fitting.posterior.posterior import load_posterior
from ..fitting.scores.metrics import as_dict, prediction_errors
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
    draws = None if posterior is None else load_posterior(posterior)
    with working(f"predicting {file}"):
        result = predicted(
            fit, read_part(file, columns), horizon, open_loop=open_loop, calibrate=calibrate, posterior=draws
        )
        write_table(result.table, target, PREDICTIONS)
    facts = dict(result.facts)
    if posterior is not None:
        facts["posterior"] = {"file": posterior, **facts["posterior"]}
    _tell(result, target, facts, as_json)


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
    with working(f"simulating {paths[-1]}"):
        if asks:
            model: RequestedModel | Fit = requested(**options, fix=fix).or_single_track()
        else:
            fitted = fit_of(paths[0])
            model = replace(fitted, model=with_choices(fitted.model, Choices(**parameter_values(fix))))
        recording = read_part(paths[-1], columns)
        start = pairs(start_state, "NAME=VALUE, as in ‹start_state› v_x=10")
        result = simulated(model, recording, start)
        write_table(result.table, target, SIMULATIONS)
    for warning in result.facts["warnings"]:
        tell(f"warning: {warning}")
    _tell(result, target, result.facts, as_json)


def _tell(result: Predicted, target: Path, facts: Mapping[str, Any], as_json: bool) -> None:
    model, recording, prediction, how = result.model, result.recording, result.prediction, result.how
    errors = prediction_errors(model.outputs, prediction, recording.sample_time)
    lost = int(np.sum(~np.all(np.isfinite(prediction.predicted), axis=1)))
    if as_json:
        body = {
            "written": str(target),
            "rows": len(prediction.rows),
            "runs": len(np.unique(prediction.run)),
            "not_finite": lost,
        }
        print_json(body | dict(facts) | {"errors": as_dict({how: errors})[how]})
        return
    out, runs = console(), counted(len(np.unique(prediction.run)), "run")
    out.print(f"written  {target}: {counted(len(prediction.rows), 'row')} in {runs}, {how}")
    for name, error in errors.items():
        out.print(f"         {name}: RMSE {with_sd(error.rmse, error.rmse_sd)} {pretty_unit(unit_of(name))}")
    for line in timing_lines(facts["timing"]) if "timing" in facts else ():
        out.print(f"timing   {line}")
    for name, share in facts.get("posterior", {}).get("coverage", {}).items():
        if np.isfinite(share):
            out.print(f"         {name}: {100 * share:.1f} % of the readings within the 95 % band")
    if lost:
        out.print(f"         {counted(lost, 'row')} without a finite value of every output")
