"""What figures share: colours, how levels of a quantity are told apart, labels with units.

Colours are from Okabe and Ito's palette and differ in lightness as well as in hue, and every curve has a line style of
its own, so that a figure can be read by everybody and on a grey printer. A look is matplotlib's keywords of a line; its
label stands in the legend.
"""

from __future__ import annotations

from typing import Any

from ...base.numbers import pretty_unit
from ...base.signals import SIGNALS
from ...datasets.recording import Recording
from ..words import spans

INK = "#1a1a1a"
PALE = "#8f8f8f"
FAINT = "#e4e4e4"
BLUE = "#0072b2"
SKY = "#56b4e9"
ORANGE = "#e69f00"
RUST = "#c4682f"
PURPLE = "#7b3f8c"
NIGHT = "#1a1a3d"
LIGHT = {
    "ink": INK, "pale": PALE, "faint": FAINT, "blue": BLUE, "sky": SKY, "orange": ORANGE, "rust": RUST,
    "purple": PURPLE, "night": NIGHT,
}  # fmt: skip
DARK = {
    "ink": "#ececec", "pale": "#9a9a9a", "faint": "#3a3d42", "blue": "#4a9fd8", "sky": "#2f86bd", "orange": "#f0b429",
    "rust": "#e08a5a", "purple": "#c99bd8", "night": "#d9e6ff",
}  # fmt: skip
"""The same colours on dark paper."""
SIZE, SMALL = 8.6, 7.8
"""Of labels, and of ticks, points."""
DASHED: Any = (0.0, (5.0, 2.0))
DOTTED: Any = (0.0, (1.0, 2.0))
CHAIN: Any = (0.0, (6.0, 2.0, 1.2, 2.0))

Look = dict[str, Any]


def look(colour: str, width: float = 1.1, label: str | None = None, *, dashes: Any = "-", dots: float = 0.0) -> Look:
    """Keywords of a line: its colour, width and the radius of dots on it, points, dashes and label in the legend."""
    look: Look = {"color": colour, "linewidth": width, "linestyle": dashes, "label": label}
    return look | ({"marker": "o", "markersize": 2 * dots, "markeredgewidth": 0.0} if dots else {})


MEASURED = look(INK, 1.2, "measured")
NOISE = look(PALE, 1.3, "noise", dashes=CHAIN)
ZERO = look(INK, 0.6)
"""A line across the axes."""
LEVELS = (look(SKY), look(BLUE, dashes=DASHED), look(NIGHT, dashes=CHAIN))
"""An ordered quantity, low to high."""


def symbol(name: str) -> str:
    """A signal's or parameter's name in a figure: yaw_rate in words, a_x left to be set as a symbol."""
    if name in SIGNALS and not spans(name)[0].symbol:
        return name.replace("_", " ")
    return name if spans(name)[0].symbol or len(name) == 1 else name.replace("_", " ")


def label(name: str, unit: str) -> str:
    """An axis label: a name and its unit in brackets."""
    return f"{symbol(name)} [{pretty_unit(unit)}]"


def signal_label(recording: Recording, name: str) -> str:
    """An axis label of a signal of a recording."""
    return label(name, recording.unit(name))
