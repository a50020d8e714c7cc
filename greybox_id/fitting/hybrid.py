"""Fitting hybrid models: their networks are trained, those with a memory over windows, others over growing horizons."""

from __future__ import annotations

import numpy as np

from ..base.errors import BadInput
from ..engine.hybrid.stretches import stretches
from ..models.hybrid_model import HybridModel
from .fit import Fit
from .how import refused
from .networks import fit_network
from .pretraining import Pretraining
from .training import TrainedBefore, fit_hybrid, update_hybrid
from .verb import FitTask, estimated


@estimated.register(HybridModel)
def _estimated(model: HybridModel, task: FitTask) -> Fit:
    recordings, how, say, pretraining = task.recordings, task.how, task.say, task.pretraining
    if how.solver == "ipopt":
        raise BadInput(f"{model.name} is trained by its gradient, stopped by held-out manoeuvres; omit ‹solver›.")
    if task.validate is not None:
        stretches(model, task.validate)  # what is wrong with it is better said before the work than after
    if isinstance(pretraining, TrainedBefore):
        trained = update_hybrid(pretraining.model, recordings, how, say)
    elif model.recurrent:
        trained = fit_hybrid(model, recordings, how, say)
    else:
        trained = fit_network(model, recordings, how, say, pretraining)
    return Fit(
        model=trained.model,
        sd={  # trainings from several seeds tell a spread
            p.name: np.full(p.shape, np.nan) for p in trained.model.parameters
        },
        stages=(trained.stage,),
        metrics={},
        seed=task.how.seed,
        data=(),
        mode="early stopping",
        how={
            "stopped_by": list(trained.held_out),
            "errors_over_windows": list(trained.errors),
            **({} if pretraining is None else {"pretrained_from": pretraining.source or pretraining.model.name}),
            **({"pretrained_beyond": pretraining.beyond} if isinstance(pretraining, Pretraining) else {}),
        },
    )


@refused.register(HybridModel)
def _refused(model: HybridModel, option: str) -> str:
    if option == "‹noise›":
        return ""
    return (
        f"{option} does not go with {model.name}: it is trained over windows and stopped by manoeuvres that are held "
        "out. Omit it."
    )
