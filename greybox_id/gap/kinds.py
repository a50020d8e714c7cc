"""What a diagnosis is made with, whichever kind of model it is of: a bench, which is a simulation of the engine."""

from __future__ import annotations

from ..engine.simulation import Diagnosed as Diagnosed
from ..engine.simulation import FreeRuns
from .calibration import CAL

AnyBench = FreeRuns


def blocks(bench: AnyBench, seconds: float = CAL.residual_block) -> list[tuple[int, int]]:
    """Rows [a, b) of stretches over which residuals may be alike, none of them across runs."""
    length = max(1, round(seconds / bench.sample_time))
    return [(a, min(a + length, rows.stop)) for rows in bench.rows for a in range(rows.start, rows.stop, length)]
