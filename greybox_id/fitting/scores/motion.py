"""Predictions of equations of motion, and their errors: over horizons from the readings of every row, and in free run
from the first row of each run to its end; for comparison, those of persistence.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from ...base.errors import BadInput
from ...base.shorthands import Array
from ...base.signals import SIGNALS
from ...datasets.recording import Recording
from ...engine.motion.schedule import MotionRun
from ...engine.motion.simulator import Predictor, Simulator
from ...engine.simulation import Prediction
from ...models.motion_model import MotionModel
from .metrics import (
    FREE_RUN,
    HORIZONS,
    Error,
    Scores,
    ahead,
    assumed,
    must_suit,
    predict,
    predicted_how,
    prediction_errors,
    score,
    score_with_persistence,
    simulate,
)


@simulate.register(MotionModel)
def _simulated(model: MotionModel, recording: Recording, start: Mapping[str, float] | None = None) -> Prediction:
    return in_order(Predictor(Simulator(model), recording, model.values, start or {}).free_run())


@predict.register(MotionModel)
def _predicted(
    model: MotionModel, recording: Recording, horizon: float | None = None, *, open_loop: bool = False
) -> Prediction:
    if open_loop:
        raise BadInput(
            f"‹open_loop› is for models with memory; {model.name} is a model with states. Omit it, and use ‹horizon› "
            "to say how far ahead to predict."
        )
    predictor = Predictor(Simulator(model), recording, model.values)
    if horizon is None:
        return in_order(predictor.free_run())
    must_suit(horizon, [recording])
    return in_order(predictor.ahead(horizon))


@predicted_how.register(MotionModel)
def _predicted_how(model: MotionModel, horizon: float | None, open_loop: bool) -> tuple[str, dict[str, Any]]:
    return "free run" if horizon is None else ahead(horizon), {"horizon": horizon}


def in_order(prediction: Prediction) -> Prediction:
    """Predictions run by run, row by row. Raises `BadInput` if there are none."""
    if len(prediction.rows) == 0:
        raise BadInput("There is no row to predict from: no row has readings of all measured states.")
    return prediction.taken(np.lexsort((prediction.rows, prediction.run)))


@assumed.register(MotionModel)
def _assumed(model: MotionModel, recording: Recording, start: Mapping[str, float]) -> list[str]:
    result = []
    for state in model.states:
        if (
            state.name in SIGNALS
            and not recording.has(state.name)
            and state.name not in start
            and not callable(state.start)
        ):
            result.append(
                f"{recording.name} does not hold {state.name}, so it starts at {state.start:g} {state.unit} unless "
                "you state its start."
            )
    return result


@score.register(MotionModel)
def _score(model: MotionModel, recording: Recording) -> Scores:
    return score_motion(Simulator(model), recording, model.values)


def score_motion(
    simulator: Simulator, recording: Recording, p: Array, horizons: Sequence[float] = HORIZONS
) -> dict[str, dict[str, Error]]:
    """Errors of every recorded output over every horizon and in free run; horizons beyond all runs are dropped."""
    predictor = Predictor(simulator, recording, p)
    result = dict(zip(map(ahead, horizons), predictor.each_ahead(horizons), strict=True))
    result[FREE_RUN] = predictor.free_run()
    scores: dict[str, dict[str, Error]] = {}
    for name, prediction in result.items():
        horizon = None if name == FREE_RUN else next(horizon for horizon in horizons if ahead(horizon) == name)
        value = prediction_errors(simulator.trace.model.outputs, prediction, recording.sample_time, horizon)
        if value:
            scores[name] = value
    return scores


@score_with_persistence.register(MotionModel)
def _score_with_persistence(
    model: MotionModel, recording: Recording, horizons: Sequence[float] = HORIZONS
) -> tuple[Scores, Scores]:
    """In free run, persistence keeps the reading of the run's first row."""
    predictor = Predictor(Simulator(model), recording, model.values)
    scores_of_model: dict[str, Mapping[str, Error]] = {}
    scores_of_hold: dict[str, Mapping[str, Error]] = {}
    results = [*predictor.each_ahead(horizons), predictor.free_run()]
    for horizon, result in zip((*horizons, None), results, strict=True):
        name = FREE_RUN if horizon is None else ahead(horizon)
        for scores, predictions in (
            (scores_of_model, result),
            (scores_of_hold, persisted(result, predictor.runs, horizon)),
        ):
            output_errors = prediction_errors(model.outputs, predictions, recording.sample_time, horizon)
            if output_errors:
                scores[name] = output_errors
    return scores_of_model, scores_of_hold


def persisted(predictions: Prediction, runs: Sequence[MotionRun], horizon: float | None) -> Prediction:
    """Persistence for the same rows: the last reading a horizon before, in free run the run's first."""
    persistence = np.full(predictions.predicted.shape, np.nan)
    order = np.argsort(predictions.run, kind="stable")
    edges = np.searchsorted(predictions.run[order], np.arange(len(runs) + 1))
    for run, begin, end in zip(runs, edges[:-1], edges[1:], strict=True):
        rows_of_run = order[begin:end]
        last = _last_read(run.measured)
        if horizon is None:
            if len(rows_of_run):
                persistence[rows_of_run] = last[predictions.rows[rows_of_run[0]] - run.rows.start]
        else:
            persistence[rows_of_run] = last[
                predictions.rows[rows_of_run] - run.rows.start - max(1, round(horizon / run.sample_time))
            ]
    return Prediction(predictions.rows, persistence, predictions.measured, predictions.run)


def _last_read(measured: Array) -> Array:
    """Every output's last reading up to each row; NaN before the first."""
    rows = np.where(np.isfinite(measured), np.arange(len(measured))[:, None], -1)
    last = np.maximum.accumulate(rows, axis=0)
    return np.where(last >= 0, np.take_along_axis(measured, np.maximum(last, 0), axis=0), np.nan)
