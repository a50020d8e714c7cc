"""The ranked effects: how probable, how large with which interval, and which of them cannot be told apart."""

from __future__ import annotations

from collections.abc import Sequence
from math import inf, isfinite

import numpy as np

from ....gap import Gap, Ranked
from ....models.effects import EFFECTS
from ...plot.areas import Bars
from ...plot.figure import Figure, Panel, nothing
from ...plot.marks import Curve, Letters, Mark, Rule
from ...plot.palette import BLUE, INK, PALE, PURPLE, Line
from ...plot.scale import Axis
from ..quantities import magnitude_words
from .regimes import regimes

MOST, LEAST_ROWS = 6, 4
"""Effects drawn; room is left for so many at least."""
REACH = (-0.6, 2.6)
"""Of intervals, in estimates; longer ones end in an arrow."""
HEIGHT = 106.0


def ranking(gap: Gap) -> Figure:
    """Bars of probability with brackets of those that cannot be told apart, and intervals over the estimates.

    The intervals are drawn relative to the estimate: zero is an effect that is not there, one its estimate. Beside
    them stands the map of the gap over speed and lateral acceleration, where there is one.
    """
    place: list[Panel] = [] if gap.strip is None else [regimes(gap.strip)]
    shown = list(gap.ranking[:MOST])
    if not shown:
        return Figure(((nothing("no effect stands out"), *place),), (HEIGHT,), (1.4, 1.0)[: 1 + len(place)])
    rows = (max(len(shown), LEAST_ROWS) - 0.4, -0.6)
    names = tuple((float(k), own.effect.replace("_", " ")) for k, own in enumerate(shown))
    sets = aliases(shown)
    left = Panel(
        (*_bars(gap, shown), *(mark for k, members in enumerate(sets) for mark in _bracket(1.08 + 0.12 * k, members))),
        Axis("probability [1]", 0.0, 1.04 + 0.12 * len(sets), ticks=((0.0, "0"), (0.5, "0.5"), (1.0, "1"))),
        Axis(low=rows[1], high=rows[0], ticks=names, grid=False, downwards=True),
    )
    right = Panel(
        (Rule(0.0, upright=True), *(mark for k, own in enumerate(shown) for mark in _interval(k, own))),
        Axis("95 % interval over estimate [1]", *REACH, ticks=((0.0, "0"), (1.0, "1"), (2.0, "2"))),
        Axis(low=rows[1], high=rows[0], ticks=(), grid=False, downwards=True),
    )
    return Figure(((left, right, *place),), (HEIGHT,), (0.8, 1.0, 1.0)[: 2 + len(place)])


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
        return magnitude / value if value else inf
    return (value - null) / (magnitude - null) if magnitude != null else float("nan")


def _bars(gap: Gap, shown: Sequence[Ranked]) -> list[Mark]:
    found: list[Mark] = []
    for colour, words, is_applied in ((BLUE, "applied", True), (PALE, "not applied", False)):
        rows = [k for k, own in enumerate(shown) if (own.effect in gap.applied) == is_applied]
        if rows:
            at, ends = np.array(rows, dtype=float), np.array([shown[k].probability for k in rows])
            found.append(Bars(at - 0.25, at + 0.25, ends, colour, words, lying=True, edged=True))
    return found


def _bracket(x: float, members: Sequence[int]) -> list[Mark]:
    """A line that joins rows."""
    rows = np.array(members, dtype=float)
    line = Line(PURPLE, width=1.4, words="cannot be told apart")
    return [Curve(np.full(len(rows), x), rows, line, dots=2.2, counts=False)]


def _interval(row: int, own: Ranked) -> list[Mark]:
    """Estimate and interval of one effect, and both in words above it."""
    ends = sorted(relative(own.effect, end, own.magnitude) for end in own.interval)
    marks: list[Mark] = [Letters(1.0, row - 0.36, magnitude_words(own), size=7.2)]
    if any(np.isnan(end) for end in ends):
        return marks
    low, high = (min(max(end, REACH[0]), REACH[1]) for end in ends)
    level = np.full(2, float(row))
    marks += [
        Curve(np.array([low, high]), level, Line(INK, width=1.2)),
        Curve(np.array([1.0]), level[:1], Line(INK), dots=1.8, joined=False),
    ]
    for end, held, inwards, sign in ((ends[0], low, 0.06, "<"), (ends[1], high, -0.06, ">")):
        if end != held:
            marks.append(Letters(held + inwards, float(row), sign))
        else:
            marks.append(Curve(np.full(2, held), np.array([row - 0.12, row + 0.12]), Line(INK, width=1.2)))
    return marks
