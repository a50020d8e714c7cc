"""The budget of a gap: which share of the excess error each effect closes, and what is left unexplained.

The value of a set of effects is how far it lowers the mean square of free-run errors; an effect's share is its Shapley
value, the mean of what it adds to every set of the others, over the excess above noise. Shares and the
unexplained rest add up to one. Source: Shapley, A value for n-person games, 1953.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from itertools import combinations
from math import factorial
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtr

from ..base.errors import BadInput
from ..base.shorthands import Array
from ..base.statistics import NORMAL, resampled
from ..datasets.checks.finding import listed
from ..datasets.recording import Recording
from ..engine.simulation import FreeRuns
from .closed_model import with_effects
from .closing import closed_by, on_held_out
from .estimation.axes import scalars
from .estimation.calibration import CAL
from .estimation.free_runs import (
    Misfit,
    at_their_best,
    freed_tolerances,
    inliers,
    misfit,
    of_subsets,
    refitted_tolerances,
)
from .estimation.hypothesis import Hypothesis, by_cost
from .estimation.noise import blocks, white_noise
from .estimation.search import Search
from .estimation.variance import without_stale_rows
from .examining import Examined
from .gap import Budget, Share
from .selection import refitted

Set = frozenset[str]
Refit = TypeVar("Refit", Hypothesis, Misfit)


def subsets(names: tuple[str, ...]) -> list[Set]:
    """All sets of some names, the empty one first, all of them last."""
    return [frozenset(combination) for size in range(len(names) + 1) for combination in combinations(names, size)]


def budget(
    misfits: Mapping[Set, Misfit],
    names: tuple[str, ...],
    sd: Array,
    good: NDArray[np.bool_],
    bench: FreeRuns,
    recordings: tuple[str, ...],
    held_out: bool,
) -> Budget | None:
    """Share out the excess error; None where there is none to share.

    Parameters
    ----------
    misfits : of the model with every set of effects, tolerances refitted.
    names : of the effects, in order.
    sd : (channels,) of noise.
    good : (N, channels) readings that count.
    bench : whose blocks are resampled.
    recordings : names of those that the misfits are on.
    held_out : whether these chose nothing.
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
    weights = np.array([[_weight(name, item, len(names)) for item in sets] for name in names]).reshape(len(names), -1)

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
    low, high = resampled(sums, shares, CAL.draws)
    result = [
        Share(name, float(s), float(a), float(b))
        for name, s, a, b in zip((*names, "unexplained", *names), shares(whole), low, high, strict=True)
    ]
    n = len(names)
    shows = bool(max(E[0], E[-1]) - floor >= CAL.shows)
    return Budget(tuple(result[:n]), result[n], recordings, held_out, shows, tuple(result[n + 1 :]))


def _weight(name: str, value: Set, n: int) -> float:
    """Weight of the error with a set of effects in the Shapley value of one of them."""
    if name in value:
        return -factorial(len(value) - 1) * factorial(n - len(value)) / factorial(n)
    return factorial(len(value)) * factorial(n - len(value) - 1) / factorial(n)


def shared_out(
    examined: Examined, best: Hypothesis, held_out: Sequence[Recording], tell: Callable[..., None]
) -> Budget | None:
    """The budget of a hypothesis' effects, on the held-out recordings if there are any."""
    names = best.names
    if len(names) > CAL.few:
        return _shared_out_linearly(examined, best, held_out, tell)
    if held_out:
        tell(f"computing the share of {listed(names)} in the gap, on {on_held_out(held_out)}")

        def left(subset: Set, there: Sequence[Mapping[str, float]], trust: float | None) -> tuple[Misfit, FreeRuns]:
            model = with_effects(examined, best, subset)
            return refitted_tolerances(model, held_out, examined.vehicle, examined.effects, examined.sd, there, trust)

        whole, bench = left(frozenset(names), _where_found(examined, best), None)
        misfits = {frozenset(names): whole}
        for subset in subsets(names)[:-1]:
            try:
                misfits[subset], _ = left(subset, [whole.values], whole.trust)
            except BadInput:  # with some effects alone, simulations may overflow
                if not subset:
                    raise
                misfits[subset] = misfits[frozenset()]
        for subset, less in _worse_than_subsets(names, misfits):
            with suppress(BadInput):  # as before
                again, _ = left(subset, [less.values], whole.trust)
                misfits[subset] = min(misfits[subset], again, key=lambda each: each.cost)
        return _of_held_out(misfits, names, examined.sd, bench, held_out)
    search = examined.selection.search
    known = {frozenset(item.names): item for item in examined.selection.tried}
    more = [subset for subset in subsets(names) if subset not in examined.freed]
    parts = [known.get(item) or refitted(search, best.only(item)) for item in more]
    examined.freed.update(zip(more, at_their_best(search, parts, examined.sd, examined.good), strict=True))
    _refit_from_subsets(examined, names)
    misfits = {subset: misfit(search, examined.freed[subset]) for subset in subsets(names)}
    good = inliers(misfits[frozenset(names)].e, examined.good, examined.bench)
    return budget(
        misfits,
        names,
        examined.sd,
        good,
        examined.bench,
        tuple(recording.name for recording in examined.recordings),
        False,
    )


