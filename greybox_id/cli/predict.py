"""`greybox predict` and `greybox simulate`: a model meets a recording, row by row."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import click
import numpy as np
import pandas as pd

from ..choices.parameters import Choices, state_values, with_choices
from ..choices.wanted import doubts_of_drive, must_be_recorded
from ..datasets.read import read
from ..errors import BadInput
from ..files import replacing
from ..fit import load
from ..hybrid_model import HybridModel
from ..memory_model import MemoryModel
from ..model import Model
from ..models.registry import build
from ..motion_model import MotionModel
from ..recording import Recording
from ..reports.numbers import counted, pretty_unit, with_sd
from ..scores.metrics import Prediction, as_dict, prediction_errors
from ..scores.prediction import as_table, assumed
from ..scores.prediction import predict as predict_rows
from ..scores.prediction import simulate as simulate_runs
from ..signals import unit_of
from .model_options import simulated_model_options, wanted
from .options import columns_option, json_option
from .output import console, print_json

SUFFIXES = (".csv", ".parquet")


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
@click.option("--open-loop", is_flag=True, help="Models with memory: measured inputs throughout, one sample ahead.")
@click.option("--out", default="prediction.csv", show_default=True, metavar="FILE", help="A .csv or .parquet file.")
@json_option
def predict(
    fit_file: str, file: str, columns: str, horizon: float | None, open_loop: bool, out: str, as_json: bool
) -> None:
    """Predict RECORDING with FIT: so many seconds ahead, or freely from the start of each run.

    \b
    greybox predict run/fit.json lap7.csv --columns roboracer --horizon 0.5 --out lap7_predicted.csv
    """  # fmt: skip
    target = target_of(out)
    model = load(fit_file, build).model
    recording = read(file, columns)
    must_be_recorded(model, [recording])
    found = predict_rows(model, recording, horizon, open_loop=open_loop)
    write(as_table(model, recording, found, "predicted"), target)
    if isinstance(model, MotionModel):
        how = "free run" if horizon is None else f"{horizon:g} s ahead"
        told: dict[str, Any] = {"horizon": horizon}
    elif isinstance(model, HybridModel):
        how, told = "free run", {}
    else:
        assert isinstance(model, MemoryModel)
        told = {"loop": "open" if open_loop or model.feedback is None else "closed"}
        how = f"{told['loop']} loop"
    _tell(model, recording, found, target, how, told, as_json)


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
@click.option("--out", default="simulation.csv", show_default=True, metavar="FILE", help="A .csv or .parquet file.")
@json_option
def simulate(
    paths: Sequence[str],
    columns: str,
    start_state: Sequence[str],
    out: str,
    as_json: bool,
    fix: Sequence[str],
    **asked: Any,
) -> None:
    """Simulate every run of RECORDING freely on its inputs, with FIT or with a model made from options.

    \b
    greybox simulate run/fit.json lap7.csv --columns roboracer --out lap7_simulated.csv
    greybox simulate --model single_track --vehicle full_size_car --with steering_delay=30ms lap.csv
    """  # fmt: skip
    target = target_of(out)
    asks = any(asked.values())
    if len(paths) != (1 if asks else 2):
        raise click.UsageError(
            "With --model or --vehicle, name one RECORDING and no FIT."
            if asks
            else "Name a FIT and a RECORDING, or a RECORDING and --model NAME."
        )
    model = wanted(**asked, fix=fix).model() if asks else _of_fit(paths[0], fix)
    recording = read(paths[-1], columns)
    must_be_recorded(model, [recording])
    start = state_values(start_state, model)
    warnings = [*assumed(model, recording, start), *doubts_of_drive(model, [recording])]
    for warning in warnings:
        click.echo(f"warning: {warning}", err=True)
    found = simulate_runs(model, recording, start)
    write(as_table(model, recording, found, "simulated"), target)
    _tell(model, recording, found, target, "free run", {"start": start, "warnings": warnings}, as_json)


def write(table: pd.DataFrame, target: Path) -> None:
    """Write a table as the file's name says, atomically."""
    with replacing(target) as beside:
        if target.suffix == ".csv":
            table.to_csv(beside, index=False)
        else:
            table.to_parquet(beside, index=False)


def _of_fit(fit_file: str, fix: Sequence[str]) -> Model:
    return with_choices(load(fit_file, build).model, Choices(fix=fix))


def target_of(out: str) -> Path:
    """Where a table is to be written. Raises `BadInput` for a kind of file that is not written."""
    target = Path(out)
    if target.suffix not in SUFFIXES:
        raise BadInput(f"{out}: tables are written as {' or '.join(SUFFIXES)}; name such a file with --out.")
    return target


def _tell(
    model: Model, recording: Recording, found: Prediction, target: Path, how: str, told: dict[str, Any], as_json: bool
) -> None:
    errors = prediction_errors(model.outputs, found, recording.sample_time)
    lost = int(np.sum(~np.all(np.isfinite(found.predicted), axis=1)))
    if as_json:
        body = {"written": str(target), "rows": len(found.rows), "runs": len(np.unique(found.run)), "not_finite": lost}
        print_json(body | told | {"errors": as_dict({how: errors})[how]})
        return
    out, runs = console(), counted(len(np.unique(found.run)), "run")
    out.print(f"written  {target}: {counted(len(found.rows), 'row')} in {runs}, {how}")
    for name, error in errors.items():
        out.print(f"         {name}: RMSE {with_sd(error.rmse, error.rmse_sd)} {pretty_unit(unit_of(name))}")
    if lost:
        out.print(f"         {counted(lost, 'row')} without a finite value of every output")
