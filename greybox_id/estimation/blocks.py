"""Stretches of rows over which residuals may be alike: what is drawn anew where an interval is wanted."""

from __future__ import annotations

from ..engine.simulation import FreeRuns
from .calibration import CAL


def blocks(bench: FreeRuns, seconds: float = CAL.residual_block) -> list[tuple[int, int]]:
    """Rows [a, b) of stretches over which residuals may be alike, none of them across runs."""
    length = max(1, round(seconds / bench.sample_time))
    return [(a, min(a + length, rows.stop)) for rows in bench.rows for a in range(rows.start, rows.stop, length)]