def _of_held_out(
    misfits: Mapping[Set, Misfit], names: tuple[str, ...], sd: Array, bench: FreeRuns, held_out: Sequence[Recording]
) -> Budget | None:
    """The budget on recordings that chose nothing, and how far all effects together close the gap there."""
    nothing, whole = misfits[frozenset()], misfits[frozenset(names)]
    good, recordings = inliers(whole.e, without_stale_rows(bench), bench), tuple(item.name for item in held_out)
    shared = budget(misfits, names, sd, good, bench, recordings, True)
    if shared is None:
        return None
    return replace(shared, together=closed_by(nothing, whole, sd, good & np.isfinite(nothing.e), bench, recordings))


def _refit_from_subsets(examined: Examined, names: tuple[str, ...]) -> None:
    """Refit sets that leave a larger error than without one of their effects, from the tolerances without it.

    Magnitudes are held, so that a set may really be worse; but refits of free runs that differ by much end in other
    optima.
    """
    search, freed = examined.selection.search, examined.freed
    for whole, less in _worse_than_subsets(names, freed):
        from_there = replace(freed[whole], theta=less.theta, linear=less.linear)
        (again,) = at_their_best(search, [from_there], examined.sd, examined.good)
        freed[whole] = min(freed[whole], again, key=by_cost)


def _worse_than_subsets(names: tuple[str, ...], each: Mapping[Set, Refit]) -> Iterator[tuple[Set, Refit]]:
    """Sets that leave a larger error than without one of their effects, with the refit without it; small sets first."""
    for whole in subsets(names):
        for name in sorted(whole):
            if each[whole - {name}].cost < each[whole].cost:
                yield whole, each[whole - {name}]


def _where_found(examined: Examined, best: Hypothesis) -> list[Mapping[str, float]]:
    """Parameter values of a hypothesis as it was refitted, and with tolerances refitted to free runs."""
    search = examined.selection.search
    return [search.values(best), search.values(examined.at_its_best(best))]


def _shared_out_linearly(
    examined: Examined, best: Hypothesis, held_out: Sequence[Recording], tell: Callable[..., None]
) -> Budget | None:
    """The budget of many effects: in sets between none and all, contributions add up to first order."""
    names = best.names
    search = examined.selection.search
    if held_out:
        tell(f"computing the share of {listed(names)} in the gap, on {on_held_out(held_out)}")
        full = with_effects(examined, best)
        there = _where_found(examined, best)
        whole, search, result = freed_tolerances(full, held_out, examined.vehicle, examined.effects, examined.sd, there)
        search.about(result)
        nothing, _ = refitted_tolerances(
            with_effects(examined, best, set()),
            held_out,
            examined.vehicle,
            examined.effects,
            examined.sd,
            [whole.values],
            whole.trust,
        )
        known = {frozenset(names): whole, frozenset[str](): nothing}
        misfits = of_subsets(search, result, _absent(examined, best, search), known)
        return _of_held_out(misfits, names, examined.sd, search.bench, held_out)
    freed, base = (examined.at_its_best(item) for item in (best, examined.selection.base))
    known = {frozenset(names): misfit(search, freed), frozenset[str](): misfit(search, base)}
    white = white_noise(examined.sd, examined.good, examined.bench.rows)
    with search.counted(search.whitener if examined.unnamed is None else white):
        search.about(freed)
        misfits = of_subsets(search, freed, _absent(examined, best, search), known)
    good = inliers(known[frozenset(names)].e, examined.good, examined.bench)
    recordings = tuple(item.name for item in examined.recordings)
    return budget(misfits, names, examined.sd, good, examined.bench, recordings, False)


def _absent(examined: Examined, best: Hypothesis, search: Search) -> dict[str, dict[int, float]]:
    """Effect of the best hypothesis -> index of its magnitude's parameter -> the value without the effect."""
    same = search is examined.selection.search
    places = {parameter.name: index for index, parameter in scalars(search.bench.model)}
    mains = {each.effect: each.axes[0] for each in best.candidates}
    return {name: {axis.index if same else places[axis.name]: axis.value(axis.null)} for name, axis in mains.items()}


def closes(shared: Budget | None, name: str) -> float:
    """The probability that an effect closes as much as a cause does; one where its share is not known."""
    if shared is None or (value := shared.judged(name)) is None:
        return 1.0
    sd = max((value.high - value.low) / (2 * NORMAL), CAL.least_share / 10)
    return float(ndtr((value.share - _least_share(shared)) / sd))


def weak(shared: Budget, name: str) -> Share | None:
    """The share of an effect, if it is less than a cause closes."""
    share = shared.judged(name)
    return share if share is not None and share.share < _least_share(shared) else None


def _least_share(shared: Budget) -> float:
    """Share from which on an effect is a cause: on the recordings that chose it, any that is not negative."""
    return CAL.least_share if shared.held_out else 0.0
