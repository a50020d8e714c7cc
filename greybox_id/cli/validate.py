"""`greybox validate`: how far a fit is from other recordings."""

from __future__ import annotations

from collections.abc import Sequence

import click

from ..choices.wanted import must_be_recorded
from ..datasets.read import read
from ..fit import load
from ..models.registry import build
from ..motion_model import MotionModel
from ..scores.baseline import score_beside_hold
from ..scores.metrics import as_dict, score
from .fit_output import motion_errors_table
from .options import columns_option, json_option
from .output import console, errors_table, print_json


@click.command(name="validate")
@click.argument("fit_file", metavar="FIT", type=click.Path())
@click.argument("files", nargs=-1, required=True, metavar="RECORDING...", type=click.Path())
@columns_option
@json_option
def validate(fit_file: str, files: Sequence[str], columns: str, as_json: bool) -> None:
    """Score FIT on each RECORDING: over horizons and in free run, or under every protocol of models with memory.

    Equations of motion are set beside what holding the last reading would do.

    \b
    greybox validate run/fit.json lap7.csv lap8.csv --columns roboracer
    """
    model = load(fit_file, build).model
    recordings = {file: read(file, columns) for file in files}
    must_be_recorded(model, list(recordings.values()))
    if not isinstance(model, MotionModel):
        metrics = {file: as_dict(score(model, recording)) for file, recording in recordings.items()}
        if as_json:
            print_json({"model": model.name, "metrics": metrics})
        else:
            console().print(errors_table(metrics))
        return
    both = {file: score_beside_hold(model, recording) for file, recording in recordings.items()}
    own, held = ({file: as_dict(scores[k]) for file, scores in both.items()} for k in (0, 1))
    if as_json:
        print_json({"model": model.name, "metrics": own, "last_reading_held": held})
    else:
        console().print(motion_errors_table(own, beside=held))
