"""What predictions are held against: readings, how much each counts, and how residuals in the tails count."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ...base.shorthands import Array, Mask
from ...models.motion_model import MotionModel
from .lanes import Interval
from .runs import MotionRun

CRAWLING = 0.1
"""Where equations hold in less than this share of an output's readings, the recording is of nothing else: all count."""


@dataclass(frozen=True)
class Targets:
    """Readings of all rows of all intervals, one interval after the other.

    Attributes
    ----------
    reading : (N, outputs), zero where there is none.
    weight : (N, outputs) square root of how much each counts, over its standard deviation; zero where there is none.
    robust : residuals beyond so many standard deviations count linearly (Huber); None for least squares throughout.
    """

    reading: Array
    weight: Array
    robust: float | None

    def errors(self, y: Array, taken: Mask) -> Array:
        """(N, outputs) prediction minus reading, in the outputs' units; NaN where there is none."""
        return np.where((self.weight > 0) & taken, y - self.reading, np.nan)


def targets(
    runs: Sequence[MotionRun],
    intervals: Sequence[Interval],
    noise: Array,
    robust: float | None = None,
    keep: Sequence[Array] | None = None,
) -> Targets:
    """What the intervals' predictions are held against.

    Parameters
    ----------
    runs : the recordings' runs.
    intervals : what is predicted.
    noise : (outputs,) standard deviation that one residual counts as.
    robust : as of `Targets`.
    keep : per run, (n,) weight of each row or (n, outputs) of each reading, 0 leaves it out; None keeps all.
    """
    reading = np.vstack([runs[i.run].measured[i.start : i.stop] for i in intervals])
    weight = np.where(np.isfinite(reading), 1.0 / noise, 0.0)
    if keep is not None:
        kept = [np.asarray(keep[i.run][i.start : i.stop], dtype=float) for i in intervals]
        weight = weight * np.sqrt(np.vstack([item.reshape(len(item), -1) for item in kept]))
    return Targets(np.where(np.isfinite(reading), reading, 0.0), weight, robust)


def where_valid(model: MotionModel, runs: Sequence[MotionRun]) -> list[Array]:
    """Per run, (n, outputs): 1 where the model's equations hold, or the signal that tells is not read; 0 elsewhere."""
    result = [np.ones(run.measured.shape) for run in runs]
    for item in model.validity:
        holds = []
        for run in runs:
            names, table = (model.inputs, run.inputs) if item.signal in model.inputs else (model.outputs, run.measured)
            holds.append(~(np.abs(table[:, names.index(item.signal)]) < item.least))
        for k, output in enumerate(model.outputs):
            read = [np.isfinite(run.measured[:, k]) for run in runs]
            left, all_there = sum(np.sum(a & b) for a, b in zip(read, holds, strict=True)), sum(map(np.sum, read))
            if output in item.outputs and left >= CRAWLING * all_there:
                for one, there in zip(result, holds, strict=True):
                    one[:, k] *= there
    return result
