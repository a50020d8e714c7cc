"""Many structures of one model with memory, each fitted and cross-validated, to choose one by more than its error.

Source of the criterion and of the grids: Mungiello et al., "Vehicle dynamics learning from physics priors with
model-structured neural networks", Sec. III and Fig. 7. The paper uses Akaike's criterion on the validation data, which
counts every reading as independent; added here are the criterion on the training data with an effective number of
independent readings, and blocked cross-validation.
"""

from __future__ import annotations

import itertools
import json
import math
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd
import scipy.linalg as la
from threadpoolctl import threadpool_limits

from ..base.errors import BadInput, must_be_whole
from ..base.processes import side_by_side
from ..base.shorthands import Array
from ..base.statistics import correlation_time
from ..datasets.recording import Recording
from ..engine.shooting import Problem
from ..engine.solvers.gauss_newton import Status, gauss_newton
from ..engine.trace import Trace
from ..models.memory_model import MemoryModel
from ..models.model import must_be
from ..models.registry import prepared
from .crossvalidation import FOLDS, WORST, blocks, choose_strengths
from .how import Say, above_zero, quiet
from .scores.memory import aic, errors, predictions
from .scores.metrics import Error
from .scores.verdict import doubted
from .steps import MOST_STEPS, TOLERANCE, fit_briefly

MOST_CELLS = 10_000
"""Largest number of fits in a grid, against slips of the pen."""
FINGERPRINT, STRENGTHS_USED = "data", "strengths"
"""Columns that identify a row's data, and hold the strengths of the priors."""


@dataclass(frozen=True)
class Grid:
    """Result of a grid.

    Attributes
    ----------
    table : a row per structure.
    names : the settings that were varied.
    chosen, aic_best : rows: by the one-standard-error rule on cross-validation; of least AIC.
    interrupted : whether it was stopped before its end.
    doubts : sentences on why the recordings may be unreliable, to be shown first.
    """

    table: pd.DataFrame
    names: tuple[str, ...]
    chosen: Mapping[str, Any]
    aic_best: Mapping[str, Any]
    interrupted: bool
    doubts: tuple[str, ...] = ()

    def as_dict(self) -> dict[str, Any]:
        """The result as plain data."""
        return {
            "doubts": list(self.doubts),
            "fits": len(self.table),
            "cpu_seconds": float(self.table["cpu_seconds"].sum()),
            "chosen": dict(self.chosen),
            "aic_best": dict(self.aic_best),
            "interrupted": self.interrupted,
            "table": json.loads(self.table.to_json(orient="records", double_precision=12)),
        }


def cells(varied: Mapping[str, Sequence[Any]]) -> list[dict[str, Any]]:
    """All combinations of values, the last setting varying first."""
    count = math.prod(map(len, varied.values()))
    if not 0 < count <= MOST_CELLS:
        raise BadInput(
            f"The settings give {count} structures; a grid has 1 to {MOST_CELLS}. Vary other settings (‹settings›)."
        )
    return [dict(zip(varied, item, strict=True)) for item in itertools.product(*varied.values())]


def fit_grid(
    name: str,
    train: Recording,
    varied: Mapping[str, Sequence[Any]],
    *,
    settings: Mapping[str, Any] | None = None,
    validate: Recording | None = None,
    strength: float | None = None,
    jobs: int = 1,
    done: pd.DataFrame | None = None,
    say: Say = quiet,
    keep: Callable[[pd.DataFrame], None] | None = None,
) -> Grid:
    """Fit every structure of a grid.

    Parameters
    ----------
    name : name of a model with memory that is fitted in one step.
    train : training data.
    varied : setting -> its values.
    settings : the other settings.
    validate : recording to score, and to compute the published AIC on; the training data if None.
    strength : strength of the priors; None cross-validates it once, on the structure that `settings` alone give.
    jobs : number of processes.
    done : rows of an earlier run to keep.
    say : receives progress.
    keep : called with the table after each new row.

    Raises
    ------
    BadInput : a setting cannot be used, the model is of another kind, or `done` is of other data.
    """
    if strength is not None and not above_zero(strength):
        raise BadInput(f"‹strength›: a factor above zero is needed, or None, not {strength!r:.40}.")
    must_be_whole(jobs, "jobs", 1)
    base = dict(settings or {})
    train.must_run()
    several = cells(varied)
    models = [_model(name, train, {**base, **cell}) for cell in several]  # raises on bad settings before the work
    data = fingerprint(name, train, validate, base)
    rows = _kept(done, data, several)
    strengths = _strengths(name, train, base, strength, rows, say)
    doubts = _doubts(models[0], train, validate)
    for doubt in doubts:
        say(doubt)
    missing = [k for k, cell in enumerate(several) if _key(cell) not in rows]
    if len(missing) < len(several):
        say(f"{len(several) - len(missing)} of {len(several)} structures were computed earlier")

    def work(number: int) -> dict[str, Any]:
        with threadpool_limits(1):
            return _row(models[missing[number]], several[missing[number]], train, validate, strengths)

    def report(number: int, row: dict[str, Any]) -> bool:
        cell = several[missing[number]]
        rows[_key(cell)] = row | {FINGERPRINT: data, STRENGTHS_USED: json.dumps(strengths)}
        words = ", ".join(f"{n}={v}" for n, v in cell.items())
        say(
            f"{name} {words}: {row['parameters']} parameters, "
            f"cross-validated error {100 * row['cv_error']:.4g} % of the readings' sd"
        )
        if keep is not None:
            keep(_table(rows, several))
        return True

    interrupted = False
    if missing:
        try:
            interrupted = side_by_side(work, len(missing), jobs, report).interrupted
        except KeyboardInterrupt:
            interrupted = True
    table = _table(rows, several)
    if not len(table):
        raise KeyboardInterrupt
    return Grid(table, tuple(varied), _plain(one_standard_error(table)), _plain(least_aic(table)), interrupted, doubts)


