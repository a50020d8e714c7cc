"""The tables of the paper on model-structured networks for people."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

from rich.console import RenderableType

from ..reports.text.screen import plain_table

UNITS = {"yaw_rate": "rad/s", "a_x": "m/s²"}


def tables(rows: Sequence[dict[str, Any]]) -> Iterator[RenderableType]:
    """Rows as tables: one a table of the paper, both protocols beneath each other, the paper's figures beside ours."""
    for number in dict.fromkeys(row["table"] for row in rows):
        title = f"Table {number}" if isinstance(number, int) else "Coupled networks, closed loop"
        table = plain_table(title, "train", "on", "protocol", "output", "RMSE", "FVU", "paper", "parameters", "CPU s")
        for row in (own for own in rows if own["table"] == number):
            paper = "–" if row["paper"] is None else f"{row['paper']:.3f}"
            if row["paper_fvu"] is not None:
                paper += f" ({row['paper_fvu']:.3f})"
            error = row["stderr"]
            spread = f" ± {error:.3f}" if error == error else ""
            table.add_row(
                row["model"], f"{row['share']} %", row["split"], row["protocol"],
                f"{row['output']} [{UNITS[row['output']]}]", f"{row['rmse']:.4f}{spread}", f"{row['fvu']:.3f}", paper,
                str(row["parameters"]), f"{row['cpu_seconds']:.1f}",
            )  # fmt: skip
        yield table
        yield ""
