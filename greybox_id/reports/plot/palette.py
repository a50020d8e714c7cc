"""Colours and lines of all figures, on light paper and on dark.

Colours are from Okabe and Ito's palette and differ in lightness as well as in hue, and every curve has a line style of
its own, so that a figure can be read by everybody and on a grey printer. A figure names its colours; what they are is
said beside it, once for light and once for dark.
"""

from __future__ import annotations

from dataclasses import dataclass

INK, PALE, FAINT, PAPER = "ink", "pale", "faint", "paper"
BLUE, SKY, ORANGE, RUST, PURPLE, NIGHT = "blue", "sky", "orange", "rust", "purple", "night"

LIGHT = {
    INK: "#1a1a1a", PALE: "#8f8f8f", FAINT: "#e4e4e4", PAPER: "#ffffff", BLUE: "#0072b2", SKY: "#56b4e9",
    ORANGE: "#e69f00", RUST: "#c4682f", PURPLE: "#7b3f8c", NIGHT: "#1a1a3d",
}  # fmt: skip
DARK = {
    INK: "#ececec", PALE: "#9a9a9a", FAINT: "#3a3d42", PAPER: "#17191c", BLUE: "#4a9fd8", SKY: "#2f86bd",
    ORANGE: "#f0b429", RUST: "#e08a5a", PURPLE: "#c99bd8", NIGHT: "#d9e6ff",
}  # fmt: skip

SOLID, DASHED, DOTTED, CHAIN = "", "5 2", "1 2", "6 2 1.2 2"


@dataclass(frozen=True)
class Line:
    """How one kind of curve is drawn, and what it is called.

    Attributes
    ----------
    colour : by its name in the palette.
    dashes : lengths of strokes and gaps, points; "" for a solid line.
    width : points.
    words : in the legend.
    """

    colour: str
    dashes: str = SOLID
    width: float = 1.1
    words: str = ""


def style(palette: dict[str, str]) -> str:
    """The colours as a style sheet."""
    return "".join(f".s-{name}{{stroke:{own}}}.f-{name}{{fill:{own}}}" for name, own in palette.items())
