"""Errors over fixed horizons, from measured states, before and after."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ..engine.motion.prediction import Predictions, Predictor
from ..engine.motion.simulator import Simulator
from ..motion_model import MotionModel
from ..parameter import Array
from ..recording import Recording
from ..signals import unit_of
from .gap import Errors

HORIZONS = (0.1, 0.5, 2.0, None)
"""s; None is the free run."""


def by_horizon(
    before: MotionModel, after: MotionModel, recordings: Sequence[Recording], sd: Array
) -> tuple[Errors, ...]:
    """Root mean square errors per channel and horizon.

    Parameters
    ----------
    before, after : models, as they stand: tolerances are not refitted here.
    recordings : what is predicted.
    sd : (channels,) noise, below which no prediction can be.
    """
    sums = {}
    for which, model in enumerate((before, after)):
        simulator = Simulator(model)
        predictors = [Predictor(simulator, own, model.values) for own in recordings]
        for horizon in HORIZONS:
            found = [own.free_run() if horizon is None else own.ahead(horizon) for own in predictors]
            sums[which, horizon] = _mean_squares(found, len(model.outputs))
    errors = []
    for c, channel in enumerate(before.outputs):
        for horizon in HORIZONS:
            first, then = (float(np.sqrt(sums[k, horizon][c])) for k in (0, 1))
            if np.isfinite(first) and np.isfinite(then):
                errors.append(Errors(channel, unit_of(channel), horizon, first, then, float(sd[c])))
    return tuple(errors)


def _mean_squares(found: Sequence[Predictions], outputs: int) -> Array:
    """(outputs,) mean squares over all recordings, NaN where nothing was read."""
    total, count = np.zeros(outputs), np.zeros(outputs)
    for own in found:
        e = own.predicted - own.measured
        read = np.isfinite(own.measured) & ~np.isnan(own.predicted)
        total += np.sum(np.where(read, e, 0.0) ** 2, axis=0)
        count += np.sum(read, axis=0)
    return np.where(count > 0, total / np.maximum(count, 1), np.nan)
