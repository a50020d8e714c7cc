"""The joint search: all coordinates of a problem, every cause's among them, are refitted while model error is annealed.

Model error begins several times its usual size, so that at first only large and steady deviations move coordinates;
details come last. Each stage is a hypothesis of its own: a scale of model error, and the set of causes included at it.
Stages are compared by their marginal likelihoods, so that model error of several per cent without any cause may win.
Causes that a recording does not support shrink to their zones by evidence maximisation (`sparse`).
"""

from __future__ import annotations

from collections.abc import Callable
from copy import copy
from dataclasses import dataclass, replace

import numpy as np

from ...base.shorthands import Array, Mask
from .bench import Bench
from .calibration import CAL
from .constancy import discounted
from .model_error import (
    AmplitudePrior,
    Amplitudes,
    ForceSizes,
    Linearised,
    ModelError,
    at_least,
    estimated,
    linearised,
    model_error,
    scaled,
    sizes_of,
)
from .noise import Whitener, colour, white_noise
from .problem import JointProblem, JointState
from .sparse import Behind, Quadratic, Sets
from .steps import DampedSteps


@dataclass(frozen=True)
class JointStage:
    """The best explanation of the recordings at one scale of model error.

    Attributes
    ----------
    error_scale : model error over its usual size.
    state : coordinates.
    included : (causes,) inclusion mask.
    whitener : of this model error.
    quadratic : normal equations about the state.
    sets : scores of inclusion masks about the state.
    error_evidence : log prior density of the model error, less the sum of the logarithms of its innovations' sds.
    """

    error_scale: float
    state: JointState
    included: Mask
    whitener: Whitener
    quadratic: Quadratic
    sets: Sets
    error_evidence: float

    @property
    def cause_evidence(self) -> float:
        """Log evidence of its causes, given its model error."""
        return self.sets.base + self.sets.score(self.included)

    @property
    def evidence(self) -> float:
        """Log marginal likelihood with priors of model error and causes; -inf where simulations diverge."""
        total = self.error_evidence + self.cause_evidence
        return total if np.isfinite(total) else -np.inf


class JointWhitening:
    """How residuals are whitened at a given scale of model error.

    Parameters
    ----------
    problem, sd, prior : the problem, noise of the channels, prior of model error.
    forces : whether the model has unknown forces; else residuals are whitened as autoregressive processes.
    trust : how many independent readings one counts as.
    """

    def __init__(self, problem: JointProblem, sd: Array, prior: AmplitudePrior, forces: bool, trust: float) -> None:
        self.problem, self.sd, self.prior, self.trust = problem, sd, prior, trust
        self._bench = problem.bench if forces and isinstance(problem.bench, Bench) else None
        self._sizes = ForceSizes(self._bench) if self._bench is not None else None
        self._last: Amplitudes | None = None

    def about(self, p: Array) -> Linearised | None:
        """Error dynamics about the simulation with these parameters; None without unknown forces."""
        if self._bench is None or self._sizes is None:
            return None
        return linearised(self._bench, p, self.sd, self._sizes)

    def usual(self, about: Linearised | None, error_scale: float) -> Whitener:
        """Whitening by model error `error_scale` times its usual size."""
        if about is None:
            return white_noise(self.sd * error_scale / np.sqrt(self.trust), self.problem.good, self.problem.bench.rows)
        return model_error(about, scaled(self.prior.median, error_scale), self.problem.good)

    def left(self, about: Linearised | None, e: Array, least: bool = True) -> Whitener:
        """Whitening by the model error that residuals `e` show.

        With `least`, it is no smaller than usual: where causes are weighed, too small a model error would favour small
        spurious ones.
        """
        if not np.all(np.isfinite(e)):  # diverging simulations say nothing about model error
            return self.usual(about, 1.0)
        if about is None:
            return colour(e, self.problem.good, self.problem.bench.rows)
        result = self._last = estimated(about, e, self.problem.good, self.prior, self._last)
        return model_error(about, at_least(result, self.prior.median) if least else result, self.problem.good)


def late_alike(problem: JointProblem) -> list[tuple[int, int]]:
    """Pairs of causes that delay the same readings, of those that are there: they are one."""
    read = {name for name, there in zip(problem.bench.channels, np.any(problem.good, axis=0), strict=True) if there}
    delayed = {
        k: frozenset(reads) for k, cause in enumerate(problem.causes)
        if cause.main.shift and (reads := cause.forms[0].candidate.reads & read)
    }  # fmt: skip
    return [(a, b) for a in delayed for b in delayed if a < b and delayed[a] == delayed[b]]


