"""Predictions of a recording by a posterior: the mean over draws, and a band in which readings are expected.

The band is that of a normal distribution with the sum of two variances: that of the fit's residuals, and that of
simulations over draws. The draws are those of the likelihood alone: residuals already include the model-form error, and
the shift of the parameters that it causes is correlated with it, so that both together scatter predictions less than
the parameters by themselves.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from statistics import NormalDist

import numpy as np
import pandas as pd

from ...base.errors import BadInput
from ...base.shorthands import Array
from ...datasets.recording import Recording
from ...engine.motion.simulator import Predictor, Simulator
from ...engine.simulation import Prediction
from ...models.model import Model
from ..fit import Fit
from ..scores.metrics import as_table, must_suit
from ..scores.motion import in_order
from .posterior import Posterior, must_name
from .verb import must_suit_sampling

DRAWS = 200
"""Number of simulations; it determines the width of a band to 5 %."""


@dataclass(frozen=True)
class PredictiveBand:
    """A posterior's prediction of a recording.

    Attributes
    ----------
    mean : predictions, the mean over draws.
    sd : (samples, outputs) standard deviation of simulations over draws.
    low, high : (samples, outputs) band of readings.
    level : share of readings expected within the band.
    draws : number of simulations.
    """

    mean: Prediction
    sd: Array
    low: Array
    high: Array
    level: float
    draws: int

    def coverage(self) -> Array:
        """(outputs,) share of the readings within the band; NaN without readings."""
        read = np.isfinite(self.mean.measured) & np.isfinite(self.low)
        with np.errstate(invalid="ignore"):
            inside = (self.mean.measured >= self.low) & (self.mean.measured <= self.high)
            return np.asarray(
                np.sum(inside & read, axis=0) / np.where(np.any(read, axis=0), np.sum(read, axis=0), np.nan)
            )


def predictive_band(
    fit: Fit,
    posterior: Posterior,
    recording: Recording,
    horizon: float | None = None,
    *,
    level: float = 0.95,
) -> PredictiveBand:
    """Predict a recording with draws of a posterior.

    Parameters
    ----------
    fit : the fit of the posterior.
    posterior : its draws.
    recording : inputs and, if recorded, outputs.
    horizon : s ahead of readings; None for free runs.
    level : probability of the band.

    Raises
    ------
    BadInput : the posterior is of another fit or has no draws, or the recording lacks a signal.
    """
    model = must_suit_sampling(fit)
    posterior.must_be_of(fit)
    must_name(fit, posterior)
    if len(posterior) == 0:
        raise BadInput("The posterior has no draws yet: its run was interrupted. Call greybox sample again.")
    if horizon is not None:
        must_suit(horizon, [recording])
    simulator = Simulator(model)
    simulator.kernel.prepare()
    total, squares, base = np.zeros(1), np.zeros(1), None
    for p in posterior.vectors(fit, posterior.chosen(DRAWS, 0, noise_alone=True)):
        predictor = Predictor(simulator, recording, p)
        result = in_order(predictor.free_run() if horizon is None else predictor.ahead(horizon))
        if base is None:
            base = result
            total, squares = np.zeros(base.predicted.shape), np.zeros(base.predicted.shape)
        difference = result.predicted - base.predicted  # relative to the first one, against cancellation of digits
        total, squares = total + difference, squares + difference**2
    assert base is not None
    mean = base.predicted + total / DRAWS
    variance = np.maximum(squares / DRAWS - (total / DRAWS) ** 2, 0.0)
    noise = np.array([fit.stages[-1].noise.get(name, np.nan) if fit.stages else np.nan for name in fit.model.outputs])
    reach = NormalDist().inv_cdf(0.5 + level / 2) * np.sqrt(variance + np.nan_to_num(noise) ** 2)
    whole = replace(base, predicted=mean)
    return PredictiveBand(whole, np.sqrt(variance), mean - reach, mean + reach, level, DRAWS)


def banded_table(model: Model, recording: Recording, band: PredictiveBand) -> pd.DataFrame:
    """Predictions with the readings, if any, and for every output the band: `_low`, `_high`."""
    table = as_table(model, recording, band.mean, "predicted")
    for k, name in enumerate(model.outputs):
        at = list(table.columns).index(f"{name}_predicted") + 1
        table.insert(at, f"{name}_predicted_low", band.low[:, k])
        table.insert(at + 1, f"{name}_predicted_high", band.high[:, k])
    return table
