"""The budget of a gap: which share of the excess error each effect closes, and what is left unexplained.

The value of a set of effects is how far it lowers the mean square of free-run errors; an effect's share is its Shapley
value, the mean of what it adds to every set of the others, over the excess above noise. Shares and the
unexplained rest add up to one. Source: Shapley, A value for n-person games, 1953.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from math import comb
from typing import TypeVar

import numpy as np
from scipy.special import ndtr

from ..base.errors import BadInput
from ..base.shorthands import Array, Mask
from ..base.statistics import NORMAL, resampled
from ..datasets.checks.finding import listed
from ..datasets.recording import Recording
from ..engine.simulation import FreeRuns
from .closed_model import with_effects
from .closing import closed_by, on_held_out
from .estimation.axes import scalars
from .estimation.calibration import CAL
from .estimation.free_runs import Misfit, at_their_best, inliers, misfit, of_subsets, refitted_tolerances, subsets
from .estimation.hypothesis import Hypothesis, by_cost
from .estimation.noise import blocks, white_noise
from .estimation.search import Search
from .estimation.variance import without_stale_rows
from .examining import Examined
from .gap import Budget, Share
from .selection import refitted

Set = frozenset[str]
Refit = TypeVar("Refit", Hypothesis, Misfit)


def budget(
    misfits: Mapping[Set, Misfit],
    names: tuple[str, ...],
    sd: Array,
    good: Mask,
    bench: FreeRuns,
    recordings: tuple[str, ...],
    held_out: bool,
) -> Budget | None:
    """Share out the excess error; None where there is none to share.

    Parameters
    ----------
    misfits : of the model with every set of effects, tolerances refitted.
    sd : (channels,) of noise.
    good : (N, channels) readings that count.
    bench : whose blocks are resampled.
    recordings, held_out : names of those that the misfits are on, and whether these chose nothing.
    """
    sets = subsets(names)
    squares = {item: np.sum(np.where(good, misfits[item].e / sd, 0.0) ** 2, axis=1) for item in sets}
    rows = np.sum(good, axis=1)
    edges = blocks(bench)
    sums = np.array([[np.sum(squares[item][a:b]) for item in sets] + [np.sum(rows[a:b])] for a, b in edges])
    # sets in which the vehicle spins without the other effects, or first order does not hold, count as no worse
    sums[:, 1:-2] = np.minimum(sums[:, 1:-2], np.maximum(sums[:, :1], sums[:, -2:-1]))
    charges = np.array([misfits[item].charge for item in sets])
    without = [sets.index(frozenset(names) - {name}) for name in names]
    weights = shapley_weights(names)

    def shares(total: Array) -> Array:
        E = (total[:-1] + charges) / max(total[-1], 1.0)
        excess, floor = excess_and_floor(E)
        E = np.minimum(E, E[0] + excess)  # where the vehicle spins, the size of the error says nothing
        E[1:-1] = np.minimum(E[1:-1], max(E[0], E[-1]))  # sets in which it spins explain nothing
        closed = weights @ E / excess
        beside = [(E[k] - E[-1]) / max(E[k] - floor, CAL.least_gap) for k in without]
        return np.concatenate([closed, [(E[-1] - floor) / excess], beside])

    def excess_and_floor(E: Array) -> tuple[float, float]:
        floor = float(min(1.0, E[0], E[-1]))  # noise is no larger than the errors
        return max(float(E[0]) - floor, CAL.least_gap), floor

    whole = np.sum(sums, axis=0)
    E = (whole[:-1] + charges) / max(whole[-1], 1.0)
    excess, floor = excess_and_floor(E)
    if excess <= CAL.least_gap:
        return None
    n, result = len(names), with_intervals((*names, "unexplained", *names), sums, shares)
    shows = bool(max(E[0], E[-1]) - floor >= CAL.shows)
    return Budget(tuple(result[:n]), result[n], recordings, held_out, shows, tuple(result[n + 1 :]))


def with_intervals(names: Sequence[str], sums: Array, shares: Callable[[Array], Array]) -> list[Share]:
    """Shares by total sums, with their intervals by the block bootstrap of (blocks, columns) sums."""
    low, high = resampled(sums, shares, CAL.draws)
    each = zip(names, shares(np.sum(sums, axis=0)).tolist(), low.tolist(), high.tolist(), strict=True)
    return [Share(*item) for item in each]


def shapley_weights(names: tuple[str, ...]) -> Array:
    """(names, sets) by which the errors with all sets of effects add up to the Shapley value of each effect."""
    n = len(names)
    return np.array([
        [(-1 if name in item else 1) / (n * comb(n - 1, len(item - {name}))) for item in subsets(names)]
        for name in names
    ])  # fmt: skip


def shared_out(
    examined: Examined, best: Hypothesis, held_out: Sequence[Recording], tell: Callable[..., None]
) -> Budget | None:
    """The budget of a hypothesis' effects, on the held-out recordings if there are any.

    Tolerances are refitted with every set of a few effects. Of many, only with all of them, with none, and without each
    whose share is not surely a cause's: in the other sets, contributions add up to first order.
    """
    names = best.names
    if held_out:
        tell(f"computing the share of {listed(names)} in the gap, on {on_held_out(held_out)}")
    refits = _Refits(examined, best, held_out)
    if len(names) <= CAL.few:
        return refits.budget(refits.refitted(subsets(names)))
    whole = frozenset(names)
    shared = refits.budget(refits.to_first_order(refits.refitted([frozenset(), whole])))
    least = CAL.least_share if held_out else 0.0
    unsure = [share.effect for share in shared.beside if share.low < least] if shared is not None else []
    if not unsure:
        return shared
    return refits.budget(refits.to_first_order(refits.refitted([frozenset(), *(whole - {k} for k in unsure), whole])))


class _Refits:
    """Errors of free runs with sets of a hypothesis' effects, tolerances refitted.

    Runs are those of held-out recordings; where there are none, of the diagnosed ones.
    """

    def __init__(self, examined: Examined, best: Hypothesis, held_out: Sequence[Recording]) -> None:
        self.examined, self.best, self.held_out = examined, best, held_out
        self.search, self._all = examined.selection.search, frozenset(best.names)
        if held_out:
            # as refitted on the diagnosed recordings, and with tolerances refitted to free runs of these
            there = [self.search.values(best), self.search.values(examined.at_its_best(best))]
            errors, self.search, self._whole = self._on_held_out(self._all, there, None)
            self._known = {self._all: errors}

    def refitted(self, sets: Sequence[Set]) -> dict[Set, Misfit]:
        """Errors with these sets of effects."""
        return self._of_held_out(sets) if self.held_out else self._of_diagnosed(sets)

    def _of_diagnosed(self, sets: Sequence[Set]) -> dict[Set, Misfit]:
        examined, search, freed = self.examined, self.search, self.examined.freed
        known = {frozenset(item.names): item for item in examined.selection.tried}
        more = [subset for subset in sets if subset not in freed]
        parts = [known.get(item) or refitted(search, self.best.only(item)) for item in more]
        freed.update(zip(more, at_their_best(search, parts, examined.sd, examined.good), strict=True))
        # magnitudes are held, so that a set may really be worse; but refits that differ by much end in other optima
        for whole, less in _worse_than_subsets({subset: freed[subset] for subset in sets}):
            from_there = replace(freed[whole], theta=less.theta, linear=less.linear)
            (again,) = at_their_best(search, [from_there], examined.sd, examined.good)
            freed[whole] = min(freed[whole], again, key=by_cost)
        return {subset: misfit(search, freed[subset]) for subset in sets}

    def _of_held_out(self, sets: Sequence[Set]) -> dict[Set, Misfit]:
        known, whole = self._known, self._known[self._all]
        for subset in (item for item in sets if item not in known):
            try:
                known[subset], _, _ = self._on_held_out(subset, [whole.values], whole.trust)
            except BadInput:  # with some effects alone, simulations may overflow
                if not subset:
                    raise
                known[subset] = known[frozenset()]
        for subset, less in _worse_than_subsets({item: known[item] for item in sets}):
            with suppress(BadInput):  # as before
                again, search, result = self._on_held_out(subset, [less.values], whole.trust)
                if again.cost < known[subset].cost:
                    known[subset] = again
                    if subset == self._all:
                        self.search, self._whole = search, result
        return {subset: known[subset] for subset in sets}

    def _on_held_out(
        self, subset: Set, there: Sequence[Mapping[str, float]], trust: float | None
    ) -> tuple[Misfit, Search, Hypothesis]:
        examined, model = self.examined, with_effects(self.examined, self.best, subset)
        return refitted_tolerances(model, self.held_out, examined.vehicle, examined.effects, examined.sd, there, trust)

    def to_first_order(self, known: Mapping[Set, Misfit]) -> dict[Set, Misfit]:
        """Errors with every set of the effects, from those that are known."""
        examined, search = self.examined, self.search
        mains = {each.effect: each.axes[0] for each in self.best.candidates}
        if self.held_out:
            whole, whitener = self._whole, search.whitener
            places = {parameter.name: index for index, parameter in scalars(search.bench.model)}
        else:
            whole, white = examined.freed[self._all], white_noise(examined.sd, examined.good, examined.bench.rows)
            whitener = search.whitener if examined.unnamed is None else white
            places = {axis.name: axis.index for axis in mains.values()}
        absent = {name: {places[axis.name]: axis.value(axis.null)} for name, axis in mains.items()}
        with search.counted(whitener):
            search.about(whole)
            return of_subsets(search, whole, absent, known)

    def budget(self, misfits: Mapping[Set, Misfit]) -> Budget | None:
        """The budget, from the errors with every set; held out, with how far all effects together close the gap."""
        sd, bench, names = self.examined.sd, self.search.bench, self.best.names
        nothing, whole = misfits[frozenset()], misfits[self._all]
        good = inliers(whole.e, without_stale_rows(bench) if self.held_out else self.examined.good, bench)
        recordings = tuple(recording.name for recording in self.held_out or self.examined.recordings)
        shared = budget(misfits, names, sd, good, bench, recordings, bool(self.held_out))
        if shared is None or not self.held_out:
            return shared
        return replace(shared, together=closed_by(nothing, whole, sd, good & np.isfinite(nothing.e), bench, recordings))


def _worse_than_subsets(each: Mapping[Set, Refit]) -> Iterator[tuple[Set, Refit]]:
    """Sets that leave a larger error than without one of their effects, with the refit without it; small sets first."""
    for whole in sorted(each, key=len):
        for name in sorted(whole):
            less = each.get(whole - {name})
            if less is not None and less.cost < each[whole].cost:
                yield whole, less


def closes(shared: Budget | None, name: str) -> float:
    """The probability that an effect closes as much as a cause does; one where its share does not decide that."""
    if shared is None or not shared.held_out or (value := shared.judged(name)) is None:
        return 1.0
    sd = max((value.high - value.low) / (2 * NORMAL), CAL.least_share / 10)
    return float(ndtr((value.share - CAL.least_share) / sd))


def weak(shared: Budget, name: str) -> Share | None:
    """The share of an effect, if it is less than a cause closes.

    On the recordings that chose it, only one that surely closes nothing does: where nearly all of a gap has no name,
    the share of a true cause is close to none, on either side.
    """
    share = shared.judged(name)
    if share is None:
        return None
    return share if (share.share < CAL.least_share if shared.held_out else share.high < 0.0) else None
