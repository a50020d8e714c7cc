"""Additional text on a fit of equations of motion: horizon, starts, errors by horizon, covariance."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any

import numpy as np
from rich.console import RenderableType
from rich.table import Table

from ...base.numbers import counted, number, pretty_unit, with_sd
from ...base.signals import unit_of
from ...fitting.fit import Fit
from ...fitting.provenance import DataRecord, Stage
from ...fitting.scores.metrics import FREE_RUN
from ...fitting.uncertainty.identifiability import combination_sentences
from ...models.motion_model import MotionModel
from .fit import error_parts, more_data, solver_lines, stage_lines
from .screen import plain_table

SAME = 0.01
"""Relative difference of objectives below which starts count as having reached the best one."""


@stage_lines.register(MotionModel)
def _stage(model: MotionModel, result: Fit, stage: Stage) -> Iterator[str]:
    free = sum(p.size for p in model.parameters if not p.fixed)
    horizon = result.how.get("horizon")
    over = "fitted to whole runs" if horizon is None else f"fitted {horizon:g} s ahead"
    yield from solver_lines(stage, f"{counted(free, 'free parameter')}, {over}")
    if len(stage.starts) > 1:
        yield f"starts   {_starts(stage.starts)}"


@error_parts.register(MotionModel)
def _errors(model: MotionModel, result: Fit) -> Iterator[RenderableType]:
    noise = result.stages[-1].noise if result.stages else {}
    yield motion_errors_table(result.metrics, noise, _held_out(result.data), unit_of=model.unit)


@more_data.register(MotionModel)
def _data(model: MotionModel, result: Fit, body: Mapping[str, Any]) -> dict[str, Any]:
    covariance = body["covariance"]
    return {
        "parameters": body["parameters"],
        "free": [p.name for p in model.parameters if not p.fixed],
        "combinations": body["combinations"],
        "covariance": covariance,
        "correlation": None if covariance is None else _correlation(covariance),
        "open": combination_sentences(result),
        "how": body["how"],
        "noise": dict(result.stages[-1].noise),
    }


def motion_errors_table(
    metrics: Mapping[str, Any],
    noise: Mapping[str, float] | None = None,
    names: Mapping[str, str] | None = None,
    beside: Mapping[str, Any] | None = None,
    unit_of: Callable[[str], str] = unit_of,
) -> Table:
    """Errors by horizon: a row per output of each recording, each error with its standard error.

    Parameters
    ----------
    metrics : role or recording -> protocol -> output -> error.
    noise : output -> standard deviation of the residuals, for a last column.
    names : role -> name.
    beside : errors of persistence in the layout of `metrics`; shown below each row.
    unit_of : output -> its SI unit.
    """
    protocols = list(dict.fromkeys(p for of_role in metrics.values() for p in of_role))
    protocols.sort(key=lambda name: name == FREE_RUN)
    shown = [*(name.removesuffix(" ahead") for name in protocols), *(["residual sd"] if noise else [])]
    table = plain_table("RMSE", *shown, right=shown)
    for role, of_role in metrics.items():
        table.add_row((names or {}).get(role, role), style="dim")
        for output in dict.fromkeys(o for errors in of_role.values() for o in errors):
            cells = [_error(of_role.get(p, {}).get(output)) for p in protocols]
            last = [number(noise[output], 2) if output in noise else ""] if noise else []
            table.add_row(f"{output} [{pretty_unit(unit_of(output))}]", *cells, *last)
            held = (beside or {}).get(role, {})
            if held:
                cells = [_error(held.get(p, {}).get(output)) for p in protocols]
                table.add_row("  persistence", *cells, style="dim")
    return table


def _held_out(data: Sequence[DataRecord]) -> dict[str, str]:
    """Role -> heading in an error table."""
    names = {role: [record.name for record in data if record.role == role] for role in ("train", "validate")}
    trained = ", ".join(names["train"]) if len(names["train"]) < 4 else counted(len(names["train"]), "recording")
    return {"train": f"train ({trained})", "validate": f"held out ({', '.join(names['validate'])})"}


def _starts(objectives: Sequence[float]) -> str:
    """Comparison of the objectives that the starts reached."""
    best, worst = min(objectives), max(objectives)
    alike = sum(objective <= best * (1 + SAME) for objective in objectives)
    if alike == len(objectives):
        return f"all {alike} starts ended at the same objective, {number(best, 4)}"
    spread = (
        f"the others at objectives up to {number(worst, 4)}"
        if len(objectives) - alike > 1
        else f"the other at {number(worst, 4)}"
    )
    return f"{alike} of {len(objectives)} starts ended at the best objective, {number(best, 4)}; {spread}"


def _error(error: Mapping[str, float] | None) -> str:
    if error is None:
        return "–"
    if error.get("diverges") or not math.isfinite(error["rmse"] if error["rmse"] is not None else math.inf):
        return "diverges"
    return with_sd(error["rmse"], error["rmse_sd"])


def _correlation(covariance: Mapping[str, Any]) -> dict[str, Any]:
    """Correlations from a covariance."""
    matrix = np.asarray(covariance["matrix"], dtype=float).reshape(len(covariance["names"]), -1)
    sd = np.sqrt(np.diag(matrix))
    with np.errstate(divide="ignore", invalid="ignore"):
        return {"names": covariance["names"], "matrix": (matrix / np.outer(sd, sd)).tolist()}
