"""What the pictures of a gap share: how before and after look, and colours of excess."""

from __future__ import annotations

from matplotlib.axes import Axes

from ...figures.sheet import Sheet
from ...figures.style import BLUE, DASHED, INK, ORANGE, RUST, Look, look

BEFORE = look(ORANGE, 1.1, "model as it was")
AFTER = look(BLUE, 1.3, "with the applied effects", dashes=DASHED)
FLOOR = look(INK, 1.2, "floor: as well as noise lets a model fit")
EXCESS = RUST
"""Colour of what is too much, from pale to dark."""
EDGED: Look = {"edgecolor": INK, "linewidth": 0.4}
"""Bars."""
LEAST = 3
"""Axes that a row has room for at least: none are drawn wider than a third of the page."""


def row_of(count: int, height: float) -> tuple[Sheet, list[Axes]]:
    """Axes side by side."""
    sheet = Sheet((height,), max(count, LEAST))
    for ax in sheet.grid[0, count:]:
        ax.remove()
    return sheet, list(sheet.grid[0, :count])
