"""Approximate Bayesian computation by sequential Monte Carlo: particles whose simulations come closer and closer.

A population is perturbed and simulated, all particles side by side; those closer to the recordings than a threshold
make the next one. Thresholds follow from trial particles such that the acceptance is that of the schedule. The normal
kernel has twice the weighted covariance of the population it perturbs, and the same kernel is in the weights;
priors are truncated at the parameters' bounds.

Sources: Toni et al., Approximate Bayesian computation scheme for parameter inference and model selection in dynamical
systems, J. R. Soc. Interface 6 (2009); Filippi et al., On optimality of kernels for ABC-SMC, Stat. Appl. Genet. Mol.
Biol. 12 (2013). The schedule is that of "Physics-guided approach with transfer learning in vehicle lateral dynamics".
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Literal, NamedTuple

import numpy as np
import scipy.linalg as la
from scipy.special import logsumexp, ndtr, ndtri

from ...base.errors import BadInput
from ...base.shorthands import Array
from .density import PosteriorDensity

Distance = Literal["pooled", "trajectories"]
Away = Callable[[Array], Array]
"""(n, d) particles -> (n,) distances, infinite where a simulation is not finite."""
TARGETS = (0.75, 0.65, 0.55, 0.45, 0.35, 0.25, 0.15, 0.05, 0.025, 0.01)
"""Acceptance of the populations after the first, as published."""
PILOT = 1000
"""Trial particles that set a threshold; more if needed for FEWEST_ACCEPTED accepted ones."""
FEWEST_ACCEPTED = 40
BATCH = 250
"""Particles simulated per batch, between progress reports."""
HOPELESS = 0.2
"""Share of its target below which a population's acceptance ends the run with the previous population."""
RIDGE = 1e-9


class ParticlePrior(NamedTuple):
    """Prior of one coordinate: normal, or uniform if sd is infinite; truncated at its bounds."""

    mean: float
    sd: float
    low: float
    high: float


@dataclass(frozen=True)
class ParticleSet:
    """A population of weighted particles.

    Attributes
    ----------
    number : number of the population; 0 is drawn from the prior.
    at : (n, d) coordinates.
    weight : (n,) sums to one.
    distance : (n,) distances from the recordings.
    threshold : upper limit of all distances.
    acceptance : share of the simulated particles that were accepted.
    """

    number: int
    at: Array
    weight: Array
    distance: Array
    threshold: float
    acceptance: float


@dataclass(frozen=True)
class Growing:
    """A population under construction: its source, and the particles accepted so far after so many batches."""

    source: ParticleSet
    threshold: float
    batches: int
    simulated: int
    at: Array
    distance: Array


def priors_of(density: PosteriorDensity) -> tuple[ParticlePrior, ...]:
    """The prior of each coordinate.

    Raises
    ------
    BadInput : a parameter has neither a prior nor finite bounds, or its prior correlates several numbers.
    """
    result = []
    for one, low, high in zip(density.coordinates, *density.bounds, strict=True):
        parameter = density.problem.model[one.parameter]
        prior = parameter.prior
        if prior is not None and any(step is not None for step in prior.step_sd):
            raise BadInput(
                f"abc-smc draws every number independently, but the prior of {one.parameter} correlates "
                "several numbers. Use mcmc."
            )
        sd = (
            np.inf
            if prior is None
            else float(np.broadcast_to(np.asarray(prior.sd, float), parameter.shape).flat[one.entry])
        )
        if not np.isfinite(sd) and not (np.isfinite(low) and np.isfinite(high)):
            raise BadInput(
                f"abc-smc draws from the priors, but {one.name} has neither a prior nor two finite bounds. Fit again "
                f"with ‹prior› {one.name}, or use mcmc."
            )
        prior_mean = parameter.array if prior is None or prior.mean is None else np.asarray(prior.mean, dtype=float)
        mean = float(np.broadcast_to(prior_mean, parameter.shape).flat[one.entry])
        result.append(ParticlePrior(mean, sd, float(low), float(high)))
    return tuple(result)


