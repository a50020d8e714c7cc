"""How far recordings from after are from predictions by those from before, and how much of that a change closes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from ...base.errors import BadInput
from ...base.shorthands import Array
from ...base.statistics import resampled
from ..estimation.calibration import CAL
from ..gap import Budget, Closure, Share
from .between_runs import Common, RunExplained
from .innovations import FollowedRun


def closure(known: Common, rides: Sequence[FollowedRun], mean: Array, names: tuple[str, ...]) -> Closure:
    """How far errors close from the vehicle's numbers as they were before to those of `mean`."""
    weigher, sums = known.weigher, list[tuple[float, float, float]]()
    for ride in rides:
        first, then = (weigher.innovations(ride, x) for x in (known.x, mean))
        if first is None or then is None:
            raise BadInput(f"The filter diverges on {ride.recording.name}: is this the right vehicle?")
        ones = np.ones(weigher.noise.channels)
        squares = (np.sum(weigher.noise.white(each, ones) ** 2, axis=1) for each in (first, then))
        sums += zip(*squares, np.sum(first.there, axis=1), strict=True)
    each = np.array(sums)
    total = np.sum(each, axis=0)
    before, after = (float(item) for item in total[:2] / total[2])

    def share(total: Array) -> float:
        before, after = total[:2] / total[2]
        return float((before - after) / max(before - min(1.0, before, after), CAL.least_gap))

    low, high = (float(end) for end in resampled(each, share, CAL.draws))
    return Closure(before, after, min(1.0, before, after), share(total), (low, high), names)


def budget_of(
    known: Common,
    rides: Sequence[FollowedRun],
    mean: Array,
    applied: Sequence[int],
    names: Mapping[int, str],
    judged: Closure,
    held_out: bool,
) -> Budget | None:
    """Shares of the applied effects, added one after the other; the rest of the gap is unexplained."""
    if not applied:
        return None
    low, high = judged.closed_interval
    rest = Share("unexplained", 1 - judged.closed, 1 - high, 1 - low)
    upto = [judged.closed]
    for count in range(len(applied) - 1, 0, -1):
        at = known.x.copy()
        at[[*applied[:count]]] = mean[[*applied[:count]]]
        upto.insert(0, closure(known, rides, at, judged.recordings).closed)
    shares = []
    for place, value in zip(applied, np.diff(upto, prepend=0.0), strict=True):
        ends = (value - 0.5 * (high - low), value + 0.5 * (high - low)) if len(applied) > 1 else (low, high)
        shares.append(Share(names[place], float(value), *(float(end) for end in ends)))
    return Budget(tuple(shares), rest, judged.recordings, held_out)


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
