"""`greybox predict` and `greybox validate`: a fit meets another recording."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import click
import pandas as pd

from ..datasets.read import read
from ..errors import BadInput
from ..files import replacing
from ..fit import load
from ..metrics import as_dict, predictions, score
from ..models.registry import build
from .options import columns_option, json_option
from .output import console, errors_table, print_json


@click.command(name="predict")
@click.argument("fit_file", metavar="FIT", type=click.Path())
@click.argument("file", metavar="RECORDING", type=click.Path())
@columns_option
@click.option("--open-loop", is_flag=True, help="Measured inputs throughout, one sample ahead.")
@click.option("--out", default="prediction.csv", show_default=True, metavar="FILE", help="A .csv or .parquet file.")
@json_option
def predict(fit_file: str, file: str, columns: str, open_loop: bool, out: str, as_json: bool) -> None:
    """Predict RECORDING with FIT: a free run from the first window of each run, where the model has a loop.

    \b
    greybox predict run/fit.json lap7.csv --columns roboracer --out lap7_predicted.csv
    """
    target = Path(out)
    if target.suffix not in (".csv", ".parquet"):
        raise BadInput(f"{out}: predictions are written as .csv or .parquet; name such a file with --out.")
    model = load(fit_file, build).model
    recording = read(file, columns)
    closed = model.feedback is not None and not open_loop
    found = predictions(model, recording, "closed_loop" if closed else "honest")
    table = pd.DataFrame({"time": recording.time[found.rows], "run": found.run + 1})
    for k, name in enumerate(model.outputs):
        table[name] = found.measured[:, k]
        table[f"{name}_predicted"] = found.predicted[:, k]
    with replacing(target) as beside:
        if target.suffix == ".csv":
            table.to_csv(beside, index=False)
        else:
            table.to_parquet(beside, index=False)
    body = {"written": str(target), "rows": len(table), "loop": "closed" if closed else "open"}
    if as_json:
        print_json(body)
    else:
        console().print(f"written  {target}: {len(table)} predictions, {body['loop']} loop")


@click.command(name="validate")
@click.argument("fit_file", metavar="FIT", type=click.Path())
@click.argument("files", nargs=-1, required=True, metavar="RECORDING...", type=click.Path())
@columns_option
@json_option
def validate(fit_file: str, files: Sequence[str], columns: str, as_json: bool) -> None:
    """Score FIT on each RECORDING, under every protocol.

    \b
    greybox validate run/fit.json lap7.csv lap8.csv --columns roboracer
    """
    model = load(fit_file, build).model
    metrics = {file: as_dict(score(model, read(file, columns))) for file in files}
    if as_json:
        print_json({"model": model.name, "metrics": metrics})
    else:
        console().print(errors_table(metrics))
