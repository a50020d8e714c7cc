"""Correlations between the estimates of a fit: which parameters stand for each other."""

from __future__ import annotations

import numpy as np
from matplotlib.colors import LinearSegmentedColormap, Normalize
from matplotlib.figure import Figure

from ...fit import Fit
from ...parameter import Array
from .style import BLUE, INK, ORANGE, WIDTH, canvas, look, words

CELL, SMALLEST, LARGEST = 0.26, 1.3, 4.2
"""Side of a cell, and of the whole picture, inches, at least and at most."""
GAP, BAR = 0.15, 0.12
"""Inches between the picture and the scale beside it, and the scale's width."""
LETTER = 0.055
"""Inches that a letter of a name takes."""
FEWEST = 3
"""Parameters that make a picture; a pair that is told together is named anyway."""
WRITTEN = 0.1
"""Correlations smaller than this are left unwritten."""
MOST_WRITTEN = 20
"""With more parameters than this, cells are too small for numbers and hold signs."""


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


def correlation(fit: Fit) -> Figure | None:
    """The lower triangle of the correlations as a picture, with their numbers; None with too few of them.

    Blue is darker than orange, so that signs can be told on a grey printer; the numbers say them too.
    """
    names, matrix = correlations(fit)
    n = len(names) - 1  # the first has no row, the last no column: nothing but ones on the diagonal
    if len(names) < FEWEST:
        return None
    side = min(max(CELL * n, SMALLEST), LARGEST)
    cell = side / n
    with look():
        longest = LETTER * max(len(name) if "$" not in words(name) else 3 for name in names) + 0.15
        left, below, above = max((WIDTH - side) / 2, longest), longest if _long(names) else 0.3, 0.08
        height = below + side + above
        figure = canvas(height)
        figure.set_layout_engine("none")  # squares of a size and names of a length: the layout is known
        axes = figure.add_axes((left / WIDTH, below / height, side / WIDTH, side / height))
        shown = np.ma.masked_array(matrix[1:, :-1], np.triu(np.ones((n, n), dtype=bool), 1))
        picture = axes.pcolormesh(shown, cmap=_DIVERGING, norm=Normalize(-1.0, 1.0), edgecolors="white", linewidth=0.6)
        axes.invert_yaxis()
        axes.set_xticks(np.arange(n) + 0.5, [words(name) for name in names[:-1]], rotation=90 if _long(names) else 0)
        axes.set_yticks(np.arange(n) + 0.5, [words(name) for name in names[1:]])
        axes.tick_params(length=0)
        axes.grid(visible=False)
        axes.spines[:].set_visible(False)
        for (i, j), value in np.ndenumerate(shown):
            if j <= i and abs(value) >= WRITTEN:
                sign = "+" if value > 0 else "−"
                written = sign if n >= MOST_WRITTEN else f"{sign}{abs(value):.2f}".replace("0.", ".")
                axes.text(
                    j + 0.5, i + 0.5, written, ha="center", va="center", fontsize=min(7.0, 24 * cell),
                    color="white" if value < _DARK else INK,
                )  # fmt: skip
        beside = axes.inset_axes((1.0 + GAP / side, 0.0, BAR / side, 1.0))
        bar = figure.colorbar(picture, cax=beside)
        bar.set_label("correlation [1]")
        bar.outline.set_visible(False)
    return figure


def _long(names: list[str]) -> bool:
    return any("$" not in words(name) and len(name) > 3 for name in names)


_DARK = -0.6
"""Below this the blue is dark enough for white letters."""
_DIVERGING = LinearSegmentedColormap.from_list("correlation", [BLUE, "#f7f7f7", ORANGE])
