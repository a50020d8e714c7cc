"""What any fit must beat: the persistence, and the model as it was before it was fitted."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from ..engine.motion.prediction import Predictions, Predictor
from ..engine.motion.runs import MotionRun
from ..engine.motion.simulator import Simulator
from ..fit import Fit
from ..motion_model import MotionModel
from ..parameter import Array
from ..recording import Recording
from .metrics import FREE_RUN, HORIZONS, Error, ahead, prediction_errors, score_motion

Scores = Mapping[str, Mapping[str, Error]]


def score_beside_hold(
    model: MotionModel, recording: Recording, horizons: Sequence[float] = HORIZONS
) -> tuple[Scores, Scores]:
    """Errors of a model over every horizon and in free run, and those of holding the reading it started from.

    Both are taken over the same rows. In free run what is held is the reading of the run's first row.
    """
    predictor = Predictor(Simulator(model), recording, model.values)
    own: dict[str, Mapping[str, Error]] = {}
    held: dict[str, Mapping[str, Error]] = {}
    for horizon in (*horizons, None):
        name = FREE_RUN if horizon is None else ahead(horizon)
        found = predictor.free_run() if horizon is None else predictor.ahead(horizon)
        for scores, predictions in ((own, found), (held, hold(found, predictor.runs, horizon))):
            told = prediction_errors(model.outputs, predictions, recording.sample_time, horizon)
            if told:
                scores[name] = told
    return own, held


def unfitted_scores(fit: Fit, recording: Recording) -> Scores:
    """Errors of a fit's model as it was before it was fitted; empty where that was not kept."""
    before = {name: value for name, value in fit.how.get("unfitted", {}).items() if name in fit.model}
    if not isinstance(fit.model, MotionModel) or not before:
        return {}
    model = fit.model.with_parameters(*(fit.model[name].with_value(value) for name, value in before.items()))
    return score_motion(Simulator(model), recording, model.values)


def hold(predictions: Predictions, runs: Sequence[MotionRun], horizon: float | None) -> Predictions:
    """The same rows predicted by the last reading a horizon before, or in free run by the run's first."""
    held = np.full(predictions.predicted.shape, np.nan)
    order = np.argsort(predictions.run, kind="stable")
    edges = np.searchsorted(predictions.run[order], np.arange(len(runs) + 1))
    for run, begin, end in zip(runs, edges[:-1], edges[1:], strict=True):
        own = order[begin:end]
        last = _last_read(run.measured)
        if horizon is None:
            if len(own):
                held[own] = last[predictions.rows[own[0]] - run.rows.start]
        else:
            held[own] = last[predictions.rows[own] - run.rows.start - max(1, round(horizon / run.sample_time))]
    return Predictions(predictions.rows, predictions.run, held, predictions.measured)


def _last_read(measured: Array) -> Array:
    """Every output's last reading up to each row; NaN before the first."""
    rows = np.where(np.isfinite(measured), np.arange(len(measured))[:, None], -1)
    last = np.maximum.accumulate(rows, axis=0)
    return np.where(last >= 0, np.take_along_axis(measured, np.maximum(last, 0), axis=0), np.nan)
