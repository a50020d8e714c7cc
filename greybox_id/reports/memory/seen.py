"""What a map with memory predicts of the recordings that it was fitted to and scored on."""

from __future__ import annotations

from collections.abc import Sequence

from ...fit import Fit
from ...memory_model import MemoryModel
from ...recording import Recording
from ...scores.metrics import PROTOCOLS, predictions
from ..recordings import Seen, matched


def memory_model(fit: Fit) -> MemoryModel:
    """The model of a fit of this kind."""
    assert isinstance(fit.model, MemoryModel)
    return fit.model


def seen(fit: Fit, recordings: Sequence[Recording]) -> tuple[Seen, ...]:
    """The recordings of a fit, in its order, with predictions.

    Raises
    ------
    BadInput : one that the fit saw is missing, or is another file.
    """
    model = memory_model(fit)
    protocols = PROTOCOLS if model.feedback is not None else PROTOCOLS[:2]
    return tuple(
        Seen(record.role, recording, model.outputs, {p: predictions(model, recording, p) for p in protocols})
        for record, recording in zip(fit.data, matched(fit, recordings), strict=True)
    )
