"""`greybox predict` and `greybox simulate`: predictions and simulations of a recording, row by row."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import click

from ..api.predictions import SIMULATIONS, Predicted, predicted, prediction_target, simulated
from ..base.units import pairs
from .options import (
    ABOVE_ZERO,
    CALIBRATE,
    COLUMNS,
    FILE,
    JSON_AND_OWN,
    SIMULATED_MODEL,
    argument,
    command,
    fit_of,
    option,
    parameter_values,
    read_part,
    requested,
)
from .output import console, print_json, working
from .terminal import tell


@command("predict")
def predict(
    fit_file: str = argument("FIT", type=FILE),
    file: str = argument("RECORDING", type=FILE),
    columns: str = COLUMNS,
    horizon: float | None = option(
        "Predict each row from the readings SECONDS earlier (not for networks). Default: free run, a simulation of "
        "each run from its first readings.",
        "SECONDS",
        type=ABOVE_ZERO,
    ),
    posterior: str | None = option(
        "File of draws that greybox sample wrote: predict their mean and a 95 % band.", "FILE", type=FILE
    ),
    calibrate: str | None = CALIBRATE,
    open_loop: bool = option("Only models msnn_... and gnn: predict one sample ahead from measured inputs."),
    out: str = option("File to write: .csv, .parquet, .mf4 or .mcap.", "FILE", default="prediction.csv"),
    as_json: bool = JSON_AND_OWN,
) -> None:
    """Predict the outputs in RECORDING with FIT, and write them as a table.

    Without --horizon, the prediction is a free run: a simulation from the start of each run.

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


@command("simulate", more=SIMULATED_MODEL)
def simulate(
    *,
    paths: Sequence[str] = argument("[FIT] RECORDING", type=FILE, required=True),
    columns: str = COLUMNS,
    start_state: Sequence[str] = option(
        "Value of a state at the start of every run; all other states start at the readings of its first row.",
        "NAME=VALUE",
    ),
    out: str = option("File to write: .csv, .parquet, .mf4 or .mcap.", "FILE", default="simulation.csv"),
    as_json: bool = JSON_AND_OWN,
    fix: Sequence[str],
    **options: Any,
) -> None:
    """Simulate FIT, or a model made from options, with the inputs in RECORDING, and write the outputs as a table.

    If neither --model nor the vehicle file names a model, single_track is simulated.

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