def _doubts(model: MemoryModel, train: Recording, validate: Recording | None) -> tuple[str, ...]:
    result = doubted(model, [train] if validate is None else [train, validate])
    if validate is None or fingerprint("", train, None, {}) != fingerprint("", validate, None, {}):
        return result
    return (*result, f"{validate.name} is the training data: nothing was held out.")


def one_standard_error(table: pd.DataFrame) -> pd.Series[Any]:
    """The structure with the fewest parameters whose cross-validated error is within a standard error of the least."""
    usable = _finite(table, "cv_error")
    best = usable.iloc[int(np.argmin(usable["cv_error"]))]
    near = usable[usable["cv_error"] <= best["cv_error"] + np.nan_to_num(best["cv_se"])]
    fewest: pd.DataFrame = near[near["parameters"] == near["parameters"].min()]
    return fewest.iloc[int(np.argmin(fewest["cv_error"]))]


def fingerprint(name: str, train: Recording, validate: Recording | None, settings: Mapping[str, Any]) -> str:
    """Text that distinguishes grids of different data or models."""
    part = [f"{one.source.sha256}{one.source.between}{one.source.where}:{len(one)}" for one in (train, validate) if one]
    return json.dumps([name, *part, settings], sort_keys=True, default=list)


def least_aic(table: pd.DataFrame) -> pd.Series[Any]:
    """The structure of least AIC. Raises `BadInput` where none has one."""
    usable = _finite(table, "aic")
    return usable.iloc[int(np.argmin(usable["aic"]))]


def _finite(table: pd.DataFrame, column: str) -> pd.DataFrame:
    usable: pd.DataFrame = table[np.isfinite(table[column])]
    if usable.empty:
        raise BadInput(
            "No structure has a finite error to compare: does the vehicle move in this recording? Check "
            "it with greybox data check."
        )
    return usable


def _plain(row: pd.Series[Any]) -> dict[str, Any]:
    plain = {str(n): v.item() if hasattr(v, "item") else v for n, v in row.items()}
    return {n: v for n, v in plain.items() if n not in (FINGERPRINT, STRENGTHS_USED)}


def _key(cell: Mapping[str, Any]) -> str:
    return json.dumps(cell, sort_keys=True)


def _kept(done: pd.DataFrame | None, data: str, several: Sequence[Mapping[str, Any]]) -> dict[str, dict[str, Any]]:
    if done is None or not len(done):
        return {}
    names = list(several[0])
    if not {*names, FINGERPRINT, STRENGTHS_USED, "cv_error"} <= set(done.columns) or set(done[FINGERPRINT]) != {data}:
        raise BadInput(
            "The existing file holds a grid of other data, another model or other settings; name another place (‹out›)."
        )
    keys = {_key(cell) for cell in several}
    rows = {}
    for _, row in done.iterrows():
        stored = {str(n): v.item() if hasattr(v, "item") else v for n, v in row.items()}
        key = _key({n: stored[n] for n in names})
        if key in keys:
            rows[key] = stored
    return rows


def _table(rows: Mapping[str, Mapping[str, Any]], several: Sequence[Mapping[str, Any]]) -> pd.DataFrame:
    return pd.DataFrame([rows[_key(cell)] for cell in several if _key(cell) in rows])


def _model(name: str, train: Recording, settings: Mapping[str, Any]) -> MemoryModel:
    none = f"A grid is for models with memory fitted in one step, such as msnn_lat; {name} is not one of them."
    model = must_be(MemoryModel, prepared(name, train, settings), none)
    if model.parts:
        raise BadInput(none)
    return model


