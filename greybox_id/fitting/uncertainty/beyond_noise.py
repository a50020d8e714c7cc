"""Uncertainty of a fit beyond the noise: model-form error, sizes of rounding effects, conflicts, half a row of timing.

A fit's standard deviations and covariance include all of it. The part of the noise alone is computed again from the
problem; the rest is the difference, whatever its causes, so that profiles and draws include the same as the fit.
"""

from __future__ import annotations

import numpy as np

from ...base.shorthands import Array
from ...engine.motion.shooting import MotionProblem
from ..fit import Fit
from .sandwich import Uncertainty


def wider(fit: Fit, name: str, noise: float) -> float:
    """Ratio of a parameter's standard deviation in the fit to that of the noise alone; at least 1.

    Parameters
    ----------
    fit : the fit.
    name : name of a scalar parameter.
    noise : its standard deviation from the noise alone.
    """
    stated = float(np.asarray(fit.sd.get(name, np.nan)))
    comparable = np.isfinite(stated) and np.isfinite(noise) and noise > 0.0
    return max(1.0, stated / noise) if comparable else 1.0


def beyond_noise(fit: Fit, problem: MotionProblem, known: Uncertainty) -> Array:
    """(parameters, parameters) difference of a fit's covariance of its parameter vector and that of the noise alone.

    For a run-scoped parameter it is that of the mean over runs.

    Parameters
    ----------
    fit : the fit.
    problem : its problem.
    known : uncertainty at its optimum.
    """
    size, index = fit.model.size, problem.parameters.index
    averaging = np.zeros((size, problem.layout.size))
    for places in index:
        averaging[np.arange(size), places] += 1.0 / len(index)
    noise = averaging @ np.where(np.isfinite(known.covariance), known.covariance, 0.0) @ averaging.T
    sd = np.concatenate([np.broadcast_to(fit.sd.get(p.name, np.nan), p.shape).ravel() for p in fit.model.parameters])
    result = np.diag(np.maximum(np.nan_to_num(sd**2, posinf=0.0) - np.diag(noise), 0.0))
    if fit.covariance is not None:  # files omit covariances of arrays
        kept = np.flatnonzero(np.diag(fit.covariance) > 0.0)
        result[np.ix_(kept, kept)] = (fit.covariance - noise)[np.ix_(kept, kept)]
    return result
