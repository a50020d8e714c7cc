"""Pretraining of networks: by a known vehicle, or by an earlier training of the same network."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from ..base.errors import BadInput
from ..base.shorthands import Array
from ..fitting.fit import Fit
from ..fitting.posterior.posterior import Posterior, load_posterior
from ..fitting.pretraining import Pretraining, Span
from ..fitting.saved_fit import load as load_fit
from ..fitting.training import TrainedBefore
from ..models.hybrid_model import HybridModel
from ..models.model import must_be
from ..models.motion_model import MotionModel
from ..models.registry import build
from .fitting import pretraining

DRAWS = 200
"""Number of draws of a known vehicle's parameters."""


@pretraining.register(HybridModel)
def _pretraining(
    model: HybridModel, source: Fit | Posterior | str | Path, points: int, span: Span, beyond: float = 1.0
) -> Pretraining | TrainedBefore:
    name = str(source) if isinstance(source, str | Path) else ""
    if model.recurrent:
        before = load_fit(source, build) if isinstance(source, str | Path) else source
        if not isinstance(before, Fit) or not isinstance(before.model, HybridModel) or before.model.name != model.name:
            raise BadInput(f"{name or 'pretrain'}: a fit of {model.name} is needed; its training is then continued.")
        return TrainedBefore(before.model, name)
    if isinstance(source, str | Path):
        source = load_posterior(source) if Path(source).suffix == ".parquet" else load_fit(source, build)
    if isinstance(source, Posterior):
        fit = source.its_fit(build)
        draws = source.vectors(fit, source.chosen(DRAWS))
    elif isinstance(source, Fit):
        fit, draws = source, _about(source)
    else:
        raise BadInput(f"pretrain: a fit, a posterior or the path of its file is needed, not {source!r:.60}.")
    no = f"{name or 'pretrain'}: a fit of equations of motion is needed, not one of {fit.model.name}."
    return Pretraining(must_be(MotionModel, fit.model, no), draws, points, span, name, beyond)


def _about(fit: Fit) -> Array:
    """Draws from the normal distribution of a fit's covariance, limited to bounds; its estimates if it has none."""
    if fit.covariance is None or not np.any(fit.covariance):
        return fit.model.values[None]
    random = np.random.default_rng(fit.seed)
    values, vectors = np.linalg.eigh(fit.covariance)
    drawn = random.standard_normal((DRAWS, len(values))) @ (vectors * np.sqrt(np.maximum(values, 0.0))).T
    drawn[:, np.diag(fit.covariance) == 0] = 0.0
    low = np.concatenate([np.full(p.size, p.bounds[0]) for p in fit.model.parameters])
    high = np.concatenate([np.full(p.size, p.bounds[1]) for p in fit.model.parameters])
    return np.asarray(np.clip(fit.model.values + drawn, low, high))
