"""The ranked effects: how probable, how large with which interval, and which of them cannot be told apart."""

from __future__ import annotations

from collections.abc import Sequence
from math import isfinite

from matplotlib.axes import Axes

from ....gap import Gap, Ranked
from ....models.effects import EFFECTS
from ...figures.style import BLUE, INK, PALE, PURPLE, in_mathtext
from ..quantities import magnitude_words
from .looks import Sheet, nothing

MOST, LEAST_ROWS = 6, 4
"""Effects drawn; room is left for so many at least."""
REACH = (-0.6, 2.6)
"""Of intervals, in estimates; longer ones end in an arrow."""


def ranking(sheet: Sheet, gap: Gap) -> None:
    """Bars of probability with brackets of those that cannot be told apart, and intervals over the estimates.

    The intervals are drawn relative to the estimate: zero is an effect that is not there, one its estimate.
    """
    shown = list(gap.ranking[:MOST])
    if not shown:
        nothing(sheet.subplots(), "no effect stands out")
        return
    left, right = sheet.subplots(1, 2, sharey=True, width_ratios=[1.0, 1.0])
    rows = range(len(shown))
    colours = [BLUE if own.effect in gap.applied else PALE for own in shown]
    left.barh(rows, [own.probability for own in shown], height=0.5, color=colours, edgecolor="black", linewidth=0.4)
    left.set_yticks(rows, [own.effect for own in shown], fontsize=8.0)
    left.set_ylim(max(len(shown), LEAST_ROWS) - 0.4, -0.6)
    left.set_xlabel("probability")
    left.grid(axis="y", visible=False)
    sets = aliases(shown)
    for k, members in enumerate(sets):
        _bracket(left, 1.08 + 0.12 * k, members)
    left.set_xlim(0, 1.04 + 0.12 * len(sets) + (0.04 if sets else 0.0))
    left.set_xticks([0, 0.5, 1])
    right.axvline(0.0, color=INK, linewidth=0.6)
    for k, own in enumerate(shown):
        _interval(right, k, own)
    right.set_xlim(*REACH)
    right.set_xticks([0, 1, 2])
    right.set_xlabel("95 % interval over estimate")
    right.grid(axis="y", visible=False)
    right.tick_params(axis="y", length=0)


def aliases(shown: Sequence[Ranked]) -> list[list[int]]:
    """Rows that cannot be told apart, as sets that are linked; those of one row alone are left out."""
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
        return magnitude / value if value else float("inf")
    return (value - null) / (magnitude - null) if magnitude != null else float("nan")


def _bracket(axes: Axes, x: float, members: Sequence[int]) -> None:
    """A line that joins rows."""
    axes.plot([x, x], [members[0], members[-1]], color=PURPLE, linewidth=1.4, clip_on=False)
    axes.plot([x] * len(members), members, color=PURPLE, marker="<", markersize=5, linestyle="", clip_on=False)


def _interval(axes: Axes, row: int, own: Ranked) -> None:
    """Estimate and interval of one effect, and both in words above it."""
    ends = sorted(relative(own.effect, end, own.magnitude) for end in own.interval)
    axes.text(1.0, row - 0.2, in_mathtext(magnitude_words(own)), ha="center", va="bottom", fontsize=7.5)
    if not all(isfinite(end) or end in (float("inf"), float("-inf")) for end in ends):
        return
    low, high = (min(max(end, REACH[0]), REACH[1]) for end in ends)
    axes.plot([low, high], [row, row], color=INK, linewidth=1.2)
    for end, held, marker in ((ends[0], low, "<"), (ends[1], high, ">")):
        cut = end != held
        axes.plot(held, row, color=INK, marker=marker if cut else "|", markersize=4 if cut else 5, clip_on=False)
    axes.plot(1.0, row, color=INK, marker="o", markersize=3.5)
