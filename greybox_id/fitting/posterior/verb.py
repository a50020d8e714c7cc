"""The verb `sample`: draws from the posterior of a fit's parameters; an interrupted run can be continued."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any, get_args

import numpy as np
from numpy.typing import ArrayLike
from threadpoolctl import threadpool_limits

from ...base.errors import BadInput, must_be_one_of, must_be_whole
from ...base.shorthands import Array
from ...datasets.recording import Recording
from ...engine.motion.shooting import MotionProblem
from ...models.model import must_be
from ...models.motion_model import MotionModel
from ...models.parameter import placed
from ..fit import KIND, Fit
from ..holding import restated
from ..how import Say, quiet
from ..uncertainty import uncertainty
from ..uncertainty.beyond_noise import beyond_noise
from . import abc_smc, mcmc
from .abc_smc import Distance, Growing, ParticleSet
from .density import PosteriorDensity, Target, Widening
from .laplace import ROUNDS, weighted_draws
from .mcmc import BURN_IN, Ensemble
from .posterior import Method, Posterior, identity

KEEP_EVERY = 2.0
"""Seconds between two savings of an unfinished run."""
MOST_DRAWS = 1_000_000

Keep = Callable[[Posterior], None]
"""Saves an unfinished run."""


@dataclass(frozen=True)
class SampleOptions:
    """Options of sampling.

    Attributes
    ----------
    method : "laplace" draws from the fit's normal distribution and weights the draws by the posterior; "mcmc" draws
        from the posterior, by walkers that emcee moves; "abc-smc" by distances alone, without a likelihood.
    draws : number of draws; for abc-smc of particles.
    seed : seed of all random numbers.
    distance : for abc-smc, "pooled" over all rows, or "trajectories": the mean of each trajectory's distance.

    Raises
    ------
    BadInput : a value cannot be used.
    """

    method: Method = "mcmc"
    draws: int = 2000
    seed: int = 0
    distance: Distance = "pooled"

    def __post_init__(self) -> None:
        for name, words in (("method", get_args(Method)), ("distance", get_args(Distance))):
            must_be_one_of(words, getattr(self, name), f"‹{name}›: there is no")
        for name, least, most in (("draws", 10, MOST_DRAWS), ("seed", 0, 2**63)):
            must_be_whole(getattr(self, name), name, least, most)


def must_suit_sampling(fit: Fit) -> MotionModel:
    """The model of a fit. Raises `BadInput` for fits without a posterior to draw from."""
    no = (
        f"The parameters of {fit.model.name} are the weights of a network, which have no useful posterior. "
        "Fit a model of equations of motion, or train the network from several seeds."
    )
    model = must_be(MotionModel, fit.model, no)
    if all(parameter.fixed for parameter in model.parameters):
        raise BadInput("Every parameter of the fit is fixed: there is nothing to draw. Fit again with free parameters.")
    return model


def sample(
    fit: Fit,
    recordings: Sequence[Recording],
    options: SampleOptions | None = None,
    *,
    begun: Posterior | None = None,
    keep: Keep | None = None,
    say: Say = quiet,
) -> Posterior:
    """Draw from the posterior of a fit's free parameters.

    Parameters
    ----------
    fit : a fit of equations of motion.
    recordings : its training recordings, in the fit's order.
    options : method, draws, seed.
    begun : an earlier run that was interrupted, or had fewer draws; it is continued if it has the same fit, method,
        seed and distance.
    keep : called now and then with the draws so far.
    say : receives progress.

    Returns
    -------
    Posterior. After Ctrl-C it contains the draws so far, with `complete` false.

    Raises
    ------
    BadInput : the fit is of another kind, its parameters are not determined, or emcee is not installed.
    """
    how = options or SampleOptions()
    must_suit_sampling(fit)
    before = begun if begun is not None and _is_of(begun, fit, how) else None
    done = before is not None and before.complete and len(before) == how.draws
    if before is not None and done and (before.with_form or how.method == "abc-smc"):
        return before
    with threadpool_limits(1):
        run = _Run(fit, recordings, how, before, keep, say)
        return {"laplace": run.laplace, "mcmc": run.mcmc, "abc-smc": run.abc_smc}[how.method]()


def _is_of(begun: Posterior, fit: Fit, how: SampleOptions) -> bool:
    """Whether this run can be continued."""
    same = dict(begun.fit) == identity(fit) and (begun.method, begun.seed) == (how.method, how.seed)
    if how.method == "abc-smc":
        return same and dict(begun.options) == _options(how) and not begun.complete
    return same and how.method == "mcmc" and len(begun) <= how.draws


def _options(how: SampleOptions) -> dict[str, Any]:
    return {"distance": how.distance, "particles": how.draws} if how.method == "abc-smc" else {}


class _Run:
    def __init__(
        self,
        fit: Fit,
        recordings: Sequence[Recording],
        how: SampleOptions,
        before: Posterior | None,
        keep: Keep | None,
        say: Say,
    ) -> None:
        self.how, self.before, self.say, self._keep = how, before, say, keep
        self._clock, self._last = time.process_time(), time.monotonic()
        problem, solution = restated(fit, recordings)
        assert isinstance(problem, MotionProblem)
        self.density = PosteriorDensity(problem, solution)
        self._fit, self._problem, self._solution = fit, problem, solution
        self._widened: Widening | None = None
        self._identity, self._source = identity(fit), KIND.text(fit.as_dict())

    def _target(self) -> Target:
        uncertainty_there = uncertainty(self._problem, self._solution.x, self._solution.nodes)
        among = np.ix_(self.density.places, self.density.places)
        target = Target(self.density, uncertainty_there.released_independent[among], uncertainty_there.released[among])
        start = {parameter.name: at.start for parameter, at in placed(self._fit.model.parameters)}
        numbers = [start[coordinate.parameter] + coordinate.entry for coordinate in self.density.coordinates]
        beyond = beyond_noise(self._fit, self._problem, uncertainty_there)[np.ix_(numbers, numbers)]
        self._widened = Widening(target, beyond)
        return target

    def laplace(self) -> Posterior:
        target, count = self._target(), self.how.draws

        def tell(number: int, done: int) -> None:
            again = f", round {number} of at most {ROUNDS}" if number > 1 else ""
            self.say(f"laplace: {done} of {count} draws weighted{again}", passing=True)

        draws = weighted_draws(target, count, self.how.seed, tell)
        chain, draw = np.zeros(len(draws.u)), np.arange(len(draws.u))
        made = self._made(target.to_theta(draws.u), draws.weight, chain, draw, draws.log_density, draws.within)
        return replace(made, complete=draws.complete, pareto_k=draws.k)

    def mcmc(self) -> Posterior:
        kept: list[tuple[Array, Array]] = []
        target = self._target()
        if self.before is not None and self.before.state:
            state = self.before.state
            start = Ensemble(
                int(state["block"]), np.array(state["at"], dtype=float), np.array(state["log_posterior"], dtype=float),
                int(state["accepted"]), int(state["proposed"]),
                np.array(state["burnt"], dtype=float).reshape(-1, *np.shape(state["at"])),
            )  # fmt: skip
            walkers = len(start.at)
            values, logs = target.to_u(self.before.noise_alone), self.before.measure
            order = np.lexsort((self.before.chain, self.before.draw))
            kept = [
                (values[order[k : k + walkers]], logs[order[k : k + walkers]]) for k in range(0, len(order), walkers)
            ]
            kept = kept[: max(start.block - BURN_IN, 0)]
            whole = int(state["whole"])  # complete blocks kept: the last one may be cut to the requested draws
            if whole < len(kept) or (kept and len(kept[-1][0]) < walkers):
                kept[-1] = (start.at, start.log_posterior)
            self.say(f"mcmc: continues after block {start.block}")
        else:
            start = mcmc.begun(target, self.how.seed)
        walkers = len(start.at)
        last_block = BURN_IN + int(np.ceil(self.how.draws / walkers))
        reached = start

        def until(ensemble: Ensemble) -> bool:
            nonlocal reached
            reached = ensemble
            if ensemble.block > BURN_IN:
                kept.append((ensemble.at, ensemble.log_posterior))
            share = ensemble.accepted / ensemble.proposed
            self.say(f"mcmc: block {ensemble.block} of {last_block}, {100 * share:.0f} % accepted", passing=True)
            self._now_and_then(lambda: self._of_chains(target, kept, reached, complete=False))
            return ensemble.block >= last_block

        complete = True
        try:
            if start.block < last_block:
                mcmc.moved(target, start, self.how.seed, until)
        except KeyboardInterrupt:
            complete = False
        return self._of_chains(target, kept, reached, complete)

    def _of_chains(
        self, target: Target, kept: Sequence[tuple[Array, Array]], reached: Ensemble, complete: bool
    ) -> Posterior:
        walkers, d = reached.at.shape
        blocks = len(kept)
        values = target.to_theta(np.concatenate([item for item, _ in kept])) if kept else np.empty((0, d))
        logs = np.concatenate([item for _, item in kept]) if kept else np.empty(0)
        chain, draw = np.tile(np.arange(walkers), blocks), np.repeat(np.arange(blocks), walkers)
        count = min(len(values), self.how.draws)
        state = {
            "block": reached.block, "at": reached.at.tolist(), "log_posterior": reached.log_posterior.tolist(),
            "accepted": reached.accepted, "proposed": reached.proposed, "whole": count // walkers,
            "burnt": reached.burnt.tolist(),
        }  # fmt: skip
        share = reached.accepted / max(reached.proposed, 1)
        weight = np.full(count, 1 / max(count, 1))
        made = self._made(values[:count], weight, chain[:count], draw[:count], logs[:count], share)
        return replace(made, complete=complete, state=state)

    def abc_smc(self) -> Posterior:
        priors, how = abc_smc.priors_of(self.density), self.how
        distances = abc_smc.Distances(self.density, how.distance)
        growing: Growing | None = None
        if self.before is not None and self.before.state:
            population, growing = _restored(self.before)
            self.say(f"abc-smc: continues in population {population.number + 1}")
        else:
            self.say("abc-smc: drawing particles from the priors")
            try:
                population = abc_smc.first(distances, priors, how.draws, how.seed)
            except KeyboardInterrupt:
                nothing = np.empty(0)
                empty = self._made(np.empty((0, len(priors))), nothing, nothing, nothing, nothing, 0.0)
                return replace(empty, complete=False)

        def until(result: Growing) -> bool:
            nonlocal growing
            growing = result
            line = f"abc-smc: population {population.number + 1} of {len(abc_smc.TARGETS)}, {len(result.at)} of "
            self.say(f"{line}{how.draws} particles, distance below {result.threshold:.4g}", passing=True)
            self._now_and_then(lambda: self._of_particles(population, growing, complete=False))
            return False

        try:
            while population.number < len(abc_smc.TARGETS):
                growing = growing or abc_smc.begin(distances, population, priors, how.seed)
                following = abc_smc.grow(distances, growing, priors, how.seed, until)
                assert isinstance(following, ParticleSet)
                growing = None
                if following is population:
                    self.say("abc-smc: stopped early, since hardly any closer particles were found")
                    break
                population = following
                line = f"abc-smc: population {population.number}, distance below {population.threshold:.4g}, "
                self.say(f"{line}{100 * population.acceptance:.1f} % accepted")
                self._now_and_then(partial(self._of_particles, population, None, complete=False))
        except KeyboardInterrupt:
            return self._of_particles(population, growing, complete=False)
        return self._of_particles(population, None, complete=True)

    def _of_particles(self, particle_set: ParticleSet, growing: Growing | None, complete: bool) -> Posterior:
        count = len(particle_set.at)
        zero = np.zeros(count)
        made = self._made(
            particle_set.at, particle_set.weight, zero, np.arange(count), particle_set.distance, particle_set.acceptance
        )
        state: dict[str, Any] = {"population": particle_set.number, "threshold": particle_set.threshold}
        if growing is not None:
            state |= {
                "growing": {
                    "threshold": growing.threshold, "batches": growing.batches, "simulated": growing.simulated,
                    "at": growing.at.tolist(), "distance": growing.distance.tolist(),
                }
            }  # fmt: skip
        return replace(made, complete=complete, state=state)

    def _made(
        self, values: Array, weight: Array, chain: ArrayLike, draw: ArrayLike, measure: Array, acceptance: float
    ) -> Posterior:
        spent, simulated = time.process_time() - self._clock, self.density.evaluations
        if self.before is not None:
            spent, simulated = spent + self.before.cpu_seconds, simulated + self.before.evaluations
        wide = values if self._widened is None else self._widened(values)
        return Posterior(
            method=self.how.method, coordinates=self.density.coordinates, values=wide, noise_alone=values,
            weight=weight, chain=np.asarray(chain, float), draw=np.asarray(draw, float), measure=measure,
            acceptance=acceptance, evaluations=simulated, cpu_seconds=spent, seed=self.how.seed, complete=True,
            fit=self._identity, options=_options(self.how), source=self._source, with_form=self._widened is not None,
        )  # fmt: skip

    def _now_and_then(self, made: Callable[[], Posterior]) -> None:
        if self._keep is not None and time.monotonic() - self._last > KEEP_EVERY:
            self._keep(made())
            self._last = time.monotonic()


def _restored(before: Posterior) -> tuple[ParticleSet, Growing | None]:
    state = before.state
    particle_set = ParticleSet(
        int(state["population"]), before.values, before.weight, before.measure, float(state["threshold"]),
        before.acceptance,
    )  # fmt: skip
    stored = state.get("growing")
    if stored is None:
        return particle_set, None
    at = np.array(stored["at"], dtype=float).reshape(-1, before.values.shape[1])
    distance = np.array(stored["distance"], dtype=float)
    return particle_set, Growing(
        particle_set, float(stored["threshold"]), int(stored["batches"]), int(stored["simulated"]), at, distance
    )