class JointSearch:
    """The joint search.

    Parameters
    ----------
    problem, whitening : what is explained, and how its residuals are whitened.
    tell : receives progress.
    """

    def __init__(self, problem: JointProblem, whitening: JointWhitening, tell: Callable[..., None]) -> None:
        self.problem, self.whitening, self.tell, self.steps = problem, whitening, tell, DampedSteps(problem)
        names = [cause.name for cause in problem.causes]
        self.never = [
            (a, b) for a, cause in enumerate(problem.causes) for b, other in enumerate(names)
            if other in cause.forms[0].candidate.never_beside
        ]  # fmt: skip
        self.late_alike = late_alike(problem)
        self.never += self.late_alike
        self.odds = np.full(len(names), CAL.against)
        for k, cause in enumerate(problem.causes):
            self.odds[k] += CAL.second_odds * len(cause.forms[0].seconds)

    def by_steps(self, stride: float) -> JointSearch:
        """The search with steps of at most `stride` prior sds of parameters and usual sizes of causes."""
        other = copy(self)
        other.steps = DampedSteps(self.problem, stride)
        return other

    def annealed(self) -> list[JointStage]:
        """The stage of each scale of model error, largest first."""
        problem, result = self.problem, list[JointStage]()
        problem.set_error_scale(1.0)
        problem.forget()
        state, variance = problem.begin(), (0.3 * problem.usual) ** 2
        steps_of = CAL.steps_of_stage_with_tolerances if len(problem.tolerances) else CAL.steps_of_stage
        for error_scale, steps in zip(CAL.error_scales, steps_of, strict=True):
            moved = problem.set_error_scale(error_scale, state)
            assert moved is not None
            state = moved
            whitener = self.whitening.usual(self.whitening.about(problem.vector(state)), error_scale)
            variance = np.maximum(variance, (0.3 * problem.usual) ** 2)  # what was switched off before may come back
            for step in range(steps):
                state, quadratic = self._linear(state, whitener, step == 0, variance)
                variance = quadratic.switched(variance, problem.zone, problem.usual)
                state, last = self._stepped(state, quadratic, variance, whitener)
                if last and step > 0:
                    break
            result.append(self.settled(state, error_scale, variance, whitener))
        return result

    def explained(self, best: JointStage) -> JointStage:
        """The best stage at the scale of model error that its unknown forces show.

        Errors that unknown forces absorb, random in time, indicate model-form errors of the same scale, which are
        constant: priors of the latter are widened to it, and causes must gain beside these, unless the evidence is
        against so large a scale. Where model error is much larger than usual, the stage without any cause, from the
        prior means, is tried too.
        """
        for _ in range(CAL.scale_changes):
            error_scale = self._shown_error_scale(best)
            if max(error_scale / best.error_scale, best.error_scale / error_scale) < CAL.scale_change:
                break
            self.problem.set_error_scale(best.error_scale)
            result = [self._settled_at(best.state, best.included, error_scale)]
            if error_scale > CAL.scale_without_causes:
                self.problem.set_error_scale(1.0)
                result.append(self._settled_at(self.problem.begin(), np.zeros_like(best.included), error_scale))
            again = max(result, key=lambda item: item.evidence)
            if not np.isfinite(again.evidence):  # with such form errors, tyre curves overflow
                break
            if error_scale > best.error_scale and again.evidence < best.evidence:
                break
            best = again
        self.problem.set_error_scale(best.error_scale)
        self.problem.forget()
        return best

    def exchanged(self, stage: JointStage) -> JointStage:
        """The stage with abrupt causes exchanged for others that act alike, where these explain more.

        First order says little about delays, lags, limits and plays: each that is included was the best of them when
        all else was still unfitted. The others are therefore refitted in its place.
        """
        better = stage
        for k in (int(abrupt) for abrupt in np.flatnonzero(stage.included & ~self.problem.smooth)):
            if not better.included[k]:
                continue
            for j, form in self._substitutes(better, k):
                swap = better.included.copy()
                swap[k], swap[j] = False, True
                formed = replace(better, state=self.problem.formed(better.state, j, form))
                behind = Behind(swap, better.cause_evidence)
                tried = self.refitted(formed, swap, CAL.exchange_steps, trial=True, decided=behind)
                if tried.cause_evidence > better.cause_evidence:  # given the same model error
                    better, k = tried, j
        if better is stage:
            return stage
        self.problem.forget()
        return self.settled(
            better.state, better.error_scale, self.variance(better.included), rounds=2, included=better.included
        )

    def _substitutes(self, stage: JointStage, k: int) -> list[tuple[int, int]]:
        """(cause, form) pairs to replace cause k: its other forms, then causes with similar columns, nearest first."""
        causes, like = self.problem.causes, self._alike(stage)[k]
        others = [int(j) for j in np.flatnonzero(~stage.included & (like > CAL.acts_alike))]
        others = sorted(others, key=lambda j: -like[j])[: CAL.exchanged]
        itself = [(k, form) for form in range(len(causes[k].forms)) if form != stage.state.form[k]]
        return [*itself, *((j, form) for j in others for form in range(len(causes[j].forms)))]

    def _settled_at(self, state: JointState, included: Mask, error_scale: float) -> JointStage:
        """A stage settled at another scale of model error."""
        moved = self.problem.set_error_scale(error_scale, state)
        self.problem.forget()
        return self.settled(moved or state, error_scale, self.variance(included), rounds=CAL.rounds_at_scale)

    def _shown_error_scale(self, stage: JointStage) -> float:
        """Unknown forces over their usual size, at least one."""
        if not isinstance(stage.whitener, ModelError):
            return 1.0
        _, over_usual = sizes_of(stage.whitener.about, stage.whitener.amplitudes, self.whitening.prior.median)
        return max(1.0, over_usual)

    def pruned(self, stage: JointStage, prices: Array, unsteady: Array, gains: Array) -> tuple[JointStage, Array]:
        """Drop the causes that gain less than they must, and add those that gain enough beside the rest.

        Each removal refits everything else, and linearises again where that may decide.

        Parameters
        ----------
        prices : (causes,) log-likelihood that each must gain.
        unsteady : (causes,) how magnitudes differ between parts of the drive, see `constancy.unsteadiness`.
        gains : (causes,) gains before other causes were dropped, zero where unknown. Those far above the required ones
            are computed again only once no other cause is dropped.

        Returns
        -------
        stage, gains : the stage, and what each of its causes gains, (causes,) zero for those not included.
        """
        dismissed, together = np.zeros(len(stage.included), dtype=bool), set[tuple[int, int]]()
        returned = np.zeros_like(dismissed)
        known = bool(np.all(gains[stage.included] > 0))  # by an earlier call, which returned this stage
        while True:
            stage = stage if known else self._converged(stage)
            beyond = stage.sets.beyond(stage.included)
            if np.any(beyond):
                gains = np.where(beyond, 0.0, gains)
            elif not known:
                gains = self._gains(stage, prices, unsteady, gains)
            known, steady = False, discounted(gains, unsteady)
            weak = list(np.flatnonzero(beyond if np.any(beyond) else stage.included & ~(steady >= prices)))
            if weak:
                dismissed[weak] = True
                weak.sort(key=lambda k: steady[k] - prices[k])
                included = stage.included.copy()
                included[weak[: -(-len(weak) // 2)]] = False  # half of them at once
                rest = self.refitted(stage, included, CAL.exchange_steps)
                if rest.sets.cost(included) < stage.sets.cost(stage.included) - CAL.enough:
                    # with them a refit had not found its optimum, so what they gain beside the rest is not known yet
                    back = stage.included & dismissed & ~returned
                    dismissed[back], returned[back] = False, True
                stage = rest
                continue
            other = self._without_both(stage, prices, together)
            if other is None:
                other = self._with_another(stage, prices, unsteady, dismissed)
            if other is None:
                return stage, gains
            stage = other

    def _converged(self, stage: JointStage) -> JointStage:
        """The stage refitted until its cost falls no further."""
        if not np.any(stage.included):
            return stage
        for _ in range(CAL.refits_of_set):
            again = self.refitted(stage, stage.included, CAL.exchange_steps)
            fell = stage.sets.cost(stage.included) - again.sets.cost(again.included)
            stage = again
            if fell < CAL.enough and not np.any(stage.sets.beyond(stage.included)):
                break
        return stage

    def _gains(self, stage: JointStage, prices: Array, unsteady: Array, before: Array) -> Array:
        """What each cause of a stage gains beside the others.

        Gains far above the required ones are computed last, and not at all where other causes will be dropped anyway.
        """
        gains = np.where(stage.included, before, 0.0)
        far = discounted(gains, unsteady) >= CAL.doubted * prices
        for due in (stage.included & ~far, stage.included & far):
            for k in np.flatnonzero(due):
                gains[k] = self._gained(stage, int(k), prices[k])
            if np.any(stage.included & ~(discounted(gains, unsteady) >= prices)):
                break
        return gains

    def _without_both(self, stage: JointStage, prices: Array, dismissed: set[tuple[int, int]]) -> JointStage | None:
        """The stage without two causes that cancel each other and gain too little together; each pair is tried once.

        Each seems needed beside the other: one raises grip, the other one takes it away.
        """
        like, included = self._alike(stage), np.flatnonzero(stage.included)
        gradual = [cause.gradual for cause in self.problem.causes]
        for a, b in ((int(a), int(b)) for a in included for b in included if a < b and like[a, b] > CAL.acts_alike):
            if (a, b) in dismissed:
                continue
            rest, price = stage.included.copy(), prices[a] + prices[b]
            rest[[a, b]] = False
            gain = stage.sets.cost(rest) - stage.sets.cost(stage.included)
            if gradual[a] and gradual[b] and gain > CAL.doubted * price:  # as for a single cause, see `_gained`
                continue
            dismissed.add((a, b))
            without = self.refitted(stage, rest, CAL.exchange_steps, trial=True)
            if without.sets.cost(rest) - stage.sets.cost(stage.included) < price:
                return self.refitted(without, rest, 1)
        return None

    @staticmethod
    def _alike(stage: JointStage) -> Array:
        """(causes, causes) absolute cosines between the causes' columns, all else refitted."""
        S = stage.sets.S[np.ix_(stage.sets.main, stage.sets.main)]
        size = np.sqrt(np.maximum(np.diag(S), 1e-300))
        return np.asarray(np.abs(S) / np.outer(size, size))

    def _with_another(self, stage: JointStage, prices: Array, unsteady: Array, dismissed: Mask) -> JointStage | None:
        """The stage with one more cause that gains enough once all is refitted, none of those `dismissed`."""
        while (new := self._worth_adding(stage, prices, unsteady, dismissed)) is not None:
            dismissed[new] = True
            included, gains = stage.included.copy(), np.zeros(len(dismissed))
            included[new] = True
            tried = self.refitted(stage, included, trial=True)
            if tried.sets.beyond(included)[new]:  # a step overshot, or no magnitude within the bounds fits
                tried = self.refitted(tried, included, CAL.exchange_steps, trial=True)
            if not tried.sets.beyond(included)[new]:
                gains[new] = self._gained(tried, new, prices[new])
            if discounted(gains, unsteady)[new] >= prices[new]:
                return self.refitted(tried, included, 1)
        return None

    def _worth_adding(self, stage: JointStage, prices: Array, unsteady: Array, dismissed: Mask) -> int | None:
        """The cause that gains most beside a stage's, to first order, if that is enough; `dismissed` ones are left out.

        Its magnitude may go to its bounds: a refit corrects what the secant does not hold for.
        """
        sets = stage.sets.reaching(self.problem.low, self.problem.high)
        here, best, most = sets.cost(stage.included), None, 0.0
        for k in np.flatnonzero(~stage.included & ~dismissed):
            included = stage.included.copy()
            included[k] = True
            worth = float(discounted(here - sets.cost(included), unsteady[k])) - prices[k]
            if worth > most and sets.score(included) > sets.score(stage.included):
                best, most = int(k), worth
        return best

    def _gained(self, stage: JointStage, k: int, price: float) -> float:
        """Log-likelihood that a cause gains beside the others of a stage."""
        problem, included = self.problem, stage.included.copy()
        at_null = abs(stage.state.m[k] - problem.null[k]) < CAL.next_to_nothing * problem.usual[k]
        if at_null and not problem.smooth[k]:
            return 0.0  # simulated with no effect
        included[k] = False
        here, gradual = stage.sets.cost(stage.included), problem.causes[k].gradual
        gains = [stage.sets.cost(included) - here]
        if gradual and not price <= gains[0] < CAL.doubted * price:
            return gains[0]

        def decided(sets: Sets) -> bool:  # never by too small a gain: those that are furthest off leave first
            gains.append(sets.cost(included) - here)
            return gains[-1] >= max(CAL.doubted * price, price + CAL.steps_behind * abs(gains[-1] - gains[-2]))

        simulated = self.refitted(stage, included, trial=True, decided=decided).sets.cost(included) - here
        return min(gains[0], simulated) if gradual else simulated  # first order says little about abrupt ones

    def refitted(
        self, stage: JointStage, included: Mask, steps: int = CAL.refits, trial: bool = False,
        decided: Callable[[Sets], bool] | None = None,
    ) -> JointStage:  # fmt: skip
        """A stage with another set of causes, everything refitted in the same model error.

        On trial, abrupt causes that are not included keep their last columns: they stay within their zones. Scores of
        sets that are `decided` end the refit.
        """
        state, quadratic, variance = stage.state, stage.quadratic, self.variance(included)
        if not trial:
            self.problem.forget()
        while steps > 0:
            about_it = not np.any(
                state.on & ~included & ~self.problem.smooth
            )  # else once more, without causes that left
            moved, last = self._stepped(state, quadratic, variance, stage.whitener, included, trial)
            if about_it and last and quadratic is not stage.quadratic:  # a step that gains next to nothing is not taken
                break
            state, quadratic = self._linear(moved, stage.whitener, False, variance)
            steps -= about_it
            if (about_it and last) or (decided is not None and decided(self._sets(quadratic))):
                break
        return replace(stage, state=state, included=included, quadratic=quadratic, sets=self._sets(quadratic))

    def settled(
        self,
        state: JointState,
        error_scale: float,
        variance: Array,
        whitener: Whitener | None = None,
        rounds: int = 1,
        included: Mask | None = None,
    ) -> JointStage:
        """A stage with its best set of causes, all refitted with it, in the model error that its residuals show.

        Parameters
        ----------
        state, error_scale, variance : coordinates, scale of model error, prior variances of magnitudes.
        whitener : of the first round; None: of the model error that residuals at the state show.
        rounds : of refits at most.
        included : the inclusion mask, where it is given.
        """
        known = included is not None
        if included is None:
            included = np.sqrt(variance) > np.maximum(CAL.likely_included * self.problem.usual, 2 * self.problem.zone)
        best: JointStage | None = None
        for step in range(rounds + 1):
            by = whitener if whitener is not None and step < rounds else self._of_what_is_left(state)
            state, quadratic = self._linear(state, by, False, self.variance(included))
            sets = self._sets(quadratic)
            included = included if known else sets.climbed(included)
            stage = JointStage(error_scale, state, included, by, quadratic, sets, self._of_whitener(by, error_scale))
            if by is not whitener and (best is None or not stage.evidence < best.evidence):
                best = stage
            if step == rounds:
                break
            state, last = self._stepped(state, quadratic, self.variance(included), by, included)
            if last and by is not whitener:
                break
        assert best is not None
        return best

    def _of_what_is_left(self, state: JointState) -> Whitener:
        p = self.problem.vector(state)
        (e,) = self.problem.residuals([p])
        return self.whitening.left(self.whitening.about(p), e)

    def _of_whitener(self, whitener: Whitener, error_scale: float) -> float:
        form = -0.5 * float(np.log(error_scale) / CAL.error_scale_sd) ** 2
        if not isinstance(whitener, ModelError):
            return form
        prior = float(self.whitening.prior.cost(whitener.amplitudes.logarithms))
        return form - prior - float(np.sum(np.log(whitener.size)))

    def variance(self, included: Mask) -> Array:
        """(causes,) prior variances of magnitudes: of the slab for causes in the set, else of the spike."""
        spike = self.problem.zone**2
        return np.where(included, np.maximum(self.problem.usual**2, 9 * spike), spike)

    def _sets(self, quadratic: Quadratic) -> Sets:
        return Sets(quadratic, self.problem.zone, self.problem.usual, self.odds, self.never)

    def _linear(
        self, state: JointState, whitener: Whitener, probe: bool, variance: Array
    ) -> tuple[JointState, Quadratic]:
        state, linear = self.problem.linearise(state, whitener, probe, 1 / variance)
        return state, Quadratic.of(linear)

    def _stepped(
        self, state: JointState, quadratic: Quadratic, variance: Array, whitener: Whitener,
        included: Mask | None = None, trial: bool = False,
    ) -> tuple[JointState, bool]:  # fmt: skip
        step = self.steps.taken(state, quadratic, variance, whitener, included)
        if step.gained > CAL.moved_on and not trial:  # those that are switched off are probed anew at each scale
            self.problem.forget(variance > 4 * self.problem.zone**2)
        return step.state, step.last
