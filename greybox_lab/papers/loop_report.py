"""The comparison of black box and name as a table, and what of its bars is met."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import Any

import numpy as np
from scipy.stats import binomtest

from greybox_id.base.shorthands import Array
from greybox_id.reports.text.screen import plain_table

from ..exam.measures import wilson

BASE, ORACLE = "base", "oracle"
ARMS = (
    BASE, "nominal", "hand", "actuator_net", "abstract", "residual", "refit", "named", "named_residual", ORACLE
)  # fmt: skip
"""base: the driver before any data, learned with friction, mass and delay drawn from published ranges; oracle: learned
with the true effects; the others: `loop.protocol.ARMS`."""
EXCESS = 0.1
"""Share of the base's path error by which the oracle's has to be less for what is removed to mean something."""

Case = Mapping[str, Any]


def reported(cases: Sequence[Case]) -> dict[str, Any]:
    """Cases, a row of the table for each arm, and bars.

    Parameters
    ----------
    cases : as they were kept: withheld, outside, and arms, see docs/json.md.
    """
    return {
        "cases": list(cases),
        "table": [_row(name, cases) for name in ARMS if _of(name, cases)],
        "bars": bars(cases),
    }


def bars(cases: Sequence[Case]) -> list[dict[str, Any]]:
    """Every bar, what was measured, on how many cases, and whether it is met; None where it was not measured."""
    known = [item for item in cases if not item["outside"]]
    outside = [item for item in cases if item["outside"]]
    crashes, laps = _crashes("named", known)
    true_crashes, true_laps = _crashes(ORACLE, known)
    rate = crashes / (crashes + laps) if crashes + laps else None
    allowed = 0.05 if rate is None or not true_crashes + true_laps else max(
        0.05, true_crashes / (true_crashes + true_laps) + 0.03)  # fmt: skip
    right = _measured(outside, _rightly_named)

    def lap_time(when: str) -> Callable[[Case], float]:
        """Of named over the base, which drives at the first cap."""
        return lambda item: _over(_driving(item, "named", "lap_time", when), _driving(item, BASE, "lap_time", "first"))

    return [
        *_nearer(known, "first"),
        *_nearer(known, "last"),
        _bar("named, last cap: crashes per lap begun", "at most", allowed, rate, laps + crashes),
        _of_median("named: lap time divided by that of base at the same cap", "at most", 1.0, known, lap_time("first")),
        _of_median("named: lap time at the last cap divided by that of base at the first cap", "at most", 0.95, known,
                   lap_time("last")),
        _bar("outside the vocabulary: share of cases without a wrong name", "at least", 0.9,
             float(np.mean(right)) if len(right) else None, len(right)),
        _of_median("outside the vocabulary: median difference in the share of path error removed, named_residual minus "
                   "actuator_net", "at least", -0.05, outside,
                   lambda item: saved(item, "named_residual") - saved(item, "actuator_net")),
        _of_median("yaw rate error at 0.5 s and 90 % of the grip: model of named divided by actuator_net, median",
                   "at most",
                   0.5, known, lambda item: _over(_error(item, "named"), _error(item, "actuator_net"))),
        _of_median("model from 2000 rows: share of the vehicle file's error that named removes, median", "at least",
                   0.8, known, _with_few_rows),
    ]  # fmt: skip


def _nearer(cases: Sequence[Case], when: str) -> list[dict[str, Any]]:
    """How near to the path is driven, at the first cap or the last."""
    closer = _measured(cases, lambda item: saved(item, "named", when) - saved(item, "actuator_net", when))
    higher = int(np.sum(closer > 0))  # also where the truth helps too little for a share of it
    sign = float(binomtest(higher, len(closer), alternative="greater").pvalue) if len(closer) else None
    return [
        _of_median(f"{when} cap, named: share of the excess path error removed, median", "at least", 0.8, cases,
                   lambda item: removed(item, "named", when)),
        _of_median(f"{when} cap: median difference in the share of excess path error removed, named minus actuator_net",
                   "at least", 0.25, cases,
                   lambda item: removed(item, "named", when) - removed(item, "actuator_net", when)),
        _bar(f"{when} cap: p of a sign test: named is closer to the path than actuator_net", "below", 0.01, sign,
             len(closer)),
        _of_median(f"{when} cap: path error of named divided by that of base, median", "at most", 0.6, cases,
                   lambda item: 1.0 - saved(item, "named", when)),
    ]  # fmt: skip


def removed(case: Case, arm: str, when: str = "first") -> float:
    """(E_base - E_arm) / (E_base - E_oracle) of path errors at the first or last cap; NaN where truth helps little."""
    base, value, true = (_driving(case, name, "path_error_rms", when) for name in (BASE, arm, ORACLE))
    return (base - value) / (base - true) if base - true >= EXCESS * base else np.nan


def saved(case: Case, arm: str, when: str = "first") -> float:
    """(E_base - E_arm) / E_base of the path error at the first or last cap."""
    base, value = (_driving(case, name, "path_error_rms", when) for name in (BASE, arm))
    return (base - value) / base


def _row(name: str, cases: Sequence[Case]) -> dict[str, Any]:
    done = _of(name, cases)
    crashes, laps = _crashes(name, done)
    medians: dict[str, Callable[[Case], float]] = {
        "removed": lambda item: removed(item, name),
        "removed_last": lambda item: removed(item, name, "last"),
        "saved": lambda item: saved(item, name),
        "model_error": lambda item: _error(item, name),
        "cpu_seconds": lambda item: sum(item["arms"][name]["cpu_seconds"].values()),
    }
    for when in ("first", "last"):
        for what in ("path_error_rms", "path_error_p95", "lap_time", "steering_rate_rms"):
            medians[f"{what}_{when}"] = partial(_driving, arm=name, what=what, when=when)
    crash = {
        "crashes_last": crashes, "laps_last": laps,
        "crash_rate_interval": list(wilson(crashes, laps + crashes)) if laps + crashes else [None, None],
    }  # fmt: skip
    known = {key: _median(_measured(done, what)) for key, what in medians.items()}
    return {"arm": name, "cases": len(done), **known, **crash}


def _bar(bar: str, sense: str, limit: float, measured: float | None, of: int) -> dict[str, Any]:
    met = None
    if measured is not None:
        met = {"at least": measured >= limit, "at most": measured <= limit, "below": measured < limit}[sense]
    return {"bar": bar, "wanted": f"{sense} {limit:g}", "measured": measured, "of": of, "met": met}


def _of_median(
    bar: str, sense: str, limit: float, cases: Sequence[Case], what: Callable[[Case], float]
) -> dict[str, Any]:
    """A bar for the median of those cases in which it was measured."""
    values = _measured(cases, what)
    return _bar(bar, sense, limit, _median(values), len(values))


def _of(name: str, cases: Sequence[Case]) -> list[Case]:
    """Cases in which an arm came to its end."""
    return [item for item in cases if "first" in item["arms"].get(name, {})]


def _measured(cases: Sequence[Case], what: Callable[[Case], float]) -> Array:
    values = [what(item) for item in cases]
    return np.array([value for value in values if np.isfinite(value)])


def _median(values: Array) -> float | None:
    return float(np.median(values)) if len(values) else None


def _over(one: float, other: float) -> float:
    return one / other if other else np.nan


def _driving(case: Case, arm: str, what: str, when: str) -> float:
    return _known(case["arms"].get(arm, {}).get(when, {}).get(what))


def _crashes(name: str, cases: Sequence[Case]) -> tuple[int, int]:
    """Crashes and laps at the last cap."""
    ends = [item["arms"][name]["last"] for item in _of(name, cases)]
    return sum(end["crashes"] for end in ends), sum(end["laps"] for end in ends)


def _error(case: Case, arm: str, errors: Mapping[str, Any] | None = None) -> float:
    """Yaw rate error at 0.5 s and 90 % of the grip, rad/s."""
    result = errors or case["arms"].get(arm, {}).get("errors", {})
    return _known(result.get("90%", {}).get("0.5", {}).get("yaw_rate"))


def _known(value: float | None) -> float:
    return np.nan if value is None else float(value)


def _rightly_named(case: Case) -> float:
    """1 where named applied no name that is not there, else 0."""
    value = case["arms"].get("named", {})
    return float(not set(value["applied"]) - set(case["withheld"])) if "applied" in value else np.nan


def _with_few_rows(case: Case) -> float:
    """Share of the vehicle file's error that named removes with 2000 rows."""
    few = case["arms"].get("named", {}).get("curve", {}).get("2000")
    return 1.0 - _over(_error(case, "named", few), _error(case, BASE)) if few else np.nan


