"""What the panels of a gap share: how before and after look, the colours of excess, words where there is nothing."""

from __future__ import annotations

from collections.abc import Sequence

from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.colors import LinearSegmentedColormap
from matplotlib.figure import Figure, SubFigure
from matplotlib.ticker import LogLocator

from ...figures.style import BLUE, INK, ORANGE, Line

Sheet = Figure | SubFigure
"""What panels are drawn on."""

BEFORE = Line(ORANGE, "-", 1.1, "model as it was")
AFTER = Line(BLUE, (0, (4, 1.2)), 1.3, "with the applied effects")  # type: ignore[arg-type]
FLOOR = Line(INK, "-", 1.2, "floor: as well as noise lets a model fit")

EXCESS = LinearSegmentedColormap.from_list("excess", ["#f4f4f4", "#f2c35c", "#c4682f", "#5b2333", "#170b14"])
"""From none to much: lightness falls all the way, so that it reads in grey as well."""
NEVER = "#ffffff"
"""Where nothing was driven: white, with a hatch."""
CHANNELS = 5
"""Panels in a row of channels; where there are fewer the row is as wide."""


def ticks(axis: Axis, low: float, high: float) -> None:
    """Ticks of a logarithmic axis in plain numbers, more of them where it is short."""
    axis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0) if high < 50.0 * low else (1.0,)))
    axis.set_major_formatter("{x:g}")
    axis.set_minor_formatter("")


def nothing(axes: Axes, words: str) -> None:
    """An empty panel that says why."""
    axes.set_axis_off()
    axes.text(0.5, 0.5, words, ha="center", va="center", transform=axes.transAxes, fontsize=8.5, color="#555555")


def row_of(sheet: Sheet, channels: Sequence[str], sharey: bool = False) -> list[Axes]:
    """Panels side by side, one for each channel; no panel is drawn wider than a third of the sheet."""
    width = max(len(channels), 3)
    panels = list(sheet.subplots(1, width, squeeze=False, sharey=sharey)[0])
    for axes in panels[len(channels) :]:
        axes.remove()
    return panels[: len(channels)]
