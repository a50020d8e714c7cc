"""Fits of many structures of one model with memory, and their comparison."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import pandas as pd
from rich.console import RenderableType

from ..base.declared import understood
from ..base.errors import BadInput
from ..base.files import ensure_writable, replacing
from ..base.numbers import number, with_sd
from ..datasets.recording import Recording
from ..datasets.result_table import claimed_table
from ..fitting.grid import Grid, fit_grid, values_of
from ..fitting.how import quiet
from ..reports.text.screen import as_text, led, plain_table
from . import given
from .given import Columns


class GridResult(Grid):
    """Result of `gb.grid`: a table with a row per structure, the selected one and the one with the smallest AIC.

    Attributes
    ----------
    table : pandas.DataFrame, a row per structure.
    chosen, aic_best : rows as dictionaries.

    Examples
    --------
    >>> import greybox_id as gb
    >>> train = gb.read(gb.datasets.shipped("racer_train"), columns="roboracer")
    >>> found = gb.grid("msnn_bench_lat", train, {"q": [9, 19]}, strength=1.0)
    >>> found.table["parameters"].tolist()
    [21, 41]
    """

    def summary(self) -> str:
        """The text that `greybox grid` prints."""
        return as_text(grid_parts(self))


@understood
def grid(
    model: str,
    recording: Recording | str | Path,
    varied: Mapping[str, Sequence[Any]],
    *,
    settings: Mapping[str, Any] | None = None,
    validation: Recording | str | Path | None = None,
    strength: float | None = None,
    jobs: int = 1,
    columns: Columns = "canonical",
    to: str | Path | None = None,
    progress: Callable[..., None] | None = None,
) -> GridResult:
    """Fit all structures of a model with memory that are combinations of some settings.

    Parameters
    ----------
    model : its name, such as "msnn_lat".
    recording : training data.
    varied : setting -> values.
    settings : the other settings.
    validation : scored, and used for the published AIC.
    strength : of the priors; None selects it once by cross-validation.
    jobs : number of parallel processes.
    columns : column map for files.
    to : .parquet file of the table, updated after each fit; an existing one is continued.
    progress : called with each line of progress.

    Returns
    -------
    Grid
        `table`, a row per structure; `chosen`, by the one-standard-error rule on cross-validation; `aic_best`;
        `doubts`, sentences on why the recordings may be unreliable.

    Raises
    ------
    BadInput : if a setting cannot be used, or the model is not one with memory that is fitted in one step.

    Examples
    --------
    >>> import greybox_id as gb
    >>> train = gb.read(gb.datasets.shipped("racer_train"), columns="roboracer")
    >>> int(gb.grid("msnn_bench_lat", train, {"q": [9, 19]}, strength=1.0).chosen["q"]) in (9, 19)
    True
    """
    if not isinstance(varied, Mapping) or not varied:
        raise BadInput("varied: settings with their values are needed, such as {'n_delta': [5, 6, 7]}.")
    target = None if to is None else claimed_table(str(to), "a table of a grid", (".parquet",))
    train = given.one_recording(recording, columns)
    scored = None if validation is None else given.one_recording(validation, columns, "validation")
    if target is not None:
        ensure_writable(target.parent)
    result = fit_grid(
        model, train, varied, settings=settings, validate=scored, strength=strength, jobs=jobs, say=progress or quiet,
        done=None if target is None else _kept_table(target), keep=None if target is None else _written_to(target),
    )  # fmt: skip
    return GridResult(result.table, result.names, result.chosen, result.aic_best, result.interrupted, result.doubts)


def spanned(pairs: Sequence[str]) -> tuple[dict[str, list[Any]], dict[str, Any]]:
    """NAME=VALUES pairs as settings that vary and settings that do not."""
    varied: dict[str, list[Any]] = {}
    fixed: dict[str, Any] = {}
    for pair in pairs:
        name, equals, text = pair.partition("=")
        if not equals or not name:
            raise BadInput(f"‹settings›: {pair!r} is not NAME=VALUES.")
        values = list(values_of(text))
        if len(values) > 1:
            varied[name] = values
        else:
            fixed[name] = values[0]
    if not varied:
        raise BadInput("‹settings›: a setting with several values is needed, such as n_delta=5,6,7 or n_x=1:4.")
    return varied, fixed


def _kept_table(target: Path) -> pd.DataFrame | None:
    """The rows of an earlier run; None if there is none."""
    if not target.is_file() or target.stat().st_size == 0:
        return None
    try:
        return pd.read_parquet(target)
    except (OSError, ValueError) as error:
        raise BadInput(f"{target} is damaged ({error}); remove it, or name another place (‹out›).") from error


def _written_to(target: Path) -> Callable[[pd.DataFrame], None]:
    """A function that writes a table to a file atomically."""

    def keep(table: pd.DataFrame) -> None:
        with replacing(target, continued=True) as beside:
            table.to_parquet(beside, index=False)

    return keep


def grid_parts(grid: Grid) -> Iterator[RenderableType]:
    """The text of a grid, part by part."""
    for doubt in grid.doubts:
        yield led("doubt", doubt)
    for word, row in (("chosen", grid.chosen), ("AIC", grid.aic_best)):
        cell = ", ".join(f"{name}={row[name]}" for name in grid.names)
        what = (
            "the smallest network whose cross-validated error is within one standard error of the smallest error"
            if word == "chosen"
            else "the smallest AIC; the paper on these networks chooses by AIC"
        )
        yield led(word, f"{cell} ({row['parameters']} parameters): {what}")
    yield led("took", f"{number(float(grid.table['cpu_seconds'].sum()))} CPU s for {len(grid.table)} fits")
    yield ""
    titles = ("parameters", "cross-validated error, % of the readings' sd", "AIC", "AIC effective")
    table = plain_table(*grid.names, *titles)
    for _, item in grid.table.sort_values("cv_error").head(10).iterrows():
        row = {str(name): value for name, value in item.items()}
        table.add_row(
            *(str(row[name]) for name in grid.names), str(row["parameters"]),
            with_sd(100 * row['cv_error'], 100 * row['cv_se']), f"{row['aic']:.1f}",
            f"{row['aic_effective']:.1f}",
        )  # fmt: skip
    yield table
