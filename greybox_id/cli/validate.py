"""`greybox validate`: how far a fit is from other recordings."""

from __future__ import annotations

from collections.abc import Sequence

import click

from ..api.fitting import load
from ..api.predictions import validation
from ..base.numbers import counted
from .options import columns_option, json_option, own_option, read_part
from .output import end_by, print_json, show, working


@click.command(name="validate")
@click.argument("fit_file", metavar="FIT", type=click.Path())
@click.argument("files", nargs=-1, required=True, metavar="RECORDING...", type=click.Path())
@columns_option
@own_option
@json_option
def validate(fit_file: str, files: Sequence[str], columns: str, as_json: bool) -> None:
    """Score FIT on each RECORDING: over horizons and in free run, or under every protocol of models with memory.

    Equations of motion are set beside what holding the last reading would do, and beside the model as it was before it
    was fitted. Exit code 3: the fit is not usable on these recordings.

    \b
    greybox validate run/fit.json lap7.csv lap8.csv --columns roboracer
    """
    fit = load(fit_file)
    with working(f"scoring {fit_file} on {counted(len(files), 'recording')}"):
        result = validation(fit, {file: read_part(file, columns) for file in files})
    if as_json:
        print_json(result.as_dict())
    else:
        show(result.parts())
    end_by(result.verdict)
