"""How the solver came to its end, and where other starts ended."""

from __future__ import annotations

import numpy as np

from ...provenance import Stage
from .sheet import Sheet
from .style import BLUE, ORANGE, look

FEWEST = 4
"""Steps that make a picture."""
ALIKE = 0.1
"""Objectives that differ by less than so many percent are not to look different."""
MOST_TICKS = 8


def convergence(stage: Stage) -> Sheet | None:
    """The objective over the steps, above the best; beside it that of every start. None where neither is much."""
    best = min([*stage.history, stage.starts[0], *([stage.certificate.objective_after] if stage.certificate else [])])
    above = np.array(stage.history) - best
    steps = np.flatnonzero(above > 0)
    if len(steps) < FEWEST and len(stage.starts) < 2:
        return None
    several = len(stage.starts) > 1
    sheet = Sheet((95.0,), 1 + several, widths=(1.6, 1.0)[: 1 + several])
    ax = sheet.first()
    ax.plot(steps, above[steps], **look(BLUE, dots=1.4))
    ax.set(
        xlabel="step [1]",
        ylabel="objective above best [1]",
        yscale="log",
        xticks=_whole(0, steps[-1] if len(steps) else 1),
    )
    if several:
        starts = 100.0 * (np.sort(stage.starts) / min(stage.starts) - 1.0)
        top = 1.05 * max(starts[-1], ALIKE)
        ax = sheet.grid[0, 1]
        ax.plot(np.arange(1, len(starts) + 1), starts, **look(ORANGE, 0.8, dots=2.0))
        ax.set(xlabel="start, best first [number]", ylabel="objective above best [%]", xticks=_whole(1, len(starts)),
               ylim=(-0.05 * top, top))  # fmt: skip
    return sheet


def _whole(first: int, last: int) -> range:
    return range(first, int(last) + 1, max(1, round(last / MOST_TICKS)))