def tables(result: Mapping[str, Any]) -> list[Any]:
    """Parts to print: an arm a row, then bar by bar."""
    arms = plain_table(
        "arm", "cases", "path error, mm", "p95, mm", "removed", "lap, s", "at the last cap: mm", "removed", "lap, s",
        "crashes", "model, rad/s", "CPU s",
    )  # fmt: skip
    for row in result["table"]:
        low, high = row["crash_rate_interval"]
        interval = "" if low is None else f" ({low:.0%} to {high:.0%})"
        arms.add_row(
            row["arm"], str(row["cases"]), _mm(row["path_error_rms_first"]), _mm(row["path_error_p95_first"]),
            _number(row["removed"], "{:.0%}"), _number(row["lap_time_first"]), _mm(row["path_error_rms_last"]),
            _number(row["removed_last"], "{:.0%}"), _number(row["lap_time_last"]),
            f"{row['crashes_last']} in {row['laps_last']} laps{interval}",
            _number(row["model_error"], "{:.4f}"), _number(row["cpu_seconds"], "{:.1f}"),
        )  # fmt: skip
    bars = plain_table("bar", "wanted", "measured", "on", "")
    for item in result["bars"]:
        met = {None: "not measured", True: "met", False: "MISSED"}[item["met"]]
        bars.add_row(item["bar"], item["wanted"], _number(item["measured"], "{:.3g}"), str(item["of"]), met)
    failed = [
        f"case {case['case']}, vehicle {case['vehicle']}, seed {case['seed']}, {name}: {item['failed']}"
        for case in result["cases"]
        for name, item in case["arms"].items()
        if "failed" in item
    ]
    head = (
        "Medians over cases. Path error and lap time are those at the first cap of the grip. Model: yaw rate error "
        "over a horizon of 0.5 s, at 90 % of the grip.\n"
    )
    return [head, arms, "", bars, *(["", *failed] if failed else [])]


def _mm(metres: float | None) -> str:
    return "-" if metres is None else f"{1e3 * metres:.1f}"


def _number(value: float | None, how: str = "{:.2f}") -> str:
    return "-" if value is None else how.format(value)
