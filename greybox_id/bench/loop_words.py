"""The comparison of black box and name for people."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from ..reports.text.screen import plain_table


def tables(found: Mapping[str, Any]) -> list[Any]:
    """Parts to print: an arm a row, then bar by bar."""
    arms = plain_table(
        "arm", "cases", "path error, mm", "p95, mm", "removed", "lap, s", "at the last cap: mm", "lap, s", "crashes",
        "model, rad/s", "CPU s",
    )  # fmt: skip
    for row in found["table"]:
        low, high = row["crash_rate_interval"]
        interval = "" if low is None else f" ({low:.0%} to {high:.0%})"
        arms.add_row(
            row["arm"], str(row["cases"]), _mm(row["path_error_rms_first"]), _mm(row["path_error_p95_first"]),
            _number(row["removed"], "{:.0%}"), _number(row["lap_time_first"]), _mm(row["path_error_rms_last"]),
            _number(row["lap_time_last"]), f"{row['crashes_last']} in {row['laps_last']} laps{interval}",
            _number(row["model_error"], "{:.4f}"), _number(row["cpu_seconds"], "{:.1f}"),
        )  # fmt: skip
    bars = plain_table("bar", "wanted", "measured", "on", "")
    for own in found["bars"]:
        met = {None: "not measured", True: "met", False: "MISSED"}[own["met"]]
        bars.add_row(own["bar"], own["wanted"], _number(own["measured"], "{:.3g}"), str(own["of"]), met)
    failed = [
        f"case {case['case']}, vehicle {case['vehicle']}, seed {case['seed']}, {name}: {own['failed']}"
        for case in found["cases"]
        for name, own in case["arms"].items()
        if "failed" in own
    ]
    head = "Medians over cases: path error and lap at the first cap; model: yaw rate error at 0.5 s, 90 % of the grip\n"
    return [head, arms, "", bars, *(["", *failed] if failed else [])]


def _mm(metres: float | None) -> str:
    return "-" if metres is None else f"{1e3 * metres:.1f}"


def _number(value: float | None, how: str = "{:.2f}") -> str:
    return "-" if value is None else how.format(value)
