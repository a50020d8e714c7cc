"""One look for all figures: palette, type, axis labels with units, and SVG that is the same everywhere.

Colours are from Okabe and Ito's palette and differ in lightness as well as in hue, and every curve has a line style of
its own, so that a figure can be read by everybody and on a grey printer. Letters are drawn as outlines: an SVG
then needs no font of the machine it is looked at on.
"""

from __future__ import annotations

import io
import re
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

import matplotlib as mpl
from matplotlib.axes import Axes
from matplotlib.colors import LinearSegmentedColormap
from matplotlib.figure import Figure

from ...recording import Recording
from ...scores.metrics import FREE_RUN, ahead
from ...signals import SIGNALS
from ..numbers import pretty_unit

WIDTH = 6.9
"""Width of a figure, inches: the text width of the report, so that letters keep their size."""

INK, PALE = "#1a1a1a", "#9a9a9a"
BLUE, ORANGE, GREEN, PURPLE = "#0072b2", "#e69f00", "#009e73", "#7b3f8c"


@dataclass(frozen=True)
class Line:
    """How one kind of curve is drawn, and what it is called.

    Attributes
    ----------
    colour : of the curve.
    style : matplotlib's line style.
    width : points.
    words : in the legend.
    """

    colour: str
    style: str
    width: float
    words: str

    def shape(self) -> dict[str, Any]:
        """Keyword arguments of a plot."""
        return {"color": self.colour, "linestyle": self.style, "linewidth": self.width}


MEASURED = Line(INK, "-", 1.3, "measured")
NOISE = Line(PALE, "-.", 1.3, "noise")
NEAR = 0.5
"""Of all horizons, s, the one that is drawn beside the free run."""

PROTOCOL_LINES = {
    "honest": Line(ORANGE, "-", 1.0, "one sample ahead"),
    "published": Line(PALE, ":", 1.0, "as published"),
    "closed_loop": Line(BLUE, (0, (4, 1.2)), 1.1, "closed loop"),  # type: ignore[arg-type]
    ahead(NEAR): Line(ORANGE, "-", 1.0, ahead(NEAR)),
    FREE_RUN: Line(BLUE, (0, (4, 1.2)), 1.1, FREE_RUN),  # type: ignore[arg-type]
}
"""By protocol of `greybox_id.metrics`."""

LEVELS = (("#3f9fd6", "-"), ("#0072b2", "--"), ("#1a1a3d", "-."))
"""Colour and line style of an ordered quantity, low to high."""

DENSITY = LinearSegmentedColormap.from_list("density", ["#f0f0f0", "#a8a8a8"])
"""Of measured samples, behind curves."""

RAISED = "⁰¹²³⁴⁵⁶⁷⁸⁹⁻"
_LOWERED = str.maketrans(RAISED, "0123456789-")

_GREEK = "kappa|sigma|alpha|mu"

_LOOK: dict[Any, Any] = {
    "font.family": ["STIXGeneral"],
    "mathtext.fontset": "stix",
    "font.size": 9.0,
    "axes.titlesize": 9.0,
    "axes.labelsize": 9.0,
    "xtick.labelsize": 8.0,
    "ytick.labelsize": 8.0,
    "legend.fontsize": 8.0,
    "legend.frameon": False,
    "legend.handlelength": 2.2,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.linewidth": 0.6,
    "axes.edgecolor": "#4d4d4d",
    "axes.labelcolor": INK,
    "text.color": INK,
    "xtick.color": "#4d4d4d",
    "ytick.color": "#4d4d4d",
    "xtick.labelcolor": INK,
    "ytick.labelcolor": INK,
    "xtick.major.width": 0.6,
    "ytick.major.width": 0.6,
    "xtick.minor.width": 0.4,
    "ytick.minor.width": 0.4,
    "axes.grid": True,
    "axes.axisbelow": True,
    "grid.color": "#e6e6e6",
    "grid.linewidth": 0.5,
    "axes.unicode_minus": True,
    "figure.facecolor": "white",
    "figure.dpi": 100.0,
    "savefig.dpi": 100.0,
    "path.simplify": True,
    "svg.fonttype": "path",
    "svg.hashsalt": "greybox-id",
}


@contextmanager
def look() -> Iterator[None]:
    """Matplotlib's settings for making and for drawing a figure, whatever the user's own are."""
    with mpl.rc_context():
        mpl.rcdefaults()
        mpl.rcParams.update(_LOOK)
        yield


def canvas(height: float) -> Figure:
    """An empty figure of the report's width; constrained layout keeps labels apart."""
    return Figure(figsize=(WIDTH, height), layout="constrained")


def svg(figure: Figure) -> bytes:
    """A figure as SVG; the same figure always gives the same bytes."""
    buffer = io.BytesIO()
    with look():
        figure.savefig(buffer, format="svg", metadata={"Date": None, "Creator": None})
    return buffer.getvalue()


def symbol(name: str) -> str:
    """A signal's or parameter's name for a figure: a_x as a symbol with its index, yaw_rate as words."""
    found = re.fullmatch(rf"([A-Za-z]|{_GREEK})_(\w+)", name)
    if not found:
        return name.replace("_", " ") if name in SIGNALS else name
    head, indices = found.groups()
    letter = head if len(head) == 1 else f"\\{head}"
    return f"${letter}_{{{','.join(map(_index, indices.split('_')))}}}$"


def words(name: str) -> str:
    """A signal's or parameter's name for a figure, in words where it is no symbol."""
    found = symbol(name) if len(name) > 1 else f"${name}$"
    return found if "$" in found else found.replace("_", " ")


def in_mathtext(text: str) -> str:
    """Raised figures as figures' fonts draw them: they hold ² and ³ only."""
    return re.sub(f"[{RAISED}]+", lambda found: f"$^{{{found[0].translate(_LOWERED)}}}$", text)


def _index(name: str) -> str:
    """An index: a letter and a Greek name as symbols, others as words."""
    if re.fullmatch(_GREEK, name):
        return f"\\{name}"
    return name if len(name) == 1 else f"\\mathrm{{{name}}}"


def label(name: str, unit: str) -> str:
    """An axis label: a name and its unit in brackets."""
    return f"{symbol(name)} [{pretty_unit(unit)}]"


def signal_label(recording: Recording, name: str) -> str:
    """An axis label of a signal of a recording."""
    return label(name, recording.unit(name))


def legend_above(figure: Figure, axes: Axes, columns: int = 4) -> None:
    """The legend of one panel in a line above all of them."""
    handles, words = axes.get_legend_handles_labels()
    if handles:
        figure.legend(handles, words, loc="outside upper center", ncols=min(columns, len(handles)))
