"""The truck's tables for people."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from ..reports.text.screen import plain_table

UNITS = {"v_y": "m/s", "yaw_rate": "rad/s"}


def tables(found: Mapping[str, Any]) -> list[Any]:
    """Parts to print: models beside the paper's figures, what is distinguished from what, learning curves, lessons."""
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
    parts = [head, models, "\nPaired over trajectories, by recordings\n", pairs]
    if found["learning_curves"]:
        curves = plain_table("share of train", "output", "MLP", "with transfer", "ratio", "95 % interval")
        for own in found["learning_curves"]:
            curves.add_row(
                f"{100 * own['share']:g} %", f"{own['output']} [{UNITS[own['output']]}]", f"{own['learning']:.4f}",
                f"{own['transfer']:.4f}", f"{own['ratio']:.2f}", f"[{own['low']:.2f}, {own['high']:.2f}]",
            )  # fmt: skip
        parts += ["\nErrors on val, trained on shares of the training recordings\n", curves]
    if found["lessons"]:
        lessons = plain_table("share", "taught", "against", "output", "difference", "95 % interval", "")
        for own in found["lessons"]:
            lessons.add_row(
                f"{100 * own['share']:g} %", own["taught"], own["against"], f"{own['output']} [{UNITS[own['output']]}]",
                f"{own['difference']:+.5f}", f"[{own['low']:+.5f}, {own['high']:+.5f}]",
                "" if own["distinguished"] else "not distinguished",
            )  # fmt: skip
        parts += ["\nWhat a network learns before it sees a recording\n", lessons]
    if found["left_out"]:
        parts.append(f"\n{found['left_out']} trainings are left out: run it again with the same ‹out› to go on.")
    return parts