def drawn(priors: Sequence[ParticlePrior], count: int, rng: np.random.Generator) -> Array:
    """(count, d) draws from the priors."""
    columns = []
    for prior in priors:
        u = rng.uniform(size=count)
        if np.isfinite(prior.sd):
            below, above = ndtr((prior.low - prior.mean) / prior.sd), ndtr((prior.high - prior.mean) / prior.sd)
            z = ndtri(below + u * (above - below))
            columns.append(np.clip(prior.mean + prior.sd * z, prior.low, prior.high))
        else:
            columns.append(prior.low + u * (prior.high - prior.low))
    return np.column_stack(columns)


def log_prior(priors: Sequence[ParticlePrior], at: Array) -> Array:
    """(n,) log density of the priors within bounds, up to a constant."""
    return np.asarray(sum(-0.5 * ((at[:, k] - prior.mean) / prior.sd) ** 2 for k, prior in enumerate(priors)))


class Distances:
    """Distances of simulations from the recordings, outputs scaled by their standard deviation over the recordings.

    "pooled": root mean square over all rows and outputs. "trajectories": the mean over trajectories of each one's root
    mean square over rows, averaged over outputs, as free runs are scored in the publication.
    """

    def __init__(self, density: PosteriorDensity, kind: Distance) -> None:
        self._density, self._kind = density, kind
        problem = density.problem
        read = problem.weight > 0
        with np.errstate(invalid="ignore"):
            spread = np.nanstd(np.where(read, problem.target, np.nan), axis=0)
        self._scale = np.where(spread > 0, spread, 1.0)
        self._counts = np.maximum(np.sum(read), 1)
        self._rows = np.concatenate(([0], np.cumsum([item.rows for item in problem.intervals])))
        self._read = np.add.reduceat(read.astype(float), self._rows[:-1], axis=0)

    def __call__(self, at: Array) -> Array:
        """(n, d) -> (n,); infinite where a simulation is not finite."""
        with np.errstate(over="ignore", invalid="ignore"):
            squares = (self._density.errors(at) / self._scale) ** 2
            if self._kind == "pooled":
                result = np.sqrt(np.sum(squares, axis=(1, 2)) / self._counts)
            else:
                each = np.add.reduceat(squares, self._rows[:-1], axis=1) / np.maximum(self._read, 1)
                result = np.mean(np.sqrt(each), axis=(1, 2))
        return np.asarray(np.where(np.isfinite(result), result, np.inf))


def first(distances: Away, priors: Sequence[ParticlePrior], count: int, seed: int) -> ParticleSet:
    """A population drawn from the priors, with finite simulations.

    Raises
    ------
    BadInput : hardly any simulation is finite.
    """
    at, away, tried = np.empty((0, len(priors))), np.empty(0), 0
    for batch in range(100):
        draws = drawn(priors, count, np.random.default_rng((seed, 0, batch)))
        distances_of_draws = np.concatenate([distances(draws[k : k + BATCH]) for k in range(0, count, BATCH)])
        finite = np.isfinite(distances_of_draws)
        at, away, tried = (
            np.concatenate([at, draws[finite]]),
            np.concatenate([away, distances_of_draws[finite]]),
            tried + count,
        )
        if len(at) >= count:
            at, away = at[:count], away[:count]
            return ParticleSet(0, at, np.full(count, 1 / count), away, float(np.max(away)), len(at) / tried)
    raise BadInput(
        "The model's predictions are finite at hardly any draw from the priors. "
        "Narrow the priors or bounds, and fit again."
    )


