"""How far recordings from after are from predictions by those from before, and how much of that a change closes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from ...base.errors import BadInput
from ...base.shorthands import Array
from ...base.statistics import resampled
from ..budget import shapley_weights
from ..estimation.calibration import CAL
from ..estimation.free_runs import subsets
from ..gap import Budget, Closure, Share
from .between_runs import Common, RunExplained, values_of
from .innovations import FollowedRun


def closure(
    known: Common, rides: Sequence[FollowedRun], mean: Array, names: tuple[str, ...], first: Array | None = None
) -> Closure:
    """How far errors close from the vehicle's numbers `first`, by default as they were before, to those of `mean`."""
    sums = _squares(known, rides, [known.x if first is None else first, mean])
    total = np.sum(sums, axis=0)
    before, after = (float(item) for item in total[:2] / total[2])

    def share(total: Array) -> float:
        before, after = total[:2] / total[2]
        return float((before - after) / max(before - min(1.0, before, after), CAL.least_gap))

    low, high = (float(end) for end in resampled(sums, share, CAL.draws))
    return Closure(before, after, min(1.0, before, after), share(total), (low, high), names)


def budget_of(
    known: Common,
    rides: Sequence[FollowedRun],
    mean: Array,
    applied: Mapping[int, str],
    names: tuple[str, ...],
    held_out: bool,
) -> Budget | None:
    """Shares of the applied effects, by Shapley; the rest of the gap is unexplained.

    Parameters
    ----------
    mean : coordinates of the vehicle with all of them.
    applied : index of its number -> name of an effect.
    names, held_out : of the recordings, and whether these chose nothing.
    """
    if not applied:
        return None
    effects = tuple(applied.values())
    weights = shapley_weights(effects)
    means = [np.where([applied.get(k) in some for k in range(len(mean))], mean, known.x) for some in subsets(effects)]

    def shares(total: Array) -> Array:
        E = total[:-1] / total[-1]
        excess = max(E[0] - min(1.0, E[0], E[-1]), CAL.least_gap)
        E[1:-1] = np.minimum(E[1:-1], max(E[0], E[-1]))  # sets that lose the vehicle explain nothing
        return np.asarray(np.append(weights @ E, excess - E[0] + E[-1]) / excess)

    sums = _squares(known, rides, means)
    low, high = resampled(sums, shares, CAL.draws)
    result = [Share(name, float(s), float(a), float(b))
              for name, s, a, b in zip((*effects, "unexplained"), shares(np.sum(sums, axis=0)), low, high,
                                       strict=True)]  # fmt: skip
    return Budget(tuple(result[:-1]), result[-1], names, held_out)


def _squares(known: Common, rides: Sequence[FollowedRun], means: Sequence[Array]) -> Array:
    """(blocks, means + 1) sums of squared innovations with each of several coordinates, and numbers of readings."""
    weigher, result = known.weigher, list[Array]()
    ones = np.ones(weigher.noise.channels)
    for ride in rides:
        several = weigher.follower.beside(ride, [values_of(weigher.numbers, x) for x in means])
        there = [one for one in several if one is not None]
        if len(there) < len(several):
            raise BadInput(f"The filter diverges on {ride.recording.name}: is this the right vehicle?")
        squares = [np.sum(weigher.noise.white(one, ones) ** 2, axis=1) for one in there]
        result.append(np.stack([*squares, np.sum(there[0].there, axis=1)], axis=1))
    return np.concatenate(result)


def mean_square(known: Common, rides: Sequence[FollowedRun], mean: Array) -> float:
    """Mean square of innovations over their predicted size, with coordinates `mean`."""
    total = np.sum(_squares(known, rides, [mean]), axis=0)
    return float(total[0] / total[1])


def loudness(known: Common, rides: Sequence[FollowedRun], base: RunExplained) -> float:
    """Innovations of recordings from after over those from before, mean over channels, median over recordings."""
    result = [known.weigher.innovations(ride, base.x) for ride in rides]
    scales = [known.weigher.noise.scales(item) for item in result if item is not None]
    return float(np.median(np.mean(scales, axis=1))) if scales else 1.0


def channels_of(known: Common, rides: Sequence[FollowedRun]) -> dict[str, float]:
    """Channel -> root mean square of innovations over their predicted size, with the numbers from before."""
    read = known.weigher.follower.read
    squares, count = np.zeros(len(read)), np.zeros(len(read))
    for ride in rides:
        innovations = known.weigher.innovations(ride, known.x)
        if innovations is not None:
            squares += np.sum((innovations.white**2).reshape(-1, len(read)), axis=0)
            count += np.sum(innovations.there.reshape(-1, len(read)), axis=0)
    return {name: float(np.sqrt(s / max(c, 1.0))) for name, s, c in zip(read, squares, count, strict=True)}
