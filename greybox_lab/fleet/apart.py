"""Recordings that lie apart: their estimate belongs to another optimum than those of the rest, or to another car.

A fit that ends in another optimum has an interval of its own, which may be narrow, and is far from the truth. Beside
the other recordings of its vehicle and the vehicles of the fleet it shows: it lies further off than its covariance, the
scatter of recordings and the vehicle's own interval allow, at a rate of false ones that counts all recordings
(Bonferroni). Such recordings are left out of what is estimated together, and named.

To begin with, before a population is known that they could not have moved, recordings are held against medians (Huber &
Ronchetti, Robust statistics, 2009).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.special import chdtrc, fdtrc, stdtr

from greybox_id.base.shorthands import Array
from greybox_id.base.statistics import robust_sd

from .hierarchy import LEAST_DOF, NOT_INFORMED, Informed, marginal

FALSE = 0.05
"""How often one recording or more of a fleet in which none is apart are set apart."""
TAILS = 4.0
"""Degrees of freedom of Student's t for recordings that are doubted, as usual in robust regression (Lange, Little &
Taylor, Robust statistical modeling using the t distribution, JASA 84 (1989))."""
OWN = 3
"""Recordings of a vehicle from which on their median holds against one that is apart."""

Flags = np.ndarray[tuple[int], np.dtype[np.bool_]]


@dataclass(frozen=True)
class FleetDistances:
    """How far recordings lie from what the others say of them.

    Attributes
    ----------
    square : (recordings,) of the distance, in standard deviations.
    p : (recordings,) how often a recording that belongs to its vehicle lies so far.
    at, sd : (recordings, parameters) where the others have it, and the standard deviation of that.
    """

    square: Array
    p: Array
    at: Array
    sd: Array

    def apart(self) -> Flags:
        """Which are set apart."""
        result: Flags = self.p * len(self.p) < FALSE
        return result

    def weights(self, size: int) -> Array:
        """By Student's t in so many dimensions, at most one."""
        result: Array = np.minimum((TAILS + size) / (TAILS + self.square), 1.0)
        return result


def distances(
    seen: Informed, scattered: tuple[Array, Array], at: Array, covariance: Array, weight: Array
) -> FleetDistances:  # fmt: skip
    """How far recordings lie from their vehicles as the others tell them.

    Parameters
    ----------
    seen : what recordings say.
    scattered : the same as information and vector about their vehicle.
    at, covariance : (recordings, parameters) and (recordings, parameters, parameters) of their vehicle.
    weight : (recordings,) with which they took part in that.
    """
    information, vector = scattered
    u = vector - (information @ at[:, :, None])[:, :, 0]
    through = information @ covariance @ information
    # of u: what took part agrees the more for it, what did not is off by both
    spread = information + (1.0 - 2.0 * weight)[:, None, None] * through
    unit = np.sqrt(np.maximum(np.diagonal(information, axis1=1, axis2=2), 1e-300))
    outer = unit[:, :, None] * unit[:, None, :]
    inverse = np.linalg.inv(spread / outer + NOT_INFORMED * np.eye(unit.shape[1])) / outer
    solved = (inverse @ u[:, :, None])[:, :, 0]
    square = np.maximum(np.einsum("jp,jp->j", u, solved), 0.0)
    rank = np.maximum(np.sum(np.diagonal(seen.information, axis1=1, axis2=2) > 0, axis=1), 1)
    known = np.isfinite(seen.freedom)
    freedom = np.where(known, np.maximum(seen.freedom, LEAST_DOF), 1.0)
    # the variance stands for one of Student's t: for F the scale is taken back
    p = np.where(known, fdtrc(rank, freedom, square / rank * freedom / np.maximum(freedom - 2.0, 1.0)),
                 chdtrc(rank, square))  # fmt: skip
    sd = np.sqrt(np.maximum(np.diagonal(covariance, axis1=1, axis2=2), 0.0))
    return FleetDistances(square, p, at, sd)


def strangers(seen: Informed) -> Flags:
    """Recordings that lie apart from the median of their vehicle, or of the fleet where it has but few."""
    estimate, covariance = marginal(seen)
    sd = np.sqrt(np.diagonal(covariance, axis1=1, axis2=2))
    informs = np.diagonal(seen.information, axis1=1, axis2=2) > 0
    count = seen.sums(np.ones(len(estimate)))[seen.vehicle]
    looked_at = max(int(informs.sum()), 1)
    result = np.zeros(len(estimate), dtype=bool)
    for k in range(estimate.shape[1]):
        here = informs[:, k]
        if not here.any():
            continue
        usual = float(np.median(sd[here, k]))
        weight = np.where(here, 1.0 / np.maximum(sd[:, k], usual), 0.0)
        medians = _medians(estimate[:, k], weight, seen.vehicle, seen.vehicles)
        of_all = _medians(medians[np.isfinite(medians)], np.ones(int(np.isfinite(medians).sum())), None, 1)[0]
        few = count < OWN
        centre = np.where(few, of_all, medians[seen.vehicle])
        off = np.abs(estimate[:, k] - centre)
        good = here & (sd[:, k] <= usual)
        scatter = np.zeros(len(off))
        for group in (few, ~few):
            some = good & group
            scatter[group] = robust_sd(off[some]) if some.any() else 0.0
        freedom = np.where(np.isfinite(seen.freedom), np.maximum(seen.freedom, LEAST_DOF), 1e6)
        p = 2.0 * stdtr(freedom, -off / np.hypot(sd[:, k], scatter))
        result |= here & (p * looked_at < FALSE)
    return spared(seen, result)


def spared(seen: Informed, apart: Flags) -> Flags:
    """The same, but for recordings without which a parameter is informed by none."""
    informs = np.diagonal(seen.information, axis1=1, axis2=2) > 0
    lost = informs.any(axis=0) & ~(informs & ~apart[:, None]).any(axis=0)
    return apart & ~informs[:, lost].any(axis=1)


def _medians(
    value: Array, weight: Array, group: np.ndarray[tuple[int], np.dtype[np.int64]] | None, groups: int
) -> Array:  # fmt: skip
    """Weighted median of each group; not a number where it has none."""
    of = np.zeros(len(value), dtype=np.int64) if group is None else group
    order = np.lexsort((value, of))
    value, weight, of = value[order], weight[order], of[order]
    total = np.bincount(of, weight, groups)
    before = np.cumsum(weight) - np.concatenate([[0.0], np.cumsum(total)])[of]
    middle = (before >= 0.5 * total[of]) & (weight > 0)
    result = np.full(groups, np.nan)
    where = np.flatnonzero(middle)[::-1]
    result[of[where]] = value[where]
    return result
