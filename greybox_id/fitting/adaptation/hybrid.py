"""Adapt hybrid models to the first seconds of a changed vehicle: the factors by which tyres differ."""

from __future__ import annotations

from ...base.errors import BadInput
from ...models.hybrid_model import HybridModel
from .motion import adapted_motion
from .verb import Adaptation, AdaptTask, adapted


@adapted.register(HybridModel)
def _adapted_hybrid(model: HybridModel, task: AdaptTask) -> Adaptation:
    """`free`: "auto" or "all", all factors by which tyres differ, or names of some, with commas."""
    if not model.carried_on:
        raise BadInput(
            f"A fit of {model.name} cannot be adapted: it holds no covariance. Without a covariance, nothing keeps "
            f"parameters near their estimates if the new data do not excite them. Fit it to the new and the old "
            "recordings together."
        )
    return adapted_motion(model, task)
