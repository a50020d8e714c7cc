"""Markov chains of many walkers, all simulated side by side in lanes.

Three kinds of steps alternate. Most are proposals that leave a Student t distribution invariant, at first around the
fit, later around the walkers, and are accepted by the ratio of the posterior to it: where both nearly agree, one step
forgets the start. The others use differences between walkers, which adapt to the posterior's curvature.

Sources: Cotter, Roberts, Stuart & White, MCMC methods for functions, Statistical Science 28
(2013), preconditioned Crank-Nicolson, and Grumitt, Karamanis & Seljak, Flow annealed Kalman inversion, Inverse Problems
40 (2024), of a t distribution; ter Braak & Vrugt, Differential evolution Markov chain with snooker updater and fewer
chains, Statistics and Computing 18 (2008); Foreman-Mackey et al., emcee v3, JOSS 4 (2019), which moves the walkers.

Every block of steps draws its random numbers from (seed, number of the block), and proposals are adapted to the
stored burn-in only: results do not depend on where a run was interrupted.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from ...base.errors import BadInput
from ...base.shorthands import Array
from ...datasets.formats import needed
from .density import RIDGE, Target

FEWEST_WALKERS = 16
BURN_IN = 20
"""Blocks that are discarded. Chains started from the fit's normal distribution have little to forget."""
FORGET, LEARN = 5, (10, 20)
"""Blocks of the burn-in without influence on proposals; blocks after which proposals are adapted to the walkers."""
THIN = 10
"""Steps per block, of which the last is kept."""
TOWARDS_MIDDLE, DIFFERENCES, SNOOKER = 0.8, 0.15, 0.05
"""Shares of steps by the t distribution, by differences, and along the line to another walker."""
REACH = (0.3, 1.0)
"""Range of the step size beta of a step by the t distribution, log-uniform: 1 forgets the previous position."""
TAIL = 6.0
"""Degrees of freedom of the t distribution: with a normal one, walkers would be stuck in tails."""
STANDING = 20
"""Blocks without any accepted step after which a run is given up."""


@dataclass(frozen=True)
class Ensemble:
    """State of the walkers.

    Attributes
    ----------
    block : blocks done, burn-in included.
    at : (walkers, d) positions in sampling coordinates.
    log_posterior : (walkers,).
    accepted, proposed : steps so far.
    burnt : (blocks, walkers, d) positions after each block of the burn-in.
    """

    block: int
    at: Array
    log_posterior: Array
    accepted: int
    proposed: int
    burnt: Array


def walkers_for(dimensions: int) -> int:
    """Number of walkers: even, and at least twice the dimensions."""
    return max(FEWEST_WALKERS, 2 * (dimensions + 1))


class TowardsMiddle:
    """Proposals that leave a multivariate t distribution invariant.

    Parameters
    ----------
    centre : (d,).
    factor : (d, d) factor of its scale matrix.
    """

    def __init__(self, centre: Array, factor: Array) -> None:
        self.centre, self.factor, self.inverse = centre, factor, np.linalg.inv(factor)

    def __call__(self, u: Array, random: np.random.RandomState) -> tuple[Array, Array]:
        """Proposals (n, d), and the log of their correction factors for the t distribution (n,)."""
        count, d = u.shape
        beta = np.exp(random.uniform(np.log(REACH[0]), np.log(REACH[1]), count))[:, None]
        z = (u - self.centre) @ self.inverse.T
        squared_distance = np.sum(z**2, axis=1)
        scale = (TAIL + squared_distance) / (2.0 * random.standard_gamma((TAIL + d) / 2, count))
        other = np.sqrt(1.0 - beta**2) * z + beta * np.sqrt(scale)[:, None] * random.standard_normal(u.shape)
        log_ratio = np.log1p(np.sum(other**2, axis=1) / TAIL) - np.log1p(squared_distance / TAIL)
        return self.centre + other @ self.factor.T, 0.5 * (TAIL + d) * log_ratio


