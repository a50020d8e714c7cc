"""Predictions of hybrid models: free runs."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from ...base.errors import BadInput
from ...datasets.recording import Recording
from ...engine.hybrid.cell import free_run
from ...engine.simulation import Prediction
from ...models.hybrid_model import HybridModel
from .metrics import simulate


def hybrid_predictions(model: HybridModel, recording: Recording) -> Prediction:
    """Free run of a hybrid model over every stretch with complete inputs."""
    result = free_run(model, recording)
    predicted = np.array([result[name] for name in model.outputs]).T
    read = [model.read(name, recording) for name in model.outputs]
    measured = np.array([np.full(len(recording), np.nan) if item is None else item for item in read]).T
    rows = np.flatnonzero(np.any(np.isfinite(predicted), axis=1))
    joins = np.searchsorted([start for start, _ in recording.runs], rows, side="right")
    apart = np.concatenate(([False], (np.diff(rows) > 1) | (np.diff(joins) > 0))) if len(rows) else np.empty(0, bool)
    return Prediction(
        rows=np.asarray(rows, dtype=np.intp), predicted=predicted[rows], measured=measured[rows], run=np.cumsum(apart)
    )


@simulate.register(HybridModel)
def _simulated(model: HybridModel, recording: Recording, start: Mapping[str, float] | None = None) -> Prediction:
    if start:
        raise BadInput(f"{model.name} starts from the readings of each run's first rows. Give it no start.")
    return hybrid_predictions(model, recording)
