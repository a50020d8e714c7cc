"""`greybox grid`: fits and cross-validation of many structures of one model."""

from __future__ import annotations

from collections.abc import Sequence

from ..models import MODEL_NAMES
from .options import ABOVE_ZERO, COLUMNS, FILE, JOBS, JSON, argument, command, names, option, read_part
from .output import console, print_json, progress, show


@command("grid")
def grid(
    name: str = argument("MODEL", shell_complete=names(MODEL_NAMES)),
    file: str = argument("RECORDING", type=FILE),
    settings: Sequence[str] = option(
        "A setting and its values, such as n_delta=5,6,7 or n_x=1:4 (from 1 to 4); one value holds for all structures.",
        "NAME=VALUES",
        name="--set",
    ),
    columns: str = COLUMNS,
    validate: str | None = option(
        "Held-out recording on which structures are scored and AIC is computed.", "RECORDING", type=FILE
    ),
    strength: float | None = option(
        "Factor on the strength of the priors of the weights (regularisation); default: chosen by cross-validation for "
        "the default structure, and used for all.",
        type=ABOVE_ZERO,
    ),
    jobs: int = JOBS,
    out: str = option(
        "Table of the fits, a .parquet file; an interrupted grid continues from it.", "FILE", default="grid.parquet"
    ),
    as_json: bool = JSON,
) -> None:
    """Fit a network MODEL (msnn_... or gnn) with every combination of settings, and choose one combination.

    It chooses the smallest network whose cross-validated error is within one standard error of the smallest error. The
    network with the smallest AIC is printed as well, because the paper on these networks chooses by AIC. After an
    interruption the same command continues.

    \b
    greybox grid msnn_lat train.csv --columns roboracer --set n_delta=5,6,7 --set n_x=1:4 --validate valid.csv
    """
    from ..api.gridding import grid as fit_grid
    from ..api.gridding import grid_parts, spanned

    varied, fixed = spanned(settings)
    scored = None if validate is None else read_part(validate, columns)
    with progress() as say:
        result = fit_grid(
            name, read_part(file, columns), varied, settings=fixed, validation=scored, strength=strength, jobs=jobs,
            to=out, progress=say,
        )  # fmt: skip
    if as_json:
        print_json(result.as_dict() | {"written": out})
    else:
        show(grid_parts(result))
        console().print(f"\nwritten  {out}")
    if result.interrupted:
        raise SystemExit(130)
