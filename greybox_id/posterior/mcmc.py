"""Markov chains of many walkers, all simulated side by side in lanes.

Three kinds of steps take turns. Half of them lead towards the normal distribution about the fit and are accepted by how
the posterior differs from it: where it hardly does, one step forgets all. The others go by the differences between
walkers, which know how the posterior is bent where the fit does not. Positive numbers move by their logarithm: valleys
along which a product stays the same are straight there.

Sources: Cotter, Roberts, Stuart & White, MCMC methods for functions, Statistical Science 28 (2013), preconditioned
Crank-Nicolson; ter Braak & Vrugt, Differential evolution Markov chain with snooker updater and fewer chains, Statistics
and Computing 18 (2008); Foreman-Mackey et al., emcee v3, JOSS 4 (2019), which moves the walkers.

Every block of steps draws its random numbers from (seed, number of the block): what a run finds does not depend on
where it was interrupted.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..datasets.formats.contents import needed
from ..errors import BadInput
from ..parameter import Array
from .density import PosteriorDensity
from .laplace import whitening

FEWEST_WALKERS = 16
BURN_IN = 20
"""Blocks that are not kept. From draws of the fit's normal distribution chains have little to forget."""
THIN = 10
"""Steps a block, of which the last is kept."""
TOWARDS_FIT, DIFFERENCES, SNOOKER = 0.5, 0.4, 0.1
"""Shares of steps towards the fit's normal distribution, by differences, and along the line to another walker."""
REACH = (0.1, 1.0)
"""How far a step towards the fit's distribution goes, drawn in its logarithm: 1 forgets where it was."""
WIDER = 1.1
"""That distribution is so much wider than the fit's covariance: a narrower one would hold walkers in tails."""
STANDING = 20
"""Blocks after which a run in which no walker has moved is given up."""


@dataclass(frozen=True)
class Ensemble:
    """Where walkers are.

    Attributes
    ----------
    block : blocks done, burn-in included.
    at : (walkers, d) in the coordinates in which they move.
    log_posterior : (walkers,).
    accepted, proposed : steps so far.
    """

    block: int
    at: Array
    log_posterior: Array
    accepted: int
    proposed: int


def walkers_for(dimensions: int) -> int:
    """How many walkers: an even number, at least twice the dimensions."""
    return max(FEWEST_WALKERS, 2 * (dimensions + 1))


class Target:
    """The density in the coordinates in which walkers move, u = log(theta) of positive numbers, theta of others.

    Parameters
    ----------
    density : in theta.
    covariance : (d, d) of theta about the fit.
    """

    def __init__(self, density: PosteriorDensity, covariance: Array) -> None:
        self.density = density
        unit, factor, self.logarithmic = whitening(density, covariance)
        size = np.where(self.logarithmic, density.centre, 1.0)
        self.centre = self.to_u(density.centre[None])[0]
        self.factor = WIDER * factor * (unit / size)[:, None]
        self.inverse = np.linalg.inv(self.factor)

    def to_u(self, theta: Array) -> Array:
        """(n, d) -> (n, d)."""
        return np.asarray(np.where(self.logarithmic, np.log(np.where(self.logarithmic, theta, 1.0)), theta))

    def to_theta(self, u: Array) -> Array:
        """(n, d) -> (n, d)."""
        with np.errstate(over="ignore"):
            return np.asarray(np.where(self.logarithmic, np.exp(np.where(self.logarithmic, u, 0.0)), u))

    def __call__(self, u: Array) -> Array:
        """(n, d) -> (n,) logarithm of the density of u."""
        found = self.density(self.to_theta(u)) + np.sum(u[:, self.logarithmic], axis=1)
        return np.asarray(np.where(np.isfinite(found), found, -np.inf))

    def towards_fit(self, u: Array, random: np.random.RandomState) -> tuple[Array, Array]:
        """Proposals (n, d) that leave the fit's normal distribution as it is, and what corrects for that (n,)."""
        low, high = np.log(REACH)
        beta = np.exp(random.uniform(low, high, len(u)))[:, None]
        z = (u - self.centre) @ self.inverse.T
        other = np.sqrt(1.0 - beta**2) * z + beta * random.standard_normal(u.shape)
        return self.centre + other @ self.factor.T, 0.5 * (np.sum(other**2, axis=1) - np.sum(z**2, axis=1))


def begun(target: Target, seed: int) -> Ensemble:
    """Walkers drawn from the fit's normal distribution, within bounds and where the model is finite.

    Raises
    ------
    BadInput : the recordings do not determine a parameter, or nearly all draws have no density.
    """
    d = len(target.centre)
    count, rng = walkers_for(d), np.random.default_rng((seed, 0))
    at, logs = np.empty((0, d)), np.empty(0)
    for shrink in np.repeat([1.0, 0.3, 0.1, 0.03], 8):  # about bounds and in bent valleys closer ones are needed
        own = target.centre + shrink * rng.standard_normal((count, d)) @ target.factor.T
        told = target(own)
        good = np.isfinite(told)
        at, logs = np.concatenate([at, own[good]]), np.concatenate([logs, told[good]])
        if len(at) >= count:
            return Ensemble(0, at[:count], logs[:count], 0, 0)
    raise BadInput(
        "The model is finite at hardly any draw about the fit: the recordings do not determine its parameters. Fix "
        "some, or give them priors, and fit again."
    )


def moved(target: Target, start: Ensemble, seed: int, until: Callable[[Ensemble], bool]) -> Ensemble:
    """Walkers moved block by block until told to stop.

    Parameters
    ----------
    target : what it is distributed as.
    start : where from.
    seed : of the steps.
    until : called after each block; True stops.

    Raises
    ------
    BadInput : emcee is not installed, or no walker moves.
    """
    emcee: Any = needed("emcee", "sample", "mcmc", "what emcee samples")
    count, dimensions = start.at.shape
    moves = [
        (emcee.moves.MHMove(target.towards_fit, ndim=dimensions), TOWARDS_FIT),
        (emcee.moves.DEMove(), DIFFERENCES),
        (emcee.moves.DESnookerMove(), SNOOKER),
    ]
    sampler = emcee.EnsembleSampler(count, dimensions, target, moves=moves, vectorize=True)
    sampler.log_prob_fn = target  # what emcee wraps it in prints to standard output where Ctrl-C arrives
    own = start
    while True:
        random = np.random.RandomState(np.random.SeedSequence((seed, own.block + 1)).generate_state(8)).get_state()
        state = emcee.State(own.at, log_prob=own.log_posterior, random_state=random)
        accepted, before = own.accepted, own.at
        for found in sampler.sample(state, iterations=THIN, store=False, skip_initial_state_check=True):
            accepted += int(np.sum(np.any(found.coords != before, axis=1)))
            state, before = found, found.coords.copy()
        proposed = own.proposed + THIN * count
        own = Ensemble(own.block + 1, state.coords.copy(), state.log_prob.copy(), accepted, proposed)
        if own.block >= STANDING and own.accepted == 0:
            raise BadInput("No walker has moved: the posterior has no width here. Is a parameter at its bound?")
        if until(own):
            return own
