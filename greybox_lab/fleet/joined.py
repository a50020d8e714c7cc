"""Fits of a fleet's recordings as the hierarchy takes them: by names of parameters, vehicle and order."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from greybox_id.base.shorthands import Array

from .apart import Flags
from .hierarchy import Informed, informed
from .statuses import NOT_TRUSTED, OK
from .store import Store
from .unit import unpacked

if TYPE_CHECKING:
    import pandas as pd
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
        left_out["its fit informs nothing"] = len(fine) - sum(fine)
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