class PerturbationKernel:
    """Perturbs a population by a normal kernel, truncated at the priors' bounds by drawing again; gives its density."""

    def __init__(self, source: ParticleSet, priors: Sequence[ParticlePrior]) -> None:
        self._source = source
        mean = source.weight @ source.at
        off = source.at - mean
        covariance = 2.0 * (off * source.weight[:, None]).T @ off
        unit = np.sqrt(np.diag(covariance))
        unit = np.where(unit > 0, unit, 1.0)
        scaled = covariance / np.outer(unit, unit)
        scaled[np.diag_indices_from(scaled)] += RIDGE
        self._factor = unit[:, None] * la.cholesky(scaled, lower=True)
        self._low = np.array([prior.low for prior in priors])
        self._high = np.array([prior.high for prior in priors])

    def perturbed(self, count: int, rng: np.random.Generator) -> Array:
        """(count, d) perturbed particles within bounds."""
        result = np.empty((0, len(self._low)))
        while len(result) < count:
            chosen = rng.choice(len(self._source.at), size=count, p=self._source.weight)
            draws = self._source.at[chosen] + rng.standard_normal((count, len(self._low))) @ self._factor.T
            inside = np.all((draws >= self._low) & (draws <= self._high), axis=1)
            result = np.concatenate([result, draws[inside]])
        return result[:count]

    def log_density(self, at: Array) -> Array:
        """(n,) log density up to a constant, which truncation leaves unchanged: draws beyond bounds are discarded."""
        turned = la.solve_triangular(self._factor, at.T, lower=True)
        source_turned = la.solve_triangular(self._factor, self._source.at.T, lower=True)
        squares = (
            np.sum(turned**2, axis=0)[:, None] + np.sum(source_turned**2, axis=0)[None] - 2.0 * turned.T @ source_turned
        )
        with np.errstate(divide="ignore"):
            logs = np.log(self._source.weight)
        return np.asarray(logsumexp(logs[None] - 0.5 * np.maximum(squares, 0.0), axis=1))


def begin(distances: Away, source: ParticleSet, priors: Sequence[ParticlePrior], seed: int) -> Growing:
    """Set the next threshold such that the target's share of trial particles is closer."""
    target = TARGETS[source.number]
    count = max(PILOT, round(FEWEST_ACCEPTED / target))
    at = PerturbationKernel(source, priors).perturbed(count, np.random.default_rng((seed, source.number + 1, 0)))
    away = np.concatenate([distances(at[k : k + BATCH]) for k in range(0, count, BATCH)])
    threshold = min(float(np.quantile(away, target, method="lower")), source.threshold)
    return Growing(source, threshold, 0, 0, np.empty((0, len(priors))), np.empty(0))


def grow(
    distances: Away, growing: Growing, priors: Sequence[ParticlePrior], seed: int, until: Callable[[Growing], bool]
) -> ParticleSet | Growing:
    """Fill a population batch by batch; return it unfinished if `until`, called after each batch, is true."""
    source, kernel = growing.source, PerturbationKernel(growing.source, priors)
    count = len(source.at)
    while len(growing.at) < count:
        draws = kernel.perturbed(BATCH, np.random.default_rng((seed, source.number + 1, growing.batches + 1)))
        away = distances(draws)
        close = away <= growing.threshold
        growing = Growing(
            source, growing.threshold, growing.batches + 1, growing.simulated + BATCH,
            np.concatenate([growing.at, draws[close]]), np.concatenate([growing.distance, away[close]]),
        )  # fmt: skip
        hopeless = len(growing.at) < HOPELESS * TARGETS[source.number] * growing.simulated
        if hopeless and growing.simulated > 20 * PILOT:
            return source
        if until(growing) and len(growing.at) < count:
            return growing
    at, away = growing.at[:count], growing.distance[:count]
    logs = log_prior(priors, at) - kernel.log_density(at)
    weight = np.exp(logs - logsumexp(logs))
    return ParticleSet(
        source.number + 1, at, weight / np.sum(weight), away, growing.threshold, len(growing.at) / growing.simulated
    )