def _strengths(
    name: str,
    train: Recording,
    base: Mapping[str, Any],
    strength: float | None,
    rows: Mapping[str, Mapping[str, Any]],
    say: Say,
) -> dict[str, float]:
    if rows:
        return dict(json.loads(next(iter(rows.values()))[STRENGTHS_USED]))
    model = _model(name, train, base)
    named = sorted({p.prior.strength for p in model.parameters if p.prior is not None and p.prior.strength})
    if strength is not None:
        return dict.fromkeys(named, strength)
    trace = Trace(model)
    with threadpool_limits(1):
        noise, start, _ = fit_briefly(trace, [train])
        return choose_strengths(trace, [train], noise, start, say).strengths


def _row(
    model: MemoryModel,
    cell: Mapping[str, Any],
    train: Recording,
    validate: Recording | None,
    strengths: Mapping[str, float],
) -> dict[str, Any]:
    clock = time.process_time()
    trace = Trace(model)
    noise, start, laid = fit_briefly(trace, [train])
    problem = laid.counted(noise=noise, strengths=strengths)
    solution = gauss_newton(problem, start, max_steps=MOST_STEPS, tolerance=TOLERANCE)
    if solution.status is Status.INTERRUPTED:
        raise KeyboardInterrupt
    fitted = model.with_values(problem.shared(solution.x))
    spread = np.array([max(float(np.nanstd(train[output])), 1e-9) for output in model.outputs])
    cv_error, cv_se = cross_validated(problem, solution.x, noise / spread)
    spent = time.process_time() - clock
    row: dict[str, Any] = {**cell, "parameters": fitted.size, "cpu_seconds": spent}
    row |= {"steps": solution.steps, "status": solution.status.value, "cv_error": cv_error, "cv_se": cv_se}
    for role, recording in (("train", train), ("valid", validate)):
        if recording is None:
            continue
        for protocol in ("published", "honest"):
            prediction = predictions(fitted, recording, protocol, trace=trace)
            output_errors: dict[str, Error] = errors(fitted, prediction, protocol)
            for output, item in output_errors.items():
                row[f"{role}_{protocol}_{output}"] = item.rmse
            residuals = prediction.predicted - prediction.measured
            if protocol == "published":
                row["aic"] = sum(aic(item, fitted.size) for item in residuals.T)
            elif role == "train":
                effective = len(residuals) / correlation_time(residuals / noise)
                row["aic_effective"] = sum(aic(item, fitted.size, effective=effective) for item in residuals.T)
    return row


def cross_validated(problem: Problem, x: Array, scale: Array) -> tuple[float, float]:
    """Cross-validated error of a fit as a share of the readings' spread, and its standard error over folds.

    A fold's fit is one Gauss-Newton step from the fit to all data, without the fold's rows: the refit to first order.
    Errors are clipped at `WORST`, as in choosing strengths.
    """
    prior_curvature = (problem.R.T @ problem.R).toarray()
    prior_gradient = problem.R.T @ problem.prior_residuals(x)
    linearised = list(problem.residuals(x, []))
    free = problem.free
    squares = []
    for kept, held_out in blocks(problem, FOLDS):
        H, g = prior_curvature.copy(), np.asarray(prior_gradient).copy()
        for run, rows, (r, J), index in zip(problem.runs, kept, linearised, problem.layout.index, strict=True):
            used = rows[run.predicted] > 0
            flat = J[used].reshape(-1, J.shape[2])
            H[np.ix_(index, index)] += flat.T @ flat
            g[index] += flat.T @ r[used].ravel()
        step = np.zeros_like(x)
        ridge = 1e-9 * np.diag(np.diag(H)[free] + 1e-12)
        step[free] = -la.solve(H[np.ix_(free, free)] + ridge, g[free], assume_a="pos")
        total = count = 0.0
        for run, rows, (r, J), index in zip(problem.runs, held_out, linearised, problem.layout.index, strict=True):
            used = rows[run.predicted] > 0
            error = np.minimum(np.abs(r[used] + J[used] @ step[index]), WORST)
            total, count = total + float(np.sum((scale * error) ** 2)), count + error.size
        squares.append(total / max(count, 1.0))
    if len(squares) < 2:
        raise BadInput("The training data are too short for cross-validation: record more.")
    by_fold = np.array(squares)
    least = float(np.sqrt(np.mean(by_fold)))
    return least, float(np.std(by_fold, ddof=1) / np.sqrt(len(by_fold)) / (2 * least)) if least > 0 else 0.0


def values_of(text: str) -> Iterator[Any]:
    """Values of a setting in a text: 5,6,7 or 1:4 (both ends included) or a single one.

    Raises
    ------
    BadInput : the text cannot be parsed.
    """
    for piece in text.split(","):
        low, colon, high = piece.partition(":")
        try:
            if colon:
                first, last = int(low), int(high)
                if not 0 <= last - first < MOST_CELLS:
                    raise BadInput(
                        f"‹settings›: {piece}: a range goes from small to large and holds {MOST_CELLS} values at most."
                    )
                yield from range(first, last + 1)
            else:
                yield json.loads(piece)
        except ValueError as error:
            raise BadInput(f"‹settings›: {piece!r} must be a number, true, false or a range such as 1:4.") from error
