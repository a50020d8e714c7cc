"""What a fit's intervals count beyond the noise: the error of its form, of sizes that round, conflicts, half a row.

A fit states all of it in its standard deviations and its covariance. What the noise alone leaves open follows again
from the problem; the rest is the difference, whatever it is made of, so that profiles and draws count what the fit
does.
"""

from __future__ import annotations

import numpy as np

from ...base.shorthands import Array
from ...engine.motion.shooting import MotionProblem
from ..fit import Fit
from .sandwich import Uncertainty


def wider(fit: Fit, name: str, noise: float) -> float:
    """The standard deviation that a fit states of a single number over that of the noise alone; at least 1.

    Parameters
    ----------
    fit : the fit.
    name : of the parameter.
    noise : its standard deviation where noise alone is counted.
    """
    stated = float(np.asarray(fit.sd.get(name, np.nan)))
    comparable = np.isfinite(stated) and np.isfinite(noise) and noise > 0.0
    return max(1.0, stated / noise) if comparable else 1.0


def beyond_noise(fit: Fit, problem: MotionProblem, known: Uncertainty) -> Array:
    """(parameters, parameters) what a fit's covariance of its parameter vector has beyond the noise.

    Of a parameter with a value for each run, that of the runs' mean.

    Parameters
    ----------
    fit : the fit.
    problem : the problem that it solved.
    known : uncertainty at its optimum.
    """
    size, index = fit.model.size, problem.parameters.index
    mean = np.zeros((size, problem.layout.size))
    for at in index:
        mean[np.arange(size), at] += 1.0 / len(index)
    noise = mean @ np.where(np.isfinite(known.covariance), known.covariance, 0.0) @ mean.T
    sd = np.concatenate([np.broadcast_to(fit.sd.get(p.name, np.nan), p.shape).ravel() for p in fit.model.parameters])
    result = np.diag(np.maximum(np.nan_to_num(sd**2, posinf=0.0) - np.diag(noise), 0.0))
    if fit.covariance is not None:  # a file has no covariances of arrays
        kept = np.flatnonzero(np.diag(fit.covariance) > 0.0)
        result[np.ix_(kept, kept)] = (fit.covariance - noise)[np.ix_(kept, kept)]
    return result
