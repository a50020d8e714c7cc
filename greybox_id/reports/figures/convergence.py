"""How the solver came to its end, and where other starts ended."""

from __future__ import annotations

import numpy as np

from ...provenance import Stage
from ..plot.figure import Figure, Panel
from ..plot.marks import Curve
from ..plot.palette import BLUE, ORANGE, Line
from ..plot.scale import Axis

FEWEST = 4
"""Steps that make a picture."""
ALIKE = 0.1
"""Objectives that differ by less than so many percent are not to look different."""
MOST_TICKS = 8


def convergence(stage: Stage) -> Figure | None:
    """The objective over the steps, above the best; beside it that of every start. None where neither is much."""
    best = min([*stage.history, stage.starts[0], *([stage.certificate.objective_after] if stage.certificate else [])])
    above = np.array(stage.history) - best
    steps = np.flatnonzero(above > 0)
    if len(steps) < FEWEST and len(stage.starts) < 2:
        return None
    y = Axis("objective above best [1]", log=True)
    x = Axis("step [1]", ticks=_whole(float(steps[-1]) if len(steps) else 1.0))
    panels = [Panel((Curve(steps.astype(float), above[steps], Line(BLUE), dots=1.4),), x, y)]
    if len(stage.starts) > 1:
        starts = 100.0 * (np.sort(stage.starts) / min(stage.starts) - 1.0)
        top = 1.05 * max(starts[-1], ALIKE)
        numbers = np.arange(1.0, len(starts) + 1)
        axes = (
            Axis("start, best first [number]", ticks=_whole(numbers[-1])),
            Axis("objective above best [%]", -0.05 * top, top),
        )
        panels.append(Panel((Curve(numbers, starts, Line(ORANGE, width=0.8), dots=2.0),), *axes))
    return Figure((tuple(panels),), (95.0,), (1.6, 1.0)[: len(panels)])


def _whole(last: float) -> tuple[tuple[float, str], ...]:
    stride = max(1, round(last / MOST_TICKS))
    return tuple((float(k), str(k)) for k in range(0, int(last) + 1, stride))
