"""Which number of a vehicle differs beyond its scatter: each that may change is tried, and recordings decide.

An effect is one of these numbers with its prior widened. Its gain is the difference of two log evidences, by Laplace's
approximation. Recordings that chose nothing, or halves of those that did, decide: with the magnitude held, and all else
under the prior of any run.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from ...base.shorthands import Array
from ..estimation.calibration import CAL
from .between_runs import Common, RunExplained, change_sds, explained
from .innovations import FollowedRun


@dataclass(frozen=True)
class Promising:
    """An effect on recordings from after, as a change beyond scatter.

    Attributes
    ----------
    place : index of its number.
    covariance : prior covariance of all numbers, widened for this one.
    starts : where refits begin.
    gain : expected, in log-likelihood.
    """

    place: int
    covariance: Array
    starts: tuple[Array, ...]
    gain: float


@dataclass(frozen=True)
class Change:
    """An effect that was refitted.

    Attributes
    ----------
    place : index of its number.
    shift : its change beyond scatter, in its coordinate, and the standard deviation of that.
    gain, held_out : log evidence gained where it was chosen, log-likelihood gained where it was judged.
    apart : whether it was judged on other recordings than it was chosen on.
    beyond : size of the change, over the width of what a change may be.
    cost : log evidence that it must gain on all recordings.
    """

    place: int
    shift: tuple[float, float]
    gain: float
    held_out: float
    apart: bool = True
    beyond: float = 0.0
    cost: float = CAL.cost_changed

    @property
    def total(self) -> float:
        """Log evidence of all recordings: that of separate ones adds up."""
        return self.gain + (self.held_out if self.apart else 0.0)

    @property
    def least(self) -> float:
        """Least margin of its gains over those required: of all recordings, where chosen, and where judged."""
        if self.beyond > CAL.reach_sd:
            return -np.inf
        return min(self.total - self.cost, min(self.gain, self.held_out) - CAL.cost_held_out)


def changes(
    known: Common,
    rides: Sequence[FollowedRun],
    others: Sequence[FollowedRun],
    halves: Sequence[Sequence[FollowedRun]] = (),
    nameless: Sequence[str] = (),
    cost: float = CAL.cost_changed,
) -> tuple[RunExplained, list[Change]]:
    """Explanations of recordings from after without a change, and with each of the most promising ones; best first.

    Parameters
    ----------
    known : of the recordings from before.
    rides : on which magnitudes are chosen.
    others : on which changes are judged; if there are none,
    halves : of `rides`, each of which judges what the other one chose.
    nameless : numbers that may differ between runs and are no change.
    cost : what a change must gain.
    """
    weigher, V = known.weigher, known.of_a_run
    information = np.sum([weigher.curve(ride, known.x).H for ride in rides], axis=0)
    moved = [k for k in range(len(V)) if k in known.varying or information[k, k] * V[k, k] > CAL.matters]

    def without(rides: Sequence[FollowedRun], mean: Array, start: Array) -> RunExplained:
        return explained(weigher, rides, start, mean, V, moved)

    base = without(rides, known.x, known.x)
    judges = [[ride] for ride in others] or halves
    plain = [without(judge, known.x, base.x if halves else known.x) for judge in judges]
    named = [j for j in known.varying if known.numbers[j].name not in nameless]
    promising = sorted((_promising(known, base, rides, j) for j in named), key=lambda item: -item.gain)
    tried = [item for k, item in enumerate(promising[: CAL.refitted]) if k == 0 or item.gain > CAL.enough]
    refits = [(item, *_refitted(known, rides, item, moved)) for item in tried]
    if refits:  # both sides of the comparison must have had the same starts
        nearest = min((best for _, best, _ in refits), key=lambda one: one.cost)
        again = without(rides, known.x, nearest.x)
        if again.cost < base.cost:
            base = again
            refits = [(item, *_refitted(known, rides, replace(item, starts=(base.x,)), moved, [best]))
                      for item, best, _ in refits]  # fmt: skip
    result = list[Change]()
    for item, best, shift in refits:
        occam = 0.5 * (_log_det(item.covariance) - _log_det(V) + _log_det(best.H) - _log_det(base.H))
        sd = float(change_sds(best.information, V)[item.place])
        shifts = [shift] * len(judges)
        if not others:
            near = replace(item, starts=(best.x,))
            shifts = [_refitted(known, half, near, moved)[1] for half in reversed(halves)]
        held = 0.0
        for judge, alone, by in zip(judges, plain, shifts, strict=True):
            mean = known.x.copy()
            mean[item.place] += by
            there, least = without(judge, mean, alone.x + mean - known.x), alone.cost
            if there.cost > least:  # either may be in a local optimum
                there = min(there, without(judge, mean, alone.x), key=lambda one: one.cost)
            elif least - there.cost > CAL.cost_held_out:
                least = min(least, without(judge, known.x, there.x).cost)
            held += least - there.cost
        width = known.numbers[item.place].change
        gain = base.cost - best.cost - occam
        result.append(Change(item.place, (shift, sd), gain, held, bool(others), abs(shift) / width, cost))
    return base, sorted(result, key=lambda item: (-item.least, -item.total))


def _refitted(
    known: Common,
    rides: Sequence[FollowedRun],
    promising: Promising,
    moved: Sequence[int],
    result: Sequence[RunExplained] = (),
) -> tuple[RunExplained, float]:
    """The best explanation with the prior widened, or one of `result`, and the change of its number beyond scatter."""
    weigher, V = known.weigher, known.of_a_run
    tried = [explained(weigher, rides, x, known.x, promising.covariance, moved) for x in promising.starts]
    best = min([*result, *tried], key=lambda one: one.cost)
    widened = promising.covariance[promising.place, promising.place] - V[promising.place, promising.place]
    return best, float(widened * np.linalg.solve(promising.covariance, best.x - known.x)[promising.place])


def _promising(known: Common, base: RunExplained, rides: Sequence[FollowedRun], place: int) -> Promising:
    """An effect's expected gain: from the base, a Gauss-Newton step from there, and magnitudes that are tried."""
    number, V = known.numbers[place], known.of_a_run
    width = number.change
    wide = V.copy()
    wide[place, place] += width**2
    precision = np.linalg.inv(wide)

    def cost(x: Array) -> float:
        off = x - known.x
        return sum(known.weigher.cost(ride, x) for ride in rides) + 0.5 * float(off @ precision @ off)

    g = base.pull + precision @ (base.x - known.x)
    tried = [base.x, base.x - np.linalg.solve(base.information + precision, g)]
    for others in (base.x, known.x):  # in the base, other numbers may have absorbed the change
        for reach in CAL.changed_starts:
            x = others.copy()
            x[place] = np.clip(known.x[place] + reach * width, number.low, number.high)
            tried.append(x)
    costs = [cost(x) for x in tried]
    best = int(np.argmin(costs))
    starts = (tried[best],) if best < 2 else (tried[best], base.x)
    return Promising(place, wide, starts, base.cost - costs[best])


def _log_det(A: Array) -> float:
    return float(np.linalg.slogdet(A)[1])
