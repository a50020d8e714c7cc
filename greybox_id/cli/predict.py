"""`greybox predict` and `greybox simulate`: a model meets a recording, row by row."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import click

from ..api.predictions import SIMULATIONS, Predicted, predicted, prediction_target, simulated
from ..base.units import pairs
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


@click.command(name="predict")
@click.argument("fit_file", metavar="FIT", type=click.Path())
@click.argument("file", metavar="RECORDING", type=click.Path())
@columns_option
@click.option(
    "--horizon",
    type=click.FloatRange(min=0, min_open=True),
    metavar="SECONDS",
    help="Equations of motion: predict each row from the readings this much earlier; default: a free run of each run.",
)
@click.option(
    "--posterior",
    metavar="FILE",
    type=click.Path(),
    help="Draws of greybox sample: predict their mean and a 95 % band.",
)
@calibrate_option
@click.option("--open-loop", is_flag=True, help="Models with memory: predict one sample ahead from measured inputs.")
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
    target = prediction_target(out)
    fit = fit_of(fit_file)
    with working(f"predicting {file}"):
        recording = read_part(file, columns)
        result = predicted(fit, recording, horizon, open_loop=open_loop, calibrate=calibrate, posterior=posterior)
        result.save(target)
    _tell(result, target, as_json)


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
    target = prediction_target(out, SIMULATIONS)
    asks = any(options.values())
    if len(paths) != (1 if asks else 2):
        raise click.UsageError(
            "With --model or --vehicle, name one RECORDING and no FIT."
            if asks
            else "Name a FIT and a RECORDING, or a RECORDING and --model NAME."
        )
    with working(f"simulating {paths[-1]}"):
        model: Any = requested(**options, fix=fix).or_single_track() if asks else fit_of(paths[0])
        recording = read_part(paths[-1], columns)
        start = pairs(start_state, "NAME=VALUE, as in ‹start_state› v_x=10")
        result = simulated(model, recording, start, fix=() if asks else parameter_values(fix).get("fix", ()))
        result.save(target)
    for warning in result.facts["warnings"]:
        tell(f"warning: {warning}")
    _tell(result, target, as_json)


def _tell(result: Predicted, target: Path, as_json: bool) -> None:
    if as_json:
        print_json({"written": str(target)} | result.as_dict())
        return
    first, *lines = result.parts()
    for line in (f"written  {target}: {first}", *lines):
        console().print(line)
