"""Importance sampling around the fit's normal distribution.

The proposal is a Student t distribution at the fit, whose tails cover those of the normal one; each draw is weighted
by the ratio of the posterior's density to the proposal's, which corrects for curvature, skewness and bounds. With
unbounded ratios, a few draws would dominate. The largest ratios follow a generalised Pareto distribution; its shape k
shows whether the weights are reliable, and its quantiles replace them. If they are not, a new proposal is made from
the weighted draws; if that fails too, the result is the normal distribution, truncated at the bounds, with a caution.


Sources: Vehtari, Simpson, Gelman, Yao & Gabry, Pareto smoothed importance sampling, J. Machine Learning Research 25
(2024), whose limit of k it is; Zhang & Stephens, A new and efficient estimation method for the generalized Pareto
distribution, Technometrics 51 (2009); Cappé, Guillin, Marin & Robert, Population Monte Carlo, J. Computational and
Graphical Statistics 13 (2004), draws from where weighted ones were.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from math import log10
from typing import NamedTuple

import numpy as np

from ...base.errors import BadInput
from ...base.shorthands import Array
from .density import RIDGE, Target

TAIL = 6.0
"""Degrees of freedom of the proposal."""
ROUNDS = 3
"""Largest number of proposals, each from the weighted draws of the previous one, until weights are reliable."""
BATCH = 250
"""Draws simulated per batch, between progress reports."""
SHORTEST_TAIL = 5
"""Smallest number of ratios in the tail from which k is estimated."""
TRUSTED = 0.7
"""k above which weighted draws converge too slowly to be of use; with few draws the limit is 1 - 1 / log10(draws)."""
MOST_TRIES = 1000
"""Largest ratio of normal draws tried to draws requested, when most fall beyond bounds."""


class WeightedDraws(NamedTuple):
    """Draws in the target's coordinates.

    Attributes
    ----------
    u : (n, d) draws.
    weight : (n,) sums to one; uniform if weights are not reliable.
    log_density : (n,) of the target; of the normal distribution if weights are not reliable.
    k : shape of the tail of the ratios; NaN with too few draws.
    within : share of the proposed draws within bounds.
    complete : whether all draws were made, without an interruption by Ctrl-C.
    """

    u: Array
    weight: Array
    log_density: Array
    k: float
    within: float
    complete: bool


def weighted_draws(target: Target, draws: int, seed: int, tell: Callable[[int, int], None]) -> WeightedDraws:
    """Draws of a posterior that is nearly normal.

    Parameters
    ----------
    target : the sampled density.
    draws : number of draws.
    seed : seed of the draws.
    tell : called with the round, from 1, and the number of draws simulated in it so far.

    Raises
    ------
    BadInput : nearly all draws fall beyond the bounds.
    """
    centre, factor = target.centre, target.factor
    best: WeightedDraws | None = None
    for number in range(1, ROUNDS + 1):
        rng = np.random.default_rng((seed, 31, number))
        u, log_proposal, within = _proposed(target, centre, factor, TAIL, draws, rng)
        log_density, complete = _simulated(target, u, partial(tell, number))
        counted = len(log_density)
        u, log_ratio = u[:counted], log_density - log_proposal[:counted]
        if not np.any(np.isfinite(log_ratio)):
            if complete:
                break
            return WeightedDraws(u[:0], np.empty(0), np.empty(0), float("nan"), within, complete)
        log_weight, k = smoothed(log_ratio)
        importance = WeightedDraws(u, np.exp(log_weight), log_density, k, within, complete)
        best = importance if best is None or not k >= best.k else best
        if not complete or np.isnan(k) or k <= trusted(draws):
            return best
        centre, factor = _moments(target, importance)
    rng, k = np.random.default_rng((seed, 31)), np.inf if best is None else best.k
    u, log_density, within = _proposed(target, target.centre, target.factor, np.inf, draws, rng)
    return WeightedDraws(u, np.full(draws, 1 / draws), log_density, k, within, True)


def trusted(draws: int) -> float:
    """The largest k at which weights of so many draws are reliable."""
    return min(TRUSTED, 1.0 - 1.0 / log10(max(draws, 11)))


def smoothed(log_ratio: Array) -> tuple[Array, float]:
    """Logarithms of normalised weights, the largest replaced by Pareto quantiles, and the shape k of the tail.

    Parameters
    ----------
    log_ratio : (n,) of densities; -inf drops a draw.
    """
    log_weight = log_ratio - np.max(log_ratio)
    tail = int(np.ceil(min(0.2 * len(log_weight), 3.0 * np.sqrt(len(log_weight)))))
    order, k = np.argsort(log_weight, kind="stable"), float("nan")
    largest = order[-tail:]
    cut = np.exp(log_weight[order[-tail - 1]]) if tail < len(log_weight) else 0.0
    beyond = np.exp(log_weight[largest]) - cut
    if tail >= SHORTEST_TAIL:
        spread = int(np.sum(beyond > np.finfo(float).eps))
        k = -np.inf if spread == 0 else np.inf  # all equal, or dominated by a handful
        if spread >= SHORTEST_TAIL:
            k, scale = pareto_shape(beyond[beyond > 0.0])
            exponential = -np.log1p(-(np.arange(tail) + 0.5) / tail)
            with np.errstate(over="ignore"):
                expected = scale * (exponential if abs(k) < 1e-12 else np.expm1(k * exponential) / k)
            log_weight[largest] = np.minimum(np.log(cut + expected), 0.0)
    return log_weight - np.logaddexp.reduce(log_weight), float(k)


def pareto_shape(beyond: Array) -> tuple[float, float]:
    """Shape k and scale of a generalised Pareto distribution, from (n,) positive numbers in ascending order.

    By Zhang and Stephens, with k shrunk towards 0.5 by a prior worth ten numbers (Vehtari et al.).
    """
    n = len(beyond)
    points = 30 + int(np.sqrt(n))
    at = 1.0 / beyond[-1] + (1.0 - np.sqrt(points / (np.arange(1, points + 1) - 0.5))) / (
        3.0 * beyond[int(n / 4 + 0.5) - 1]
    )
    shape = np.mean(np.log1p(-at[:, None] * beyond), axis=1)
    log_likelihood = n * (np.log(-at / shape) - shape - 1.0)
    with np.errstate(over="ignore"):
        weight = 1.0 / np.sum(np.exp(log_likelihood - log_likelihood[:, None]), axis=1)
    middle = float(weight @ at / np.sum(weight))
    k = float(np.mean(np.log1p(-middle * beyond)))
    return (n * k + 5.0) / (n + 10.0), -k / middle


def _proposed(
    target: Target, centre: Array, factor: Array, tail: float, count: int, rng: np.random.Generator
) -> tuple[Array, Array, float]:
    """(count, d) draws of a t distribution within the bounds, its log density there up to a constant, and the share of
    all draws within the bounds.
    """
    d, result, tried, kept = len(centre), [], 0, 0
    while kept < count:
        size = max(count, 64)
        z = rng.standard_normal((size, d))
        if np.isfinite(tail):
            z /= np.sqrt(rng.chisquare(tail, size) / tail)[:, None]
        u, squared_distance = centre + z @ factor.T, np.sum(z**2, axis=1)
        inside = target.within(u)
        result.append(np.column_stack([u, squared_distance])[inside])
        tried, kept = tried + size, kept + int(np.sum(inside))
        if tried > MOST_TRIES * size:
            raise BadInput(
                "Nearly all draws of the fit's normal distribution fall beyond the parameters' bounds: the recordings "
                "do not determine them. Fix some, or give them priors, and fit again."
            )
    u, squared_distance = np.split(np.concatenate(result)[:count], [d], axis=1)
    log_density = (
        -0.5 * squared_distance[:, 0] if np.isinf(tail) else -0.5 * (tail + d) * np.log1p(squared_distance[:, 0] / tail)
    )
    return u, log_density, kept / tried


def _simulated(target: Target, u: Array, tell: Callable[[int], None]) -> tuple[Array, bool]:
    """The target's log density at the draws simulated before Ctrl-C, and whether these are all."""
    result: list[Array] = []
    try:
        for k in range(0, len(u), BATCH):
            result.append(target(u[k : k + BATCH]))
            tell(min(k + BATCH, len(u)))
    except KeyboardInterrupt:
        return np.concatenate(result) if result else np.empty(0), False
    return np.concatenate(result), True


def _moments(target: Target, weighted_draws: WeightedDraws) -> tuple[Array, Array]:
    """Centre and factor of the weighted draws' covariance; the fit's counts as d draws, with d coordinates."""
    d, effective_size = len(target.centre), 1.0 / np.sum(weighted_draws.weight**2)
    centre = (effective_size * weighted_draws.weight @ weighted_draws.u + d * target.centre) / (effective_size + d)
    deviations = weighted_draws.u - weighted_draws.weight @ weighted_draws.u
    covariance = (
        effective_size * (deviations * weighted_draws.weight[:, None]).T @ deviations
        + d * target.factor @ target.factor.T
    ) / (effective_size + d)
    unit = np.sqrt(np.diag(covariance))
    values, vectors = np.linalg.eigh(covariance / np.outer(unit, unit))
    return centre, (vectors * np.sqrt(np.maximum(values, RIDGE))) * unit[:, None]
