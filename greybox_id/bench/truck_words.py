"""The truck's tables for people."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from ..reports.text.screen import plain_table

UNITS = {"v_y": "m/s", "yaw_rate": "rad/s"}


def tables(found: Mapping[str, Any]) -> list[Any]:
    """Parts to print: the models, what is distinguished from what, the paper's figures."""
    models = plain_table("table", "model", "inputs", "numbers", "split", "v_y, m/s", "yaw rate, rad/s", "CPU s")
    for row in found["rows"]:
        split = f"{row['split']}{', by recording' if row['by_recording'] else ''}"
        models.add_row(
            row["table"], row["model"], row["inputs"], str(row["parameters"]), split,
            f"{row['v_y']:.4f} ± {row['v_y_stderr']:.4f}", f"{row['yaw_rate']:.5f} ± {row['yaw_rate_stderr']:.5f}",
            f"{row['cpu_seconds']:.1f}",
        )  # fmt: skip
    for name, (v_y, yaw_rate) in found["paper"].items():
        models.add_row("paper", name, "v_x, alpha1", "", "test", f"{v_y:.4f}", f"{yaw_rate:.5f}", "")
    pairs = plain_table("model", "against", "split", "output", "difference", "95 % interval", "")
    for own in found["comparisons"]:
        split = f"{own['split']}{', by recording' if own['by_recording'] else ''}"
        pairs.add_row(
            own["model"], own["against"], split, f"{own['output']} [{UNITS[own['output']]}]",
            f"{own['difference']:+.5f}", f"[{own['low']:+.5f}, {own['high']:+.5f}]",
            "" if own["distinguished"] else "not distinguished",
        )  # fmt: skip
    head = (
        "10 s of free run from the first reading: RMSE, mean over trajectories, with standard errors over recordings\n"
    )
    return [head, models, "\nPaired over trajectories, by recordings\n", pairs]
