"""The comparison of black box and name as a table, and what of its bars is met."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
from scipy.stats import binomtest

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
Number = float | None


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
    beside = _measured(outside, _wrong)
    points_outside = _measured(outside, lambda item: _less(saved(item, "named_residual"), saved(item, "actuator_net")))
    errs = _measured(known, lambda item: _over(_error(item, "named"), _error(item, "actuator_net")))
    few = _measured(known, _with_few_rows)
    rate, true_rate = _share(crashes, laps), _share(true_crashes, true_laps)
    allowed = None if rate is None or true_rate is None else max(0.05, true_rate + 0.03)
    return [
        *_nearer(known, "first"),
        *_nearer(known, "last"),
        _bar("named, last cap: crashes per lap begun", "at most", allowed or 0.05, rate, laps + crashes),
        _bar("named: lap time over that of base at the same cap", "at most", 1.0, *_driven(known, "lap_time", "first")),
        _bar("named: lap time at the last cap over that of base at the first cap", "at most", 0.95,
             *_driven(known, "lap_time", "last")),
        _bar("outside the vocabulary: share of cases without a wrong name", "at least", 0.9, _share_of(beside),
             len(beside)),
        _bar((
            "outside the vocabulary: median difference in the share of path error removed, named_residual minus "
            "actuator_net"
        ), "at least", -0.05,
             _median(points_outside), len(points_outside)),
        _bar("yaw rate error at 0.5 s and 90 % of the grip: model of named over actuator_net, median", "at most", 0.5,
             _median(errs), len(errs)),
        _bar("model from 2000 rows: share of the vehicle file's error that named removes, median", "at least", 0.8,
             _median(few), len(few)),
    ]  # fmt: skip


def _nearer(cases: Sequence[Case], when: str) -> list[dict[str, Any]]:
    """How near to the path is driven, at the first cap or the last."""
    removes = _measured(cases, lambda item: removed(item, "named", when))
    points = _measured(cases, lambda item: _less(removed(item, "named", when), removed(item, "actuator_net", when)))
    closer = _measured(cases, lambda item: _less(saved(item, "named", when), saved(item, "actuator_net", when)))
    higher = sum(one > 0 for one in closer)  # also where the truth helps too little for a share of it
    sign = float(binomtest(higher, len(closer), alternative="greater").pvalue) if closer else None
    over = _measured(cases, lambda item: _less(1.0, saved(item, "named", when)))
    return [
        _bar(f"{when} cap, named: share of the excess path error removed, median", "at least", 0.8, _median(removes),
             len(removes)),
        _bar(f"{when} cap: median difference in the share of excess path error removed, named minus actuator_net",
             "at least", 0.25, _median(points), len(points)),
        _bar(f"{when} cap: p of a sign test: named is closer to the path than actuator_net", "below", 0.01, sign,
             len(closer)),
        _bar(f"{when} cap: path error of named over that of base, median", "at most", 0.6, _median(over), len(over)),
    ]  # fmt: skip


def removed(case: Case, arm: str, when: str = "first") -> Number:
    """(E_base - E_arm) / (E_base - E_oracle) of path errors at the first or last cap; None where truth helps little."""
    base, value, true = (_driving(case, name, "path_error_rms", when) for name in (BASE, arm, ORACLE))
    if base is None or value is None or true is None or base - true < EXCESS * base:
        return None
    return (base - value) / (base - true)


def saved(case: Case, arm: str, when: str = "first") -> Number:
    """(E_base - E_arm) / E_base of the path error at the first or last cap."""
    base, value = (_driving(case, name, "path_error_rms", when) for name in (BASE, arm))
    return None if base is None or value is None else (base - value) / base


def _row(name: str, cases: Sequence[Case]) -> dict[str, Any]:
    done = _of(name, cases)
    crashes, laps = _crashes(name, done)
    low, high = wilson(crashes, laps + crashes) if laps + crashes else (None, None)
    medians: dict[str, Number] = {
        "removed": _median(_measured(done, lambda item: removed(item, name))),
        "removed_last": _median(_measured(done, lambda item: removed(item, name, "last"))),
        "saved": _median(_measured(done, lambda item: saved(item, name))),
        "model_error": _median(_measured(done, lambda item: _error(item, name))),
        "cpu_seconds": _median(_measured(done, lambda item: float(sum(item["arms"][name]["cpu_seconds"].values())))),
    }
    for when in ("first", "last"):
        for what in ("path_error_rms", "path_error_p95", "lap_time", "steering_rate_rms"):
            one = [item["arms"][name][when][what] for item in done]
            medians[f"{what}_{when}"] = _median([value for value in one if value is not None and np.isfinite(value)])
    crash = {"crashes_last": crashes, "laps_last": laps, "crash_rate_interval": [low, high]}
    return {"arm": name, "cases": len(done), **medians, **crash}


def _bar(bar: str, sense: str, limit: float, measured: Number, of: int) -> dict[str, Any]:
    met = None
    if measured is not None:
        met = {"at least": measured >= limit, "at most": measured <= limit, "below": measured < limit}[sense]
    return {"bar": bar, "wanted": f"{sense} {limit:g}", "measured": measured, "of": of, "met": met}


def _of(name: str, cases: Sequence[Case]) -> list[Case]:
    """Cases in which an arm came to its end."""
    return [item for item in cases if "first" in item["arms"].get(name, {})]


def _measured(cases: Sequence[Case], what: Callable[[Case], Number]) -> list[float]:
    return [value for value in map(what, cases) if value is not None and np.isfinite(value)]


def _median(values: Sequence[float]) -> Number:
    return float(np.median(values)) if values else None


def _less(one: Number, other: Number) -> Number:
    return None if one is None or other is None else one - other


def _over(one: Number, other: Number) -> Number:
    return None if one is None or not other else one / other


def _share(hits: int, others: int) -> Number:
    return hits / (hits + others) if hits + others else None


def _share_of(hits: Sequence[float]) -> Number:
    return float(np.mean(hits)) if hits else None


def _driving(case: Case, arm: str, what: str, when: str) -> Number:
    value = case["arms"].get(arm, {}).get(when, {}).get(what)
    return None if value is None else float(value)


def _driven(cases: Sequence[Case], what: str, when: str) -> tuple[Number, int]:
    """Median of named over the base, which drives at the first cap; on how many cases."""
    result = _measured(
        cases, lambda item: _over(_driving(item, "named", what, when), _driving(item, BASE, what, "first"))
    )
    return _median(result), len(result)


def _crashes(name: str, cases: Sequence[Case]) -> tuple[int, int]:
    """Crashes and laps at the last cap."""
    ends = [item["arms"][name]["last"] for item in _of(name, cases)]
    return sum(end["crashes"] for end in ends), sum(end["laps"] for end in ends)


def _error(case: Case, arm: str, errors: Mapping[str, Any] | None = None) -> Number:
    """Yaw rate error at 0.5 s and 90 % of the grip, rad/s."""
    result = errors or case["arms"].get(arm, {}).get("errors", {})
    value = result.get("90%", {}).get("0.5", {}).get("yaw_rate")
    return None if value is None else float(value)


def _wrong(case: Case) -> Number:
    """1 where named applied no name that is not there, else 0."""
    value = case["arms"].get("named", {})
    return None if "applied" not in value else float(not set(value["applied"]) - set(case["withheld"]))


def _with_few_rows(case: Case) -> Number:
    """Share of the vehicle file's error that named removes with 2000 rows."""
    few = case["arms"].get("named", {}).get("curve", {}).get("2000")
    base = _error(case, BASE)
    number = None if few is None else _error(case, "named", few)
    return None if base is None or number is None or base == 0 else 1.0 - number / base


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
    head = "Medians over cases: path error and lap at the first cap; model: yaw rate error at 0.5 s, 90 % of the grip\n"
    return [head, arms, "", bars, *(["", *failed] if failed else [])]


def _mm(metres: float | None) -> str:
    return "-" if metres is None else f"{1e3 * metres:.1f}"


def _number(value: float | None, how: str = "{:.2f}") -> str:
    return "-" if value is None else how.format(value)
