"""The ranked effects: how probable, how large with which interval, and which of them cannot be distinguished."""

from __future__ import annotations

from collections.abc import Sequence
from math import inf, isfinite
from typing import Any

import numpy as np
from matplotlib.axes import Axes

from ....gap import Gap, Ranked
from ....models.effects import EFFECTS
from ...figures.sheet import Sheet, notice
from ...figures.style import BLUE, INK, PALE, PURPLE, SMALL, ZERO, look
from ..quantities import magnitude_words
from .looks import EDGED
from .regimes import regimes

MOST, LEAST_ROWS = 6, 4
"""Effects drawn; room is left for so many at least."""
REACH = (-0.6, 2.6)
"""Of intervals, in estimates; longer ones end in an arrow."""
HEIGHT = 106.0


def ranking(gap: Gap) -> Sheet:
    """Bars of probability with brackets of those that cannot be distinguished, and intervals over the estimates.

    The intervals are drawn relative to the estimate: zero is an effect that is not there, one its estimate. Beside
    them stands the map of the gap over speed and lateral acceleration, where there is one.
    """
    shown, beside = list(gap.ranking[:MOST]), int(gap.strip is not None)
    if shown:
        sheet = Sheet((HEIGHT,), 2 + beside, widths=(0.8, 1.0, 1.0)[: 2 + beside])
        _probabilities(sheet.grid[0, 0], gap, shown)
        _intervals(sheet.grid[0, 1], shown)
    else:
        sheet = Sheet((HEIGHT,), 1 + beside, widths=(1.4, 1.0)[: 1 + beside])
        notice(sheet.first(), "no effect stands out")
    if gap.strip is not None:
        regimes(sheet.grid[0, -1], gap.strip)
    return sheet


def aliases(shown: Sequence[Ranked]) -> list[list[int]]:
    """Rows that cannot be distinguished, as sets that are linked; those of one row alone are left out."""
    place = {own.effect: k for k, own in enumerate(shown)}
    group = list(range(len(shown)))
    for k, own in enumerate(shown):
        for name in own.indistinguishable_from:
            if name in place:
                one, other = group[k], group[place[name]]
                group = [min(one, other) if g in (one, other) else g for g in group]
    found = [[k for k, g in enumerate(group) if g == one] for one in dict.fromkeys(group)]
    return [members for members in found if len(members) > 1]


def relative(effect: str, value: float, magnitude: float) -> float:
    """A magnitude as a share of the estimate, counted from the effect's null: 0 is not there, 1 the estimate."""
    known = EFFECTS.get(effect)
    null = float(known.parameter.array) if known is not None else 0.0
    if not isfinite(null):  # a limit is the weaker the larger it is
        return magnitude / value if value else inf
    return (value - null) / (magnitude - null) if magnitude != null else float("nan")


def _probabilities(ax: Axes, gap: Gap, shown: Sequence[Ranked]) -> None:
    """Bars, and lines that join rows that cannot be distinguished."""
    for colour, words, is_applied in ((BLUE, "applied", True), (PALE, "not applied", False)):
        rows = [k for k, own in enumerate(shown) if (own.effect in gap.applied) == is_applied]
        if rows:
            ax.barh(rows, [shown[k].probability for k in rows], 0.5, color=colour, label=words, **EDGED)
    sets = aliases(shown)
    for k, members in enumerate(sets):
        line = look(PURPLE, 1.4, "cannot be distinguished" if k == 0 else None, dots=2.2)
        ax.plot(np.full(len(members), 1.08 + 0.12 * k), members, **line)
    ax.set(xlabel="probability [1]", xlim=(0.0, 1.04 + 0.12 * len(sets)), ylim=_rows(shown))
    ax.set_xticks((0.0, 0.5, 1.0), ("0", "0.5", "1"))
    ax.set_yticks(range(len(shown)), [own.effect.replace("_", " ") for own in shown])
    ax.grid(visible=False, axis="y")


def _intervals(ax: Axes, shown: Sequence[Ranked]) -> None:
    ax.axvline(0.0, **ZERO)
    for row, own in enumerate(shown):
        _interval(ax, row, own)
    ax.set(xlabel="95 % interval over estimate [1]", xlim=REACH, ylim=_rows(shown), xticks=(0, 1, 2), yticks=())


def _rows(shown: Sequence[Ranked]) -> tuple[float, float]:
    return max(len(shown), LEAST_ROWS) - 0.4, -0.6


def _interval(ax: Axes, row: int, own: Ranked) -> None:
    """Estimate and interval of one effect, and both in words above it."""
    ends = sorted(relative(own.effect, end, own.magnitude) for end in own.interval)
    centred: dict[str, Any] = {"ha": "center", "va": "center_baseline", "color": INK, "clip_on": True}
    ax.text(1.0, row - 0.36, magnitude_words(own), size=7.2, **centred)
    if any(np.isnan(end) for end in ends):
        return
    low, high = (min(max(end, REACH[0]), REACH[1]) for end in ends)
    ax.plot([low, high], [row, row], **look(INK, 1.2))
    ax.plot(1.0, row, **look(INK, dashes="", dots=1.8))
    for end, held, inwards, sign in ((ends[0], low, 0.06, "<"), (ends[1], high, -0.06, ">")):
        if end != held:
            ax.text(held + inwards, row, sign, size=SMALL, **centred)
        else:
            ax.plot([held, held], [row - 0.12, row + 0.12], **look(INK, 1.2))
