"""Which numbers of a vehicle differ beyond their scatter: sets of changes are tried, and recordings decide.

A change is one of these numbers with its prior widened. What a set of them gains is the difference of two log
evidences, by Laplace's approximation. Recordings that chose nothing, or halves of those that did, decide: with the
magnitudes held, and all else under the prior of any run. Sets grow by one change at a time; once a set is the best one,
each of its changes is removed in turn, and others are tried in its place.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.special import logsumexp

from ...base.shorthands import Array
from ..estimation.calibration import CAL
from .between_runs import Common, RunExplained, change_sds, explained
from .innovations import FollowedRun

Places = frozenset[int]
"""Indices of the numbers that changed."""
NONE: Places = frozenset()


@dataclass(frozen=True)
class ChangedSet:
    """Recordings from after, explained with a set of changes.

    Attributes
    ----------
    explained : the recordings on which sizes are chosen.
    judged : each recording, or half, on which the set is judged, with sizes held.
    shift : (n,) changes beyond scatter, in their coordinates; zero for all others.
    means : prior means with which each of `judged` was explained.
    """

    explained: RunExplained
    judged: tuple[RunExplained, ...]
    shift: Array
    means: tuple[Array, ...]


@dataclass(frozen=True)
class Change:
    """A change that was refitted, beside the others of its set.

    Attributes
    ----------
    sd : standard deviation of its change beyond scatter, in its coordinate.
    beyond : size of the change, over the width of what a change may be.
    total : log evidence that it gains on all recordings.
    least : see `margin`.
    """

    sd: float
    beyond: float
    total: float
    least: float


def margin(total: float, gain: float, held_out: float, beyond: float, cost: float, count: int = 1) -> float:
    """Margin of the gain of some changes over what is required of each: on all recordings, or the least margin.

    Log evidences of recordings add up, the judging ones given what the others chose. Where these gain less than
    required, or those where changes were chosen, the smallest of the three margins counts.

    Parameters
    ----------
    total, gain, held_out : log evidence on all recordings, and where changes were chosen; log-likelihood where judged.
    beyond : size of the largest change, over the width of what a change may be.
    cost : log evidence that each must gain on all recordings.
    """
    if beyond > CAL.reach_sd:
        return -np.inf
    everywhere = min(gain, held_out) - count * CAL.cost_held_out
    return total - count * cost if everywhere > 0 else min(total - count * cost, everywhere)


class ChangeSearch:
    """Sets of changes of recordings from after.

    Parameters
    ----------
    known : of the recordings from before.
    rides : on which sizes are chosen.
    others : on which changes are judged; if there are none,
    halves : of `rides`, each of which judges what the other one chose.
    nameless : numbers that may differ between runs and are no change.
    cost : what a change must gain.

    Attributes
    ----------
    sets : that were tried, by their places.
    """

    def __init__(
        self,
        known: Common,
        rides: Sequence[FollowedRun],
        others: Sequence[FollowedRun],
        halves: Sequence[Sequence[FollowedRun]] = (),
        nameless: Sequence[str] = (),
        cost: float = CAL.cost_changed,
    ) -> None:
        self.known, self.rides, self.cost, self.apart = known, rides, cost, bool(others)
        self._halves = [] if others else [*halves]
        self._judges: list[Sequence[FollowedRun]] = [[ride] for ride in others] or self._halves
        V = known.of_a_run
        information = np.sum([known.weigher.curve(ride, known.x).H for ride in rides], axis=0)
        self._moved = [k for k in range(len(V)) if k in known.varying or information[k, k] * V[k, k] > CAL.matters]
        self._named = [j for j in known.varying if known.numbers[j].name not in nameless]
        base = self._explained(rides, NONE, known.x, known.x)
        first = base.x if self._halves else known.x
        judged = tuple(self._explained(judge, NONE, known.x, first) for judge in self._judges)
        means = (known.x,) * len(judged)
        self.sets = {NONE: ChangedSet(base, judged, np.zeros_like(known.x), means)}
        self._searched()

    # ---- what sets gain

    def gains(self, places: Places) -> tuple[float, float]:
        """Log evidence that a set gains where it was chosen, and log-likelihood where it was judged."""
        there, none = self.sets[places], self.sets[NONE]
        occam = 0.5 * (
            _log_det(self._prior(places)) - _log_det(self._prior(NONE))
            + _log_det(there.explained.H) - _log_det(none.explained.H)
        )  # fmt: skip
        held_out = sum(alone.cost - one.cost for alone, one in zip(none.judged, there.judged, strict=True))
        return none.explained.cost - there.explained.cost - occam, float(held_out)

    def total(self, places: Places) -> float:
        """Log evidence that a set gains on all recordings."""
        return self._in_all(*self.gains(places))

    def _in_all(self, gain: float, held_out: float) -> float:
        """Log evidence of all recordings: that of separate ones adds up."""
        return gain + (held_out if self.apart else 0.0)

    def weight(self, places: Places) -> float:
        """Log-odds of a set against no change."""
        if not places:
            return 0.0
        beyond = max(self._beyond(places, place) for place in places)
        return margin(self.total(places), *self.gains(places), beyond, self.cost, len(places))

    def change(self, places: Places, place: int) -> Change:
        """A change of a set, beside its others."""
        there, rest = self.sets[places], places - {place}
        gain, held_out = (mine - less for mine, less in zip(self.gains(places), self.gains(rest), strict=True))
        sd = float(change_sds(there.explained.information, self._prior(rest))[place])
        total, beyond = self._in_all(gain, held_out), self._beyond(places, place)
        least = margin(total, gain, held_out, beyond, self.cost)
        return Change(sd, beyond, total, least)

    def sizes(self, places: Places) -> Array:
        """(n,) changes of a set beyond scatter, in their coordinates, as recordings determine them.

        The width of what a change may be is a prior for the choice of sets. Sizes are drawn towards none by it, so it
        is replaced by one that lets them go as far as they may, to first order about the set's optimum.
        """
        there, mean = self.sets[places].explained, self.known.x
        wide = self._prior(places, CAL.reach_sd)
        P = np.linalg.inv(wide)
        x = there.x - np.linalg.solve(there.information + P, there.pull + P @ (there.x - mean))
        low, high = np.array([[number.low, number.high] for number in self.known.numbers]).T
        return self._beyond_scatter(wide, np.clip(x, low, high))

    def best(self, of: Places | None = None) -> Places:
        """The most probable set, of a set's parts or all, of which each change gains what it must beside the others."""
        some = (it for it in self._whole if of is None or it <= of)
        return max((it for it in some if all(self.change(it, place).least > 0 for place in it)), key=self.weight)

    def probability(self, *places: int) -> float:
        """That one of some numbers changed, alone or with others."""
        weights = {it: self.weight(it) for it in self.sets}
        some = [weight for it, weight in weights.items() if not it.isdisjoint(places)]
        return float(np.exp(logsumexp(some) - logsumexp([*weights.values()]))) if some else 0.0

    def likeliest(self, place: int) -> Places:
        """The most probable set in which a number changed, of those that can be compared with all their parts."""
        return max((it for it in self._whole if place in it), key=self.weight)

    def alike(self, places: Places, place: int) -> tuple[int, ...]:
        """Numbers whose change explains the recordings about as well in the place of one of a set."""
        others = {k: places - {place} | {k} for k in self._named if k not in places}
        least = self.weight(places) - CAL.alike
        return tuple(k for k, instead in others.items() if instead in self.sets and self.weight(instead) > least)

    @property
    def tried(self) -> list[int]:
        """Numbers whose change was tried, most probable first."""
        return sorted({k for it in self._whole for k in it}, key=lambda k: -self.weight(self.likeliest(k)))

    @property
    def _whole(self) -> list[Places]:
        """Sets that can be compared with all their parts."""
        return [it for it in self.sets if all(it - {k} in self.sets for k in it)]

    def _beyond(self, places: Places, place: int) -> float:
        """Size of a change of a set, over the width of what a change may be."""
        return abs(float(self.sets[places].shift[place])) / self.known.numbers[place].change

    # ---- the search

    def _searched(self) -> None:
        """Add changes to the best set, and exchange each of its own, until no set is better."""
        self._grow(NONE, self._named)
        done = {NONE}
        while True:
            best = max(self.sets, key=self.weight)
            for place in best:
                if best - {place} not in self.sets:
                    self._shrink(best, place)
            around = [part for part in (best, *(best - {place} for place in best)) if part not in done]
            if not around:
                return
            self._grow(around[0], self._screened(around[0]))
            done.add(around[0])

    def _screened(self, places: Places) -> list[int]:
        """Numbers whose change, in addition to a set, is expected to gain something wherever it is judged."""
        there = self.sets[places]
        s, Q = _scores(there.explained, self.known.x, self._prior(places))
        judged = [_scores(one, mean, self._prior(NONE)) for one, mean in zip(there.judged, there.means, strict=True)]
        result = []
        for place in self._named:
            if places | {place} in self.sets:
                continue
            wide = self.known.numbers[place].change ** 2
            shift = np.zeros_like(s)
            shift[place] = wide * s[place] / (1.0 + wide * Q[place, place])
            for other in places:
                shift[other] = -(self.known.numbers[other].change ** 2) * shift[place] * Q[other, place]
            gain = 0.5 * float(shift[place] * s[place] - np.log1p(wide * Q[place, place]))
            held_out = sum(float(shift @ t - 0.5 * shift @ R @ shift) for t, R in judged)
            if min(gain, held_out) > 0:
                result.append(place)
        return result

    def _grow(self, places: Places, candidates: Sequence[int]) -> None:
        """Refit a set with the most promising ones of further changes."""
        there, promising = self.sets[places], {place: self._promising(places, place) for place in candidates}
        order = sorted(promising, key=lambda place: -promising[place][0])[: CAL.refitted]
        refits = {
            place: self._refitted(self.rides, places | {place}, *promising[place][1])
            for place in order
            if place == order[0] or promising[place][0] > CAL.enough
        }
        if not refits:
            return
        nearest = min(refits.values(), key=lambda one: one.cost)  # both sides of a comparison must have the same starts
        again = self._refitted(self.rides, places, nearest.x)
        if again.cost < there.explained.cost:
            self.sets[places] = replace(there, explained=again)
            for place, refit in refits.items():
                more = self._refitted(self.rides, places | {place}, again.x)
                refits[place] = min(refit, more, key=lambda one: one.cost)
        for place, refit in refits.items():
            self._judge(places | {place}, refit, places)

    def _shrink(self, places: Places, place: int) -> None:
        """Refit a set without one of its changes."""
        there, rest = self.sets[places], places - {place}
        x = there.explained.x
        refit = self._refitted(self.rides, rest, x, x - there.shift * (np.arange(len(x)) == place))
        self._judge(rest, refit, places)

    def _judge(self, places: Places, refit: RunExplained, beside: Places) -> None:
        """Explain the recordings that judge a set, from where they are with a similar one, which may gain by it."""
        shift, other = self._beyond_scatter(self._prior(places), refit.x), self.sets[beside]
        shifts = [shift] * len(self._judges)
        if not self.apart:
            by_half = [self._refitted(half, places, refit.x) for half in reversed(self._halves)]
            shifts = [self._beyond_scatter(self._prior(places), each.x) for each in by_half]
        means = tuple(self.known.x + by for by in shifts)
        judged, improved = list[RunExplained](), list[RunExplained]()
        for judge, alone, before, mean in zip(self._judges, other.judged, other.means, means, strict=True):
            there = self._explained(judge, NONE, mean, alone.x + mean - before)
            if there.cost > alone.cost:  # either may be in a local optimum
                there = min(there, self._explained(judge, NONE, mean, alone.x), key=lambda one: one.cost)
            elif alone.cost - there.cost > CAL.cost_held_out:
                alone = min(alone, self._explained(judge, NONE, before, there.x), key=lambda one: one.cost)
            judged.append(there)
            improved.append(alone)
        self.sets[beside] = replace(other, judged=tuple(improved))
        self.sets[places] = ChangedSet(refit, tuple(judged), shift, means)

    def _promising(self, places: Places, place: int) -> tuple[float, tuple[Array, ...]]:
        """Log-likelihood that a change is expected to gain in addition to a set, and where its refit begins.

        By a Gauss-Newton step from the set's optimum, and magnitudes that are tried.
        """
        known, there, number = self.known, self.sets[places], self.known.numbers[place]
        base, precision = there.explained, np.linalg.inv(self._prior(places | {place}))
        g = base.pull + precision @ (base.x - known.x)
        tried = [base.x, base.x - np.linalg.solve(base.information + precision, g)]
        for others in (base.x, known.x + there.shift):  # in the base, other numbers may have absorbed the change
            for reach in CAL.changed_starts:
                x = others.copy()
                x[place] = np.clip(known.x[place] + reach * number.change, number.low, number.high)
                tried.append(x)
        offs = np.array(tried) - known.x
        costs = 0.5 * np.einsum("ti,ij,tj->t", offs, precision, offs)
        costs += np.sum([known.weigher.costs(ride, tried) for ride in self.rides], axis=0)
        best, afresh = int(np.argmin(costs)), len(tried) - len(CAL.changed_starts)
        second = afresh + int(np.argmin(costs[afresh:]))  # the best one with other numbers as before
        starts = dict.fromkeys((best, second) if best < 2 else (best, second, 0))
        return base.cost - float(costs[best]), tuple(tried[k] for k in starts)

    def _prior(self, places: Places, widths: float = 1.0) -> Array:
        """(n, n) prior covariance of all numbers of a run, widened for a set of changes."""
        V = self.known.of_a_run.copy()
        for place in places:
            V[place, place] += (widths * self.known.numbers[place].change) ** 2
        return V

    def _beyond_scatter(self, covariance: Array, x: Array) -> Array:
        """(n,) changes beyond scatter: parts of deviations that are due to the widening of priors."""
        return np.asarray((covariance - self._prior(NONE)) @ np.linalg.solve(covariance, x - self.known.x))

    def _refitted(self, rides: Sequence[FollowedRun], places: Places, *starts: Array) -> RunExplained:
        return min((self._explained(rides, places, self.known.x, x) for x in starts), key=lambda one: one.cost)

    def _explained(self, rides: Sequence[FollowedRun], places: Places, mean: Array, start: Array) -> RunExplained:
        return explained(self.known.weigher, rides, start, mean, self._prior(places), self._moved)


def _scores(there: RunExplained, mean: Array, covariance: Array) -> tuple[Array, Array]:
    """Derivative of the log evidence by a shift of the prior mean, and its information, to first order."""
    P = np.linalg.inv(covariance)
    off = P @ (there.x - mean)
    by = np.linalg.solve(there.information + P, np.column_stack([P, there.pull + off]))
    return off - P @ by[:, -1], P - P @ by[:, :-1]


def _log_det(A: Array) -> float:
    return float(np.linalg.slogdet(A)[1])
