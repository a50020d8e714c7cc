"""What the pictures of a gap share: how before and after look, and colours of excess."""

from __future__ import annotations

from collections.abc import Sequence

from ...plot.figure import Figure, Panel
from ...plot.palette import BLUE, DASHED, INK, ORANGE, RUST, Line

BEFORE = Line(ORANGE, width=1.1, words="model as it was")
AFTER = Line(BLUE, DASHED, 1.3, "with the applied effects")
FLOOR = Line(INK, width=1.2, words="floor: as well as noise lets a model fit")
EXCESS = RUST
"""Colour of what is too much, from pale to dark."""
LEAST = 3
"""Panels that a row has room for at least: none is drawn wider than a third of the page."""


def row_of(panels: Sequence[Panel], height: float) -> Figure:
    """Panels side by side."""
    return Figure(((*panels, *[None] * (LEAST - len(panels))),), (height,))
