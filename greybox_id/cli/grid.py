"""`greybox grid`: many structures of one model, each fitted and cross-validated."""

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
        "A setting and its values: n_delta=5,6,7, n_x=1:4 (1 and 4 included), or one value for all structures.",
        "NAME=VALUES",
        name="--set",
    ),
    columns: str = COLUMNS,
    validate: str | None = option(
        "Recording on which structures are scored and AIC is computed.", "RECORDING", type=FILE
    ),
    strength: float | None = option(
        "Factor on the strength of the priors; default: chosen once by cross-validation, for the default structure.",
        type=ABOVE_ZERO,
    ),
    jobs: int = JOBS,
    out: str = option("A .parquet file; an interrupted grid continues from it.", "FILE", default="grid.parquet"),
    as_json: bool = JSON,
) -> None:
    """Fit every structure of MODEL that the settings span, and choose one.

    The table of fits is written after each fit; after an interruption the same command continues it. Of the structures
    whose cross-validated error is within one standard error of the least, the one with the fewest parameters is chosen.
    The structure with the least AIC, the criterion of the paper, is printed as well.

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
