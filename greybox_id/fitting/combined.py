"""Combinations of parameters as a fit tells them, and how far a 95 % interval reaches."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from types import SimpleNamespace

import numpy as np
from scipy import special

from ..base.shorthands import Array
from ..models.model import Combination, Model

CONFIDENCE, Z = 0.975, 1.959963984540054
"""Upper quantile of a two-sided 95 % interval, and its distance in standard deviations when these are known."""


@dataclass(frozen=True)
class Combined:
    """A combination of parameters as a fit tells it: value, standard deviation and 95 % interval, in its unit."""

    name: str
    unit: str
    value: float
    sd: float
    low: float
    high: float
    about: str


def reach(dof: Array | float, quantile: float = CONFIDENCE) -> Array:
    """How many standard deviations an interval reaches to either side, by Student's t, up to an upper quantile."""
    dof = np.asarray(dof, dtype=float)
    finite = np.isfinite(dof)
    known = Z if quantile == CONFIDENCE else float(special.ndtri(quantile))
    return np.where(finite, special.stdtrit(np.where(finite, np.maximum(dof, 1.0), 1.0), quantile), known)


def combined(combination: Combination, model: Model, covariance: Array, dof: Mapping[str, Array]) -> Combined:
    """A combination to first order: its derivative by every parameter, and their covariance.

    Parameters
    ----------
    combination : what is asked for.
    model : at its estimates.
    covariance : (parameters, parameters) of its parameter vector.
    dof : name -> degrees of freedom of its standard deviation.
    """
    parameters = [p for p in model.parameters if p.shape == ()]
    values = {p.name: float(p.array) for p in parameters}
    value = float(combination.of(SimpleNamespace(**values)))
    gradient, start, of = np.zeros(model.size), 0, np.full(model.size, np.inf)
    for p in model.parameters:
        if p in parameters and not p.fixed and np.isfinite(values[p.name]):
            step = 1e-6 * max(abs(values[p.name]), 1e-3)
            up, down = (SimpleNamespace(**{**values, p.name: values[p.name] + sign * step}) for sign in (1, -1))
            gradient[start] = (float(combination.of(up)) - float(combination.of(down))) / (2 * step)
            of[start] = float(np.min(dof.get(p.name, np.asarray(np.inf))))
        start += p.size
    moved = np.flatnonzero(gradient)
    variance = float(gradient[moved] @ covariance[np.ix_(moved, moved)] @ gradient[moved])
    shares = gradient * (covariance @ gradient)
    sd = float(np.sqrt(max(variance, 0.0))) if np.isfinite(variance) else np.inf
    half = float(reach(_welch(shares[moved], of[moved]))) * sd
    return Combined(combination.name, combination.unit, value, sd, value - half, value + half, combination.about)


def _welch(shares: Array, dof: Array) -> float:
    """Degrees of freedom of a sum of variances, each known to its own (Welch & Satterthwaite)."""
    weights = np.abs(shares)
    slack = float(np.sum(weights**2 / dof))
    return float(np.sum(weights)) ** 2 / slack if slack > 0 else np.inf
