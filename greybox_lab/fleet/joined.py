"""Fits of a fleet's recordings as the hierarchy takes them: by names of parameters, vehicle and order.

Recordings that lie apart: their estimate belongs to another optimum than those of the rest, or to another car.

A fit that ends in another optimum has an interval of its own, which may be narrow, and is far from the truth. Beside
the other recordings of its vehicle and the vehicles of the fleet it shows: it lies further off than its covariance, the
scatter of recordings and the vehicle's own interval allow, at a rate of false ones that counts all recordings
(Bonferroni). Such recordings are left out of what is estimated together, and named.

To begin with, before a population is known that they could not have moved, recordings are held against medians (Huber &
Ronchetti, Robust statistics, 2009).
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from scipy.special import chdtrc, fdtrc, stdtr

from greybox_id.base.shorthands import Array
from greybox_id.base.statistics import robust_sd

from .hierarchy import LEAST_DOF, NOT_INFORMED, Informed, informed, marginal
from .statuses import NOT_TRUSTED, OK
from .store import Store
from .unit import unpacked

if TYPE_CHECKING:
    import pandas as pd

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


TOGETHER = 12
"""Parameters that are estimated together: those that most recordings inform."""
ORDERS = ("odometer", "time", "order")
"""What recordings of a vehicle are put in order by: the first that all of them have, else how they are listed."""


@dataclass(frozen=True)
class JoinedFits:
    """Recordings as the hierarchy takes them, with what rows are called by."""

    names: list[str]
    units: list[str]
    logs: list[bool]
    seen: Informed
    keys: list[str]
    vehicles: list[str]
    order: list[np.ndarray[tuple[int], np.dtype[np.int64]]]
    x: list[Array]
    over: list[str]
    rows: pd.DataFrame
    refitted: int


def joined_fits(
    store: Store, recordings: pd.DataFrame, refits: bool = True
) -> tuple[JoinedFits | None, dict[str, int]]:  # fmt: skip
    """Recordings whose fits can be joined, their second ones where there are, and why others cannot."""
    left_out = Counter[str]()
    for status, count in recordings["status"].value_counts().sort_index().items():
        if status != OK:
            left_out[str(status)] = int(count)
    covariances, again = store.read("covariances"), 0
    if refits:
        recordings, covariances, again = _with_refits(store, recordings, covariances)
    kept = recordings[recordings["status"] != NOT_TRUSTED].merge(covariances, on="key")
    missing = int((recordings["status"] == OK).sum()) - int((kept["status"] == OK).sum())
    if missing:
        left_out["no fit, or its optimum is not confirmed"] = missing
    kept = kept[kept["verdict"] != "not usable"].sort_values(["vehicle", "path"]).reset_index(drop=True)
    names, units, logs = _names(kept)
    parsed = [_of_row(row, names, logs) for row in plain_rows(kept)]
    fine = [item is not None for item in parsed]
    if not all(fine):
        left_out["its fit determines no parameter"] = len(fine) - sum(fine)
    kept = kept[fine].reset_index(drop=True)
    both = [item for item in parsed if item is not None]
    if not both:
        return None, dict(left_out)
    information, vector = np.array([item for item, _, _ in both]), np.array([item for _, item, _ in both])
    freedom = np.array([item for _, _, item in both])
    here = np.flatnonzero(np.diagonal(information, axis1=1, axis2=2).sum(axis=0) > 0)
    information, vector = information[:, here][:, :, here], vector[:, here]
    names, units, logs = [names[k] for k in here], [units[k] for k in here], [logs[k] for k in here]
    vehicles = sorted(set(kept["vehicle"]))
    numbers = {name: k for k, name in enumerate(vehicles)}
    of = np.array([numbers[item] for item in kept["vehicle"]], dtype=np.int64)
    order, x, over = [], [], []
    along_of = kept[list(ORDERS[:2])]
    for k in range(len(vehicles)):
        rows = np.flatnonzero(of == k)
        values, by = _along(along_of.iloc[rows])
        first = np.argsort(values, kind="stable")
        order.append(rows[first])
        along = values[first] - values.min()
        x.append(along / along[-1] if along[-1] > 0 else along)
        over.append(by)
    seen = Informed(information, vector, of, len(vehicles), freedom, _shared_prior(kept, names, logs))
    keys = [str(item) for item in kept["key"]]
    return JoinedFits(names, units, logs, seen, keys, vehicles, order, x, over, kept, again), dict(left_out)


def _with_refits(
    store: Store, recordings: pd.DataFrame, covariances: pd.DataFrame
) -> tuple[pd.DataFrame, pd.DataFrame, int]:  # fmt: skip
    """The same with second fits in place of first ones, and how many they are."""
    second = store.refits()[["key", "refit_of", "status", "verdict"]]
    second = second[(second["status"] == OK) & second["key"].isin(set(covariances["key"]))]
    first = dict(zip(second["key"], second["refit_of"], strict=True))
    verdicts = dict(zip(second["refit_of"], second["verdict"], strict=True))
    kept = covariances[~covariances["key"].isin(set(verdicts))]
    kept = kept.assign(key=kept["key"].replace(first))
    verdict = recordings["key"].map(verdicts)
    return recordings.assign(verdict=verdict.where(verdict.notna(), recordings["verdict"])), kept, len(first)


def _names(kept: pd.DataFrame) -> tuple[list[str], list[str], list[bool]]:
    """Names, units and coordinates of the parameters that most recordings have."""
    counts: Counter[tuple[str, str, bool]] = Counter()
    for row in plain_rows(kept[["names", "units", "logarithm"]]):
        counts.update(zip(map(str, row["names"]), map(str, row["units"]), map(bool, row["logarithm"]), strict=True))
    chosen: dict[str, tuple[str, bool]] = {}
    for (name, unit, log), _ in counts.most_common():
        if len(chosen) < TOGETHER:
            chosen.setdefault(name, (unit, log))
    return list(chosen), [unit for unit, _ in chosen.values()], [log for _, log in chosen.values()]


def _of_row(row: Mapping[str, Any], names: Sequence[str], logs: Sequence[bool]) -> tuple[Array, Array, float] | None:
    """Information, vector and degrees of freedom of a recording over all parameters; None where it says nothing."""
    parameters = [str(name) for name in row["names"]]
    covariance = unpacked(np.asarray(row["lower"], dtype=float), len(parameters))
    size = np.diag(covariance)
    sound = np.isfinite(size) & (size > 0) & ~np.asarray(row["at_bound"], dtype=bool)
    taken = [
        k for k, (name, log) in enumerate(zip(parameters, row["logarithm"], strict=True))
        if sound[k] and name in names and logs[names.index(name)] == bool(log)
    ]  # fmt: skip
    if not taken:
        return None
    parts = [np.asarray(row[name], dtype=float)[taken] for name in ("centre", "prior_mean", "prior_sd", "dof")]
    try:
        data, vector = informed(covariance[np.ix_(taken, taken)], *parts)
    except (ValueError, np.linalg.LinAlgError):
        return None
    if not (np.all(np.isfinite(data)) and np.all(np.isfinite(vector)) and np.any(np.diag(data) > 0)):
        return None
    places = [names.index(parameters[k]) for k in taken]
    whole, of = np.zeros((len(names), len(names))), np.zeros(len(names))
    whole[np.ix_(places, places)], of[places] = data, vector
    return whole, of, float(np.nanmin(np.append(parts[-1], np.inf)))


def _shared_prior(kept: pd.DataFrame, names: Sequence[str], logs: Sequence[bool]) -> tuple[Array, Array]:
    """Information and vector of the prior that fits share: of each parameter, what is usual among them."""
    name, log, mean, sd = (np.concatenate(kept[item]) for item in ("names", "logarithm", "prior_mean", "prior_sd"))
    columns = [(name == called) & (log.astype(bool) == is_log) for called, is_log in zip(names, logs, strict=True)]
    mean, sd = (np.array([np.median(values[here]) for here in columns]) for values in (mean, sd))
    return 1.0 / np.square(sd), mean / np.square(sd)


def _along(rows: pd.DataFrame) -> tuple[Array, str]:
    """What recordings of a vehicle are in order by, and what that is called."""
    for name in ORDERS[:2]:
        values = rows[name].to_numpy(dtype=float)
        if np.all(np.isfinite(values)) and np.ptp(values) > 0:
            return values, name
    return np.arange(len(rows), dtype=float), ORDERS[2]


def doubted(store: Store, joined: JoinedFits) -> Flags:
    """Recordings with a gap, which count less the further they lie from their vehicle."""
    gaps = store.read("gaps", ["key", "detected"])
    with_gap = set(gaps[gaps["detected"].fillna(False).astype(bool)]["key"])
    return np.array([key in with_gap for key in joined.keys], dtype=bool)


def natural(value: float, log: bool) -> float:
    """A value out of the coordinate in which it was estimated."""
    return math.exp(min(value, 700.0)) if log else value


def plain_rows(table: pd.DataFrame) -> list[dict[str, Any]]:
    """Rows by name of column."""
    return [{str(name): value for name, value in row.items()} for row in table.to_dict("records")]
