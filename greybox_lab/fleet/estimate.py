"""What the results of a fleet say together, as tables: population, vehicles, drift, and a prior for the next fit."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from scipy.special import chdtri, ndtr

from greybox_id.base.declared import understood
from greybox_id.base.numbers import counted, number, pretty_unit, quantity, with_interval
from greybox_id.fitting.fit import Z, reach

from .changes import CONSTANT, SLOPE, STEP, VehicleChange
from .drift import Drifted, drifted
from .joined import ORDERS, JoinedFits, doubted, joined_fits, natural, plain_rows
from .prior import PRIOR, write_prior
from .store import ESTIMATED, Store
from .unit import unpacked

if TYPE_CHECKING:
    import pandas as pd

LEVEL = 0.95
SURE = 0.995
"""Probability from which on it is said to be above 0.99."""
FAR = 0.05
"""Rate of false outliers among vehicles."""


@dataclass(frozen=True)
class FleetEstimate:
    """What a fleet's recordings say together.

    Attributes
    ----------
    population : parameter -> mean and spread, as a table with the columns of the dataset.
    vehicles : vehicle and parameter -> value today, interval, where the next recording has it, its fit's error aside.
    drift : vehicle and parameter -> whether it changed, how, by how much and since when.
    apart : recordings that are set apart, whose fits belong to another optimum or another car, and why.
    used, left_out : recordings; sentence -> how many were left out for it.
    refitted : how many of them count with their second fit, whose prior was the fleet's.
    over : vehicle -> what its recordings are in order by.
    folder : of the results.
    """

    population: pd.DataFrame
    vehicles: pd.DataFrame
    drift: pd.DataFrame
    apart: pd.DataFrame
    used: int
    refitted: int
    left_out: Mapping[str, int]
    over: Mapping[str, str]
    folder: Path

    def to_json(self) -> dict[str, Any]:
        """The same as plain data."""
        return {
            "recordings": self.used,
            "refitted": self.refitted,
            "left_out": dict(self.left_out),
            "population": _records(self.population),
            "vehicles": _records(self.vehicles),
            "drift": _records(self.drift[self.drift["drifts"]]),
            "tested": len(self.drift),
            "apart": _records(self.apart),
            "prior": str(self.folder / PRIOR),
            "folder": str(self.folder),
        }

    def sentences(self) -> list[str]:
        """What changed and which vehicles lie apart, likeliest first."""
        changed = self.drift[self.drift["drifts"]].sort_values(["probability", "p"], ascending=[False, True])
        apart = self.vehicles[self.vehicles["sentence"].notna()]
        apart = apart.reindex(apart["outlier"].abs().sort_values(ascending=False).index)
        return [*changed["sentence"], *apart["sentence"]]

    def summary(self) -> str:
        """The same in lines."""
        names = self.vehicles["vehicle"].nunique()
        second = f", {self.refitted} by their second fits" if self.refitted else ""
        lines = [f"fleet    {counted(self.used, 'recording')} of {counted(names, 'vehicle')}{second}"]
        lines += [f"omitted  {count}: {words}" for words, count in self.left_out.items()]
        for row in _records(self.population):
            spread = (
                f", vehicles spread by {quantity(row['spread'], row['unit'], 2)}" if row["spread"] is not None else ""
            )
            lines.append(f"mean     {row['name']} {_ranged(row['mean'], row['low'], row['high'], row['unit'])}{spread}")
        lines += [f"{'apart' if k == 0 else '':9}{words}" for k, words in enumerate(self.apart["sentence"])]
        stated = self.sentences()
        lines += [f"{'changed' if k == 0 else '':9}{words}" for k, words in enumerate(stated)]
        if not stated:
            tested = self.drift["vehicle"].nunique()
            result = f"nothing found in {counted(tested, 'vehicle')} with enough recordings"
            lines.append(
                f"changed  {result if tested else 'no vehicle has enough recordings to test whether it has changed'}"
            )
        lines.append(f"written  {self.folder}/population, vehicles, drift, apart, {PRIOR}")
        return "\n".join([*lines, f"         every vehicle on one page: greybox fleet report {self.folder}"])


@understood
def estimate(folder: str | Path) -> FleetEstimate:
    """Estimate population, vehicles and drift from the results of a fleet; no recording is read.

    Parameters
    ----------
    folder : of the results; the datasets `population`, `vehicles` and `drift` and prior.toml are written to it.

    Returns
    -------
    FleetEstimate
        Tables; empty where no recording has a fit that can be joined with others.

    Raises
    ------
    BadInput : the folder holds no results, or they are damaged.

    Examples
    --------
    >>> from greybox_lab import fleet
    >>> fleet.estimate("nothing_here")
    Traceback (most recent call last):
    ...
    greybox_id.base.errors.BadInput: nothing_here holds no results of a fleet; ...
    """
    store = Store.existing(folder)
    recordings = store.current()
    joined, left_out = joined_fits(store, recordings)
    result: Drifted | None = None
    if joined is None:
        tables: dict[str, list[dict[str, Any]]] = {name: [] for name in ESTIMATED}
        over: dict[str, str] = {}
    else:
        result = drifted(joined.seen, joined.order, joined.x, doubted(store, joined))
        tables = {
            "population": _population_rows(joined, result),
            "vehicles": _vehicle_rows(joined, result),
            "drift": _drift_rows(joined, result),
            "apart": _apart_rows(joined, result),
        }
        over = dict(zip(joined.vehicles, joined.over, strict=True))
    for name, rows in tables.items():
        store.replace(name, rows)
    write_prior(store.folder, tables["population"], joined, result)
    return FleetEstimate(
        population=store.read("population"),
        vehicles=store.read("vehicles"),
        drift=store.read("drift"),
        apart=store.read("apart"),
        used=0 if joined is None else len(joined.keys),
        refitted=0 if joined is None else joined.refitted,
        left_out=left_out,
        over=over,
        folder=store.folder,
    )


def _population_rows(joined: JoinedFits, drifted: Drifted) -> list[dict[str, Any]]:
    population, rows = drifted.population, []
    several = len(joined.vehicles) > 1
    for k, (name, unit, log) in enumerate(zip(joined.names, joined.units, joined.logs, strict=True)):
        mu, sd, tau = (
            float(population.mean[k]),
            float(np.sqrt(population.mean_covariance[k, k])),
            float(np.sqrt(population.spread[k])),
        )
        size = natural(mu, log) if log else 1.0
        dof, far = float(population.spread_dof[k]), float(reach(population.mean_dof[k]))
        ends = [tau * math.sqrt(dof / chdtri(dof, tail)) for tail in ((1 - LEVEL) / 2, (1 + LEVEL) / 2)]
        rows.append(
            {
                "name": name, "unit": unit, "logarithm": log, "mean": natural(mu, log),
                "low": natural(mu - far * sd, log), "high": natural(mu + far * sd, log),
                "spread": tau * size if several else math.nan,
                "spread_low": ends[0] * size if several else math.nan,
                "spread_high": ends[1] * size if several else math.nan,
                "vehicles": len(joined.vehicles),
                "recordings": int(np.sum(joined.seen.information[~drifted.apart, k, k] > 0)),
                "mu": mu, "mu_sd": sd, "tau": tau if several else math.nan,
            }
        )  # fmt: skip
    return rows


def _vehicle_rows(joined: JoinedFits, drifted: Drifted) -> list[dict[str, Any]]:
    population = drifted.population
    rows: list[dict[str, Any]] = []
    several = len(joined.vehicles) > 2
    time_of = joined.rows["time"].to_numpy(dtype=float)
    wander = {(change.vehicle, change.parameter): change.wander for change in drifted.changes if change.drifts}
    for v, vehicle in enumerate(joined.vehicles):
        mean, covariance = drifted.today[v], drifted.covariance[v]
        mine = joined.order[v][~drifted.apart[joined.order[v]]]
        times = time_of[joined.order[v]]
        for k, (name, unit, log) in enumerate(zip(joined.names, joined.units, joined.logs, strict=True)):
            sd = math.sqrt(float(covariance[k, k]))
            walked = wander.get((v, k), 0.0) / max(len(joined.order[v]) - 1, 1)  # until the next recording
            further = math.sqrt(float(covariance[k, k] + population.scatter[k]) + walked)
            shrunken = float(population.spread[k]) - min(
                float(population.spread[k]), float(population.covariance[v, k, k])
            )
            apart = float(population.vehicle[v, k] - population.mean[k])
            outlier = apart / math.sqrt(shrunken) if several and shrunken > 0 else math.nan
            value, far = float(mean[k]), float(reach(population.dof[v, k]))
            rows.append(
                {
                    "vehicle": vehicle, "name": name, "unit": unit,
                    "recordings": int(np.sum(joined.seen.information[mine, k, k] > 0)),
                    "time": float(np.max(times)) if np.all(np.isfinite(times)) else math.nan,
                    "value": natural(value, log), "low": natural(value - far * sd, log),
                    "high": natural(value + far * sd, log), "next_low": natural(value - far * further, log),
                    "next_high": natural(value + far * further, log), "outlier": outlier,
                    "sentence": None,
                }
            )  # fmt: skip
    _tell_outliers(rows, joined, drifted)
    return rows


def _tell_outliers(rows: list[dict[str, Any]], joined: JoinedFits, drifted: Drifted) -> None:
    """A sentence for each vehicle that lies apart from the others, at a rate of false ones (Bonferroni)."""
    tested = [row for row in rows if math.isfinite(row["outlier"])]
    means = dict(zip(joined.names, zip(drifted.population.mean, joined.logs, strict=True), strict=True))
    for row in tested:
        if 2 * ndtr(-abs(row["outlier"])) * len(tested) > FAR:
            continue
        mean, log = means[row["name"]]
        typical = natural(float(mean), log)
        row["sentence"] = (
            f"{row['vehicle']}: {row['name']} {_ranged(row['value'], row['low'], row['high'], row['unit'])}"
            f", where the fleet has {number(typical, 3)}"
        )


def _drift_rows(joined: JoinedFits, drifted: Drifted) -> list[dict[str, Any]]:
    rows = []
    by_column = {name: joined.rows[name].to_numpy() for name in ("odometer", "time", "key", "path")}
    for change in drifted.changes:
        vehicle, name = joined.vehicles[change.vehicle], joined.names[change.parameter]
        unit, log = joined.units[change.parameter], joined.logs[change.parameter]
        now = float(drifted.today[change.vehicle, change.parameter])
        begin = change.begin if change.drifts else now
        size, sd = change.change, math.sqrt(change.variance)
        if log:  # of a positive parameter, as a difference from where it began, which is not known exactly either
            size = natural(begin + change.change, log) - natural(begin, log)
            along = natural(begin + change.change, log)
            sd = math.sqrt(
                along**2 * change.variance + size**2 * change.begin_variance + 2 * along * size * change.begin_shared
            )
        sizes = (size, size - Z * sd, size + Z * sd)
        order, by = joined.order[change.vehicle], joined.over[change.vehicle]
        stepped = change.kind == STEP
        of = [int(order[k if stepped else 0]) for k in (change.at, change.earliest, change.latest)]
        places = [
            float(by_column[by][at]) if by in ORDERS[:2] else float(max(k, 0))
            for at, k in zip(of, (change.at, change.earliest, change.latest), strict=True)
        ]
        times = [float(by_column["time"][at]) for at in of]
        dates = [_date(time, str(by_column["path"][at])) for time, at in zip(times, of, strict=True)]
        early, late = (places[1:], times[1:]) if stepped else ([math.nan] * 2, [math.nan] * 2)
        rows.append(
            {
                "vehicle": vehicle, "name": name, "unit": unit, "model": change.kind if change.drifts else CONSTANT,
                "over": by, "probability": change.probability, "p": change.p, "drifts": change.drifts,
                "change": sizes[0],
                "low": sizes[1], "high": sizes[2], "at": places[0], "at_low": early[0], "at_high": early[1],
                "at_time": times[0], "at_time_low": late[0], "at_time_high": late[1],
                "at_key": str(by_column["key"][of[0]]),
                "recordings": len(order),
                "sentence": _told(change, vehicle, name, unit, log, sizes, dates) if change.drifts else None,
            }
        )  # fmt: skip
    return rows


def _apart_rows(joined: JoinedFits, drifted: Drifted) -> list[dict[str, Any]]:
    """Recordings that are set apart, by the parameter in which their fits lie furthest off."""
    rows: list[dict[str, Any]] = []
    far, scatter = drifted.distances, drifted.population.scatter
    for j in np.flatnonzero(drifted.apart):
        at = plain_rows(joined.rows.iloc[[int(j)]])[0]
        names = list(at["names"])
        of_fit = np.sqrt(np.diag(unpacked(np.asarray(at["lower"], dtype=float), len(names))))
        places = [(k, names.index(name)) for k, name in enumerate(joined.names) if name in names]
        centres = [float(at["centre"][of]) for _, of in places]
        widths = [math.sqrt(far.sd[j, k] ** 2 + scatter[k] + of_fit[of] ** 2) for k, of in places]
        off = [abs(c - far.at[j, k]) / w for c, w, (k, _) in zip(centres, widths, places, strict=True)]
        worst = int(np.nanargmax(off))
        k, width = places[worst][0], widths[worst]
        name, unit, log = joined.names[k], joined.units[k], joined.logs[k]
        value, middle = natural(centres[worst], log), float(far.at[j, k])
        low, high = (natural(middle + end * width, log) for end in (-Z, Z))
        rows.append(
            {
                "key": str(at["key"]), "path": str(at["path"]), "vehicle": str(at["vehicle"]),
                "time": float(at["time"]), "name": name, "unit": unit, "value": value, "low": low, "high": high,
                "distance": float(far.square[j]) ** 0.5, "p": float(far.p[j]),
                "sentence": _why_apart(str(at["path"]), name, unit, value, (low, high), float(far.square[j]) ** 0.5),
            }
        )  # fmt: skip
    return rows


def _why_apart(
    path: str, name: str, unit: str, value: float, ends: tuple[float, float], distance: float
) -> str:  # fmt: skip
    low, high = ends
    if low <= value <= high:
        where = (
            f"its parameters together lie {distance:.1f} standard deviations from the values of the other recordings"
        )
    else:
        size = f"{number(value, 3)} {pretty_unit(unit)}".strip()
        where = (
            f"its {name} {size} lies outside [{number(low, 3)}, {number(high, 3)}], the range of the other recordings"
        )
    return f"{path} is set apart: {where}; its fit ended in another optimum, or the car is another one."


def _told(
    vehicle_change: VehicleChange, vehicle: str, name: str, unit: str, log: bool, sizes: tuple[float, float, float],
    dates: Sequence[str],
) -> str:  # fmt: skip
    percent = f"{100 * math.expm1(vehicle_change.change):+.0f}".replace("-", "−")
    share = f" ({percent} %)" if log else ""
    size = f"{'+' if sizes[0] > 0 else ''}{_ranged(*sizes, unit)}{share}"
    likely = (
        "probability > 0.99" if vehicle_change.probability >= SURE else f"probability {vehicle_change.probability:.2f}"
    )
    if vehicle_change.kind != STEP:
        verb = "drifted" if vehicle_change.kind == SLOPE else "wandered"
        return f"{vehicle}: {name} {verb} by {size} over its recordings, {likely}"
    since, early, late = dates
    between = f" [{early}, {late}]" if early != late else ""
    return f"{vehicle}: {name} {size} since {since}{between}, {likely}"


def _ranged(value: float, low: float, high: float, unit: str) -> str:
    """A value with its interval and unit."""
    words = with_interval(value, low, high, (high - low) / (2.0 * Z))
    return words if unit in ("", "1") else f"{words} {pretty_unit(unit)}"


def _date(time: float, path: str) -> str:
    return f"{datetime.fromtimestamp(time, UTC):%Y-%m-%d}" if math.isfinite(time) else f"recording {path}"


def _records(table: pd.DataFrame) -> list[dict[str, Any]]:
    """Rows as plain data; what is not there is None."""
    return [
        {name: None if isinstance(item, float) and math.isnan(item) else item for name, item in row.items()}
        for row in plain_rows(table)
    ]
