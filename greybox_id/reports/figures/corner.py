"""Draws of a posterior: every parameter's histogram, and every pair of them as dots."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ...parameter import Array
from ..numbers import pretty_unit
from .sheet import WIDE, Sheet
from .style import BLUE, SMALL, symbol

BINS = 25
CELL = 92.0
"""Height of a cell at most, points."""


def corner(values: Array, names: Sequence[str], units: Sequence[str]) -> Sheet:
    """Histograms on the diagonal, pairs below it.

    Parameters
    ----------
    values : (draws, parameters), all of the same weight.
    names, units : of the parameters.
    """
    size = len(names)
    sheet = Sheet((min(CELL, 0.85 * WIDE / size),) * size, size)
    for (row, column), ax in np.ndenumerate(sheet.grid):
        if column > row:
            ax.remove()
            continue
        ax.locator_params(nbins=3)
        if row == column:
            ax.hist(values[:, row], bins=BINS, histtype="step", color=BLUE)
            ax.set_yticks([])
        else:
            ax.plot(values[:, column], values[:, row], linestyle="", marker=".", markersize=1, alpha=0.3, color=BLUE)
        if row < size - 1:
            ax.set_xticklabels([])
        else:
            ax.set_xlabel(f"{symbol(names[column])} [{pretty_unit(units[column])}]", fontsize=SMALL)
            ax.tick_params(axis="x", labelrotation=90)
        if column > 0 or row == 0:
            ax.set_yticklabels([])
        else:
            ax.set_ylabel(f"{symbol(names[row])} [{pretty_unit(units[row])}]", fontsize=SMALL)
    return sheet
