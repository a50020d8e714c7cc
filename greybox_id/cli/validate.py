"""`greybox validate`: errors of a fit on other recordings."""

from __future__ import annotations

from collections.abc import Sequence

from ..api.fitting import load
from ..api.predictions import validation
from ..base.numbers import counted
from .options import COLUMNS, FILE, JSON_AND_OWN, argument, command, read_part
from .output import end_by, print_json, show, working


@command("validate")
def validate(
    fit_file: str = argument("FIT", type=FILE),
    files: Sequence[str] = argument("RECORDING...", type=FILE, required=True),
    columns: str = COLUMNS,
    as_json: bool = JSON_AND_OWN,
) -> None:
    """Score FIT on each RECORDING: errors of predictions over several horizons and in free run.

    If the model consists of equations of motion, the errors are compared with those of persistence (the first
    reading is held constant) and of the unfitted model. Fits of msnn_... and gnn are scored one sample ahead, in
    closed loop, and, as in the papers on these networks, by the mean over batches of 100 windows. Exit code 3: the
    fit is not usable on these recordings.

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
