"""Correlations between the estimates of a fit: which parameters stand for each other."""

from __future__ import annotations

import numpy as np

from ...fit import Fit
from ...parameter import Array
from .sheet import WIDE, Sheet, cells, shades
from .style import BLUE, INK, ORANGE, symbol

CELL, SMALLEST, LARGEST = 18.0, 70.0, 235.0
"""Side of a cell, and height of the whole picture, points, at least and at most."""
FEWEST = 3
"""Parameters that make a picture; a pair that is told together is named anyway."""
WRITTEN = 0.1
"""Correlations smaller than this are left unwritten."""
MOST_WRITTEN = 20
"""With more parameters than this, cells are too small for numbers and hold signs."""
LONGEST_LEVEL = 4
"""Longer names below the cells are turned."""
MARGINS = 160.0
"""Points beside the cells, for names and the scale."""


def correlations(fit: Fit) -> tuple[list[str], Array]:
    """Names of the single numbers that were estimated, and their correlations, (names, names)."""
    if fit.covariance is None:
        return [], np.empty((0, 0))
    variance = np.diag(fit.covariance)
    names, places, start = [], [], 0
    for p in fit.model.parameters:
        if p.shape == () and not p.fixed and 0 < variance[start] < np.inf:
            names.append(p.name)
            places.append(start)
        start += p.size
    inside = fit.covariance[np.ix_(places, places)]
    sd = np.sqrt(np.diag(inside))
    return names, np.asarray(np.clip(inside / np.outer(sd, sd), -1.0, 1.0))


def correlation(fit: Fit) -> Sheet | None:
    """The lower triangle of the correlations as a picture, with their numbers; None with too few of them.

    The numbers say the signs to those who see no colours.
    """
    names, matrix = correlations(fit)
    n = len(names) - 1  # the first has no row, the last no column: nothing but ones on the diagonal
    if len(names) < FEWEST:
        return None
    height = min(max(CELL * n, SMALLEST), LARGEST)
    shown = np.where(np.tril(np.ones((n, n), dtype=bool)), matrix[1:, :-1], np.nan)
    share = min(1.0, max(1.5 * height / (WIDE - MARGINS), 0.2))
    sheet = Sheet((height,), 3, widths=((1 - share) / 2 + 1e-9, share, (1 - share) / 2 + 1e-9))
    for beside in sheet.grid[0, ::2]:
        beside.remove()
    ax = sheet.grid[0, 1]
    edges, opacity = np.arange(n + 1.0), (0.05, 0.65)
    cells(ax, edges, edges, shown.T, ORANGE, BLUE, opacity=opacity, gap=0.04)
    for (i, j), value in np.ndenumerate(shown):
        if abs(value) >= WRITTEN:
            ax.text(j + 0.5, i + 0.5, _written(value, n), size=min(7.0, 0.45 * height / n), ha="center",
                    va="center_baseline", color=INK)  # fmt: skip
    words, middle = [symbol(name) for name in names], edges[:-1] + 0.5
    ax.set(xlim=(0, n), ylim=(n, 0))
    ax.set_xticks(middle, words[:-1], rotation=90.0 if max(map(len, words[:-1])) > LONGEST_LEVEL else 0.0)
    ax.set_yticks(middle, words[1:])
    ax.grid(visible=False)
    ticks = [(0.5 + r / 2, f"{r:+.1f}".replace("-", "−")) for r in (-1.0, -0.5, 0.0, 0.5, 1.0)]
    shades(ax, ticks, "correlation [1]", ORANGE, BLUE, opacity=opacity)
    return sheet


def _written(value: float, n: int) -> str:
    sign = "+" if value > 0 else "−"
    return sign if n >= MOST_WRITTEN else f"{sign}{abs(value):.2f}".replace("0.", ".")
