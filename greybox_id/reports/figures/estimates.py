"""Figures of a fit's estimates: correlations, draws of the posterior, convergence, and ends of the starts."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ...base.numbers import pretty_unit
from ...base.shorthands import Array
from ...fitting.fit import Fit
from ...fitting.provenance import Stage
from ...models.parameter import free_places
from .sheet import BLUE, INK, ORANGE, SMALL, WIDE, Sheet, cells, look, shades, symbol

CELL, SMALLEST, LARGEST = 18.0, 70.0, 235.0
"""Side of a cell, and least and largest height of the figure, points."""
FEWEST = 3
"""Least number of parameters for a figure; a single correlated pair is named in the text."""
WRITTEN = 0.1
"""Smallest correlation with a printed number."""
MOST_WRITTEN = 20
"""With this number of parameters or more, cells are too small for numbers and contain only signs."""
LONGEST_LEVEL = 4
"""Longest names below cells, in characters, that are not rotated."""
MARGINS = 160.0
"""Space beside the cells, for names and scale, points."""


def correlations(fit: Fit) -> tuple[list[str], Array]:
    """Names of the estimated scalar parameters, and their correlations, (names, names)."""
    if fit.covariance is None:
        return [], np.empty((0, 0))
    variance = np.diag(fit.covariance)
    known = {name: k for name, k in free_places(fit.model.parameters).items() if 0 < variance[k] < np.inf}
    places = [*known.values()]
    inside = fit.covariance[np.ix_(places, places)]
    sd = np.sqrt(np.diag(inside))
    return [*known], np.asarray(np.clip(inside / np.outer(sd, sd), -1.0, 1.0))


def correlation(fit: Fit) -> Sheet | None:
    """The lower triangle of the correlations with numbers; None if there are too few parameters.

    The numbers include the sign for readers who cannot see the colours.
    """
    names, matrix = correlations(fit)
    n = len(names) - 1  # without the diagonal, the first has no row and the last no column
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


BINS = 25
WITH_FORM, NOISE_ALONE = "with the error of the model's form", "noise alone"
ALIKE_DRAWS = 1e-3
"""Relative difference below which draws look the same."""
CORNER = 92.0
"""Largest height of a cell, points."""


def corner(values: Array, noise_alone: Array, names: Sequence[str], units: Sequence[str]) -> Sheet:
    """Histograms on the diagonal, scatter plots of pairs below it.

    Parameters
    ----------
    values : (draws, parameters), equally weighted.
    noise_alone : (draws, parameters) without model error; drawn if different.
    names, units : of the parameters.
    """
    size, differs = len(names), not np.allclose(values, noise_alone, rtol=ALIKE_DRAWS, atol=0.0)
    widened, alone = (
        (look(BLUE, label=WITH_FORM), look(ORANGE, label=NOISE_ALONE)) if differs else (look(BLUE), look(BLUE))
    )
    sheet = Sheet((min(CORNER, 0.85 * WIDE / size),) * size, size)
    for (row, column), ax in np.ndenumerate(sheet.grid):
        if column > row:
            ax.remove()
            continue
        ax.locator_params(nbins=3)
        if row == column:
            bins = np.histogram_bin_edges(values[:, row], BINS)
            ax.hist(values[:, row], bins=bins, histtype="step", **widened)
            if differs:
                ax.hist(noise_alone[:, row], bins=bins, histtype="step", **alone)
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


FEWEST_STEPS = 4
"""Least number of steps for a figure."""
ALIKE = 0.1
"""Least range of the axis for objectives, in percent above the best, so that equal ones look equal."""
MOST_TICKS = 8


def convergence(stage: Stage) -> Sheet | None:
    """The objective above its best value, over the steps and for every start; None if there are too few of both."""
    best = min([*stage.history, stage.starts[0], *([stage.certificate.objective_after] if stage.certificate else [])])
    above = np.array(stage.history) - best
    steps = np.flatnonzero(above > 0)
    if len(steps) < FEWEST_STEPS and len(stage.starts) < 2:
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


SAME_OBJECTIVE = 1e-3
"""Relative difference of objectives up to which starts count as having reached the best one."""
REACH = 6.0
"""Range of the axis in standard deviations; ends further away are drawn at its edge with an arrow."""
ROW, MOST = 13.0, 24
"""Height per parameter, points, and most parameters drawn: those with the largest spread between starts."""


def starts(fit: Fit, stage: Stage) -> Sheet | None:
    """The end of each start in standard deviations from the estimate, a row per parameter; None for a single start."""
    spread = spread_of(fit, stage)
    if not spread:
        return None
    shown = sorted(spread, key=lambda name: -max(abs(off) for off, _ in spread[name]))[:MOST]
    sheet = Sheet((max(ROW * len(shown), 40.0),))
    ax = sheet.first()
    ax.axvline(0.0, **look(INK, 0.5))
    for same, colour, words, dots in (
        (False, ORANGE, "another objective", 2.0),
        (True, BLUE, "the best objective", 2.6),
    ):
        at = [(off, row) for row, name in enumerate(shown) for off, item in spread[name] if item is same]
        if at:
            x, y = np.array(at).T
            ax.plot(np.clip(x, -REACH, REACH), y, **look(colour, label=words, dashes="", dots=dots))
            for side, row in sorted({(np.sign(off), row) for off, row in at if abs(off) > REACH}):
                ax.text(1.05 * side * REACH, row, ">" if side > 0 else "<", size=SMALL, ha="center",
                        va="center_baseline", color=INK)  # fmt: skip
    ax.set(xlabel="(end of each start − estimate) / standard deviation [1]",
           xlim=(-1.1 * REACH, 1.1 * REACH), ylim=(len(shown) - 0.4, -0.6))  # fmt: skip
    ax.set_yticks(range(len(shown)), [symbol(name) for name in shown])
    ax.grid(visible=False, axis="y")
    return sheet


def same_as_best(stage: Stage) -> list[bool]:
    """Whether each start reached the best objective."""
    best = min(stage.starts)
    return [abs(start - best) <= SAME_OBJECTIVE * abs(best) for start in stage.starts]


def spread_of(fit: Fit, stage: Stage) -> dict[str, list[tuple[float, bool]]]:
    """Free scalar parameter with a standard deviation -> for every start, its end relative to the estimate in standard
    deviations, and whether it reached the best objective; empty for a single start.
    """
    result = {}
    for name in stage.ended_at[0] if len(stage.ended_at) > 1 else ():
        sd = float(np.ravel(fit.sd.get(name, 0.0))[0])
        if name in fit.model and np.isfinite(sd) and sd > 0:
            estimate = float(np.ravel(fit.model[name].array)[0])
            ends = [(item[name] - estimate) / sd for item in stage.ended_at]
            result[name] = list(zip(ends, same_as_best(stage), strict=True))
    return result