def middle(target: Target, ensemble: Ensemble) -> TowardsMiddle:
    """The t distribution of proposals at a block: around the fit, then around the walkers of the burn-in.

    The fit's covariance counts as d walkers, since few walkers do not determine a covariance.
    """
    learnt_from = max((blocks for blocks in LEARN if blocks <= ensemble.block), default=0)
    if learnt_from == 0:
        return TowardsMiddle(target.centre, target.factor)
    positions = ensemble.burnt[FORGET:learnt_from].reshape(-1, len(target.centre))
    centre = np.mean(positions, axis=0)
    deviations, d = positions - centre, len(centre)
    covariance = (deviations.T @ deviations + d * target.factor @ target.factor.T) / (len(positions) + d)
    unit = np.sqrt(np.diag(covariance))
    values, vectors = np.linalg.eigh(covariance / np.outer(unit, unit))
    return TowardsMiddle(centre, (vectors * np.sqrt(np.maximum(values, RIDGE))) * unit[:, None])


def begun(target: Target, seed: int) -> Ensemble:
    """Walkers drawn from the fit's normal distribution, within bounds and with finite predictions.

    Raises
    ------
    BadInput : the recordings do not determine a parameter, or nearly all draws have no density.
    """
    d = len(target.centre)
    count, rng = walkers_for(d), np.random.default_rng((seed, 0))
    at, log_posteriors = np.empty((0, d)), np.empty(0)
    for shrink in np.repeat([1.0, 0.3, 0.1, 0.03], 8):  # near bounds and in bent valleys, closer draws are needed
        draws = target.centre + shrink * rng.standard_normal((count, d)) @ target.factor.T
        log_posterior = target(draws)
        finite = np.isfinite(log_posterior)
        at, log_posteriors = (
            np.concatenate([at, draws[finite]]),
            np.concatenate([log_posteriors, log_posterior[finite]]),
        )
        if len(at) >= count:
            return Ensemble(0, at[:count], log_posteriors[:count], 0, 0, np.empty((0, count, d)))
    raise BadInput(
        "The model's predictions are finite at hardly any draw around the fit: the "
        "recordings do not determine its parameters. Fix "
        "some, or give them priors, and fit again."
    )


def moved(target: Target, start: Ensemble, seed: int, until: Callable[[Ensemble], bool]) -> Ensemble:
    """Move walkers block by block until `until` is true.

    Parameters
    ----------
    target : the sampled density.
    start : state of the walkers at the start.
    seed : seed of the steps.
    until : called after each block; True stops.

    Raises
    ------
    BadInput : emcee is not installed, or no walker moves.
    """
    emcee: Any = needed("emcee", "sample", "mcmc", "what emcee samples")
    count, dimensions = start.at.shape
    ensemble = start
    while True:
        moves = [
            (emcee.moves.MHMove(middle(target, ensemble), ndim=dimensions), TOWARDS_MIDDLE),
            (emcee.moves.DEMove(), DIFFERENCES),
            (emcee.moves.DESnookerMove(), SNOOKER),
        ]
        sampler = emcee.EnsembleSampler(count, dimensions, target, moves=moves, vectorize=True)
        sampler.log_prob_fn = target  # emcee's wrapper of it prints to standard output at Ctrl-C
        random = np.random.RandomState(np.random.SeedSequence((seed, ensemble.block + 1)).generate_state(8)).get_state()
        state = emcee.State(ensemble.at, log_prob=ensemble.log_posterior, random_state=random)
        accepted, before = ensemble.accepted, ensemble.at
        for item in sampler.sample(state, iterations=THIN, store=False, skip_initial_state_check=True):
            accepted += int(np.sum(np.any(item.coords != before, axis=1)))
            state, before = item, item.coords.copy()
        proposed = ensemble.proposed + THIN * count
        burnt = ensemble.burnt if ensemble.block >= BURN_IN else np.concatenate([ensemble.burnt, state.coords[None]])
        ensemble = Ensemble(ensemble.block + 1, state.coords.copy(), state.log_prob.copy(), accepted, proposed, burnt)
        if ensemble.block >= STANDING and ensemble.accepted == 0:
            raise BadInput("No walker has moved: the posterior has no width. Is a parameter at its bound?")
        if until(ensemble):
            return ensemble
