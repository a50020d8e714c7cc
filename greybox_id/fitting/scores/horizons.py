"""Errors over fixed horizons, from measured states, of a model before and after a change."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ...base.shorthands import Array
from ...base.signals import unit_of
from ...datasets.recording import Recording
from ...engine.motion.simulator import Predictor, Simulator
from ...engine.simulation import Diagnosed, Prediction
from ...models.memory_model import MemoryModel
from .memory import predictions
from .metrics import ASTRAY

Squares = dict[float | None, Array]
"""Horizon -> (outputs,) mean squares of errors."""
HORIZONS = (0.1, 0.5, 2.0, None)
"""s; None is the free run. Models with memory that feed their outputs back are scored one sample ahead, too, from
windows of readings, and at no horizon in between."""
OVERLAPPING = 10
"""Largest number of windows that a row lies in: within a tenth of a horizon their errors are alike."""


@dataclass(frozen=True)
class Errors:
    """Errors of one channel at one horizon, root mean squares in the channel's unit.

    Attributes
    ----------
    channel, unit : predicted output and its unit.
    horizon : s predicted from measured states; None for the free run.
    before, after : of the original model, and with the applied effects; infinite if predictions diverge.
    floor : standard deviation of the noise.
    """

    channel: str
    unit: str
    horizon: float | None
    before: float
    after: float
    floor: float


def by_horizon(before: Diagnosed, after: Diagnosed, recordings: Sequence[Recording], sd: Array) -> tuple[Errors, ...]:
    """Root mean square errors per channel and horizon.

    Parameters
    ----------
    before, after : models at their values; tolerances are not refitted here.
    recordings : the predicted recordings.
    sd : (channels,) noise, a lower limit of all errors.
    """
    return between(before.outputs, mean_squares(before, recordings), mean_squares(after, recordings), sd)


def between(outputs: Sequence[str], first: Squares, then: Squares, sd: Array) -> tuple[Errors, ...]:
    """As `by_horizon`, from the results of `mean_squares` for both models."""
    errors = []
    for c, channel in enumerate(outputs):
        for horizon, item in first.items():
            was, now = float(np.sqrt(item[c])), float(np.sqrt(then[horizon][c]))
            if not (np.isnan(was) or np.isnan(now)):
                errors.append(Errors(channel, unit_of(channel), horizon, was, now, float(sd[c])))
    return tuple(errors)


def mean_squares(model: Diagnosed, recordings: Sequence[Recording], simulator: Simulator | None = None) -> Squares:
    """Horizon -> (outputs,) mean squares of errors; `simulator`: one of a model with the same equations, if any."""
    result: dict[float | None, list[Prediction]] = {}
    if isinstance(model, MemoryModel):
        if model.feedback is not None:
            result[model.sample_time] = [predictions(model, recording, "honest") for recording in recordings]
        result[None] = [predictions(model, recording, "closed_loop") for recording in recordings]
    else:
        simulator = Simulator(model) if simulator is None else simulator.of(model)
        predictors = [Predictor(simulator, recording, model.values) for recording in recordings]
        for horizon in HORIZONS:
            result[horizon] = [
                predictor.free_run() if horizon is None else predictor.ahead(horizon, OVERLAPPING)
                for predictor in predictors
            ]
    return {horizon: _mean_squares(item, len(model.outputs)) for horizon, item in result.items()}


def _mean_squares(result: Sequence[Prediction], outputs: int) -> Array:
    """(outputs,) mean squares over all recordings, NaN without readings, infinite if a prediction diverges."""
    total, count = np.zeros(outputs), np.zeros(outputs)
    for item in result:
        e = item.predicted - item.measured
        read = np.isfinite(item.measured) & ~np.isnan(item.predicted)
        total += np.sum(np.where(read, e, 0.0) ** 2, axis=0)
        total[[c for c in range(outputs) if diverges(e[read[:, c], c], item.measured[read[:, c], c])]] = np.inf
        count += np.sum(read, axis=0)
    return np.where(count > 0, total / np.maximum(count, 1), np.nan)


def diverges(e: Array, measured: Array) -> bool:
    """Whether an output's predictions diverge: an error, (n,), exceeds `ASTRAY` times the range of readings."""
    return len(e) > 0 and bool(np.max(np.abs(e)) > ASTRAY * (np.ptp(measured) or np.inf))
