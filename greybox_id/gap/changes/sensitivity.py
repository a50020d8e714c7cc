"""Detection limits of changes on a recording like those at hand, before anything further is driven."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import log, sqrt

import numpy as np

from ..estimation.calibration import CAL
from .between_runs import Common, change_sds
from .innovations import FollowedRun


@dataclass(frozen=True)
class Visible:
    """Detection limit of a change.

    Attributes
    ----------
    effect : name.
    size : least detectable distance from the usual value, in the effect's unit; relative where it is a factor. Infinite
        if larger than such changes are.
    scatter, told : its two parts, standard deviations: scatter between runs to which nothing is done, and uncertainty
        of the estimate from one recording.
    usual : of a factor, the mean of the runs; else its magnitude.
    factor : whether it is one.
    unit : of the effect.
    """

    effect: str
    size: float
    scatter: float
    told: float
    usual: float
    factor: bool
    unit: str


def visible(
    known: Common, rides: Sequence[FollowedRun], effects: Mapping[str, str], units: Mapping[str, str], cost: float
) -> tuple[Visible, ...]:
    """Detection limits on one further recording like these, smallest share of a usual change first.

    A change of c sd gains c^2 / 2 nats, less Occam's factor for a prior as wide as changes are; it is detected from
    where that is what a change must gain (`search.Change`).

    Parameters
    ----------
    known : of the recordings from before.
    rides : these recordings, each of which stands for a further one.
    effects, units : number of the model -> effect; effect -> unit.
    cost : what a change must gain, in nats.
    """
    each = [known.weigher.curve(ride, known.x).H for ride in rides]
    V = known.of_a_run
    sds = change_sds(np.median(each, axis=0), V)
    result = []
    for place in known.varying:
        number = known.numbers[place]
        sd = float(sds[place])
        away = sd * sqrt(2.0 * (cost + 0.5 * log(1.0 + (number.change / sd) ** 2)))
        size = away if away < CAL.reach_sd * number.change else float("inf")
        alone = sqrt(max(sd**2 - float(V[place, place]), 0.0))
        name, usual = effects[number.name], number.value(known.x[place])
        limit = Visible(name, size, float(known.scatter[place]), alone, usual, number.logarithmic, units[name])
        result.append((size / number.change, limit))
    return tuple(limit for _, limit in sorted(result, key=lambda item: item[0]))
