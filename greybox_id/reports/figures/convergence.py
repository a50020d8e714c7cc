"""How the solver came to its end, and where other starts ended."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from ...provenance import Stage
from .style import BLUE, INK, ORANGE, canvas, look

FEWEST = 4
"""Steps that make a picture."""
ALIKE = 0.1
"""Objectives that differ by less than so many percent are not to look different."""


def convergence(stage: Stage) -> Figure | None:
    """The objective over the steps, above the best; beside it that of every start. None where neither is much."""
    best = min([*stage.history, stage.starts[0], *([stage.certificate.objective_after] if stage.certificate else [])])
    above = np.array(stage.history) - best
    steps = np.flatnonzero(above > 0)
    if len(steps) < FEWEST and len(stage.starts) < 2:
        return None
    several = len(stage.starts) > 1
    with look():
        figure = canvas(1.9)
        panels = figure.subplots(1, 2 if several else 1, squeeze=False, width_ratios=[1.6, 1.0] if several else None)[0]
        panels[0].semilogy(steps, above[steps], color=BLUE, linewidth=1.1, marker="o", markersize=2.5)
        panels[0].set_xlabel("step [1]")
        panels[0].set_ylabel("objective above best [1]")
        panels[0].xaxis.set_major_locator(MaxNLocator(integer=True))
        if several:
            starts = 100.0 * (np.sort(stage.starts) / min(stage.starts) - 1.0)
            panels[1].plot(
                np.arange(1, len(starts) + 1), starts, color=ORANGE, linewidth=0.8, marker="o", markersize=3.5,
                markeredgecolor=INK, markeredgewidth=0.4,
            )  # fmt: skip
            panels[1].set_xlabel("start, best first [number]")
            panels[1].set_ylabel("objective above best [%]")
            panels[1].set_ylim(-0.05 * max(starts[-1], ALIKE), 1.05 * max(starts[-1], ALIKE))
            panels[1].xaxis.set_major_locator(MaxNLocator(integer=True))
    return figure
