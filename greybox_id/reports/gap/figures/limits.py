"""What could be there unseen: the least visible effects, and where the vehicle was driven at all."""

from __future__ import annotations

from collections.abc import Mapping
from math import isfinite

import numpy as np

from ....gap import Gap, Limit, Strip
from ...numbers import number
from ...plot.areas import Bars, Cells
from ...plot.figure import Figure, Panel, Shades, nothing
from ...plot.marks import Letters, Mark, Rule
from ...plot.palette import BLUE, INK, PALE, Line
from ...plot.scale import Axis

MOST = 12
"""Effects drawn."""
REACH = (0.01, 30.0)
"""Of sizes, in usual ones; larger ones end in an arrow."""
HEIGHT = 150.0
LIGHTEST, DARKEST = 0.12, 0.9


def limits(gap: Gap) -> Figure | None:
    """Bars of the size that would show, over the usual one, beside the map of what was driven; None for neither."""
    panels = [*([_sizes(gap.limits)] if gap.limits else []), *([driven(gap.strip)] if gap.strip is not None else [])]
    return Figure((tuple(panels),), (HEIGHT,), (1.3, 1.0)[: len(panels)]) if panels else None


def _sizes(known: Mapping[str, Limit]) -> Panel:
    shown = [*known.items()][:MOST]
    at = np.arange(float(len(shown)))
    low, high = REACH
    ends = np.array([min(max(own.share, 1.3 * low), high) for _, own in shown])
    unseen = np.array([own.share >= 1.0 for _, own in shown])
    marks: list[Mark] = [
        Bars(at[k] - 0.3, at[k] + 0.3, ends[k], colour, words, base=low, lying=True, edged=True)
        for colour, words, k in ((PALE, "usual size would not show", unseen), (BLUE, "would show", ~unseen))
        if np.any(k)
    ]
    marks += [Letters(0.8 * high, float(k), ">") for k, (_, own) in enumerate(shown) if own.share > high]
    marks.append(Rule(1.0, Line(INK, width=0.8), upright=True))
    names = tuple((float(k), name.replace("_", " ")) for k, (name, _) in enumerate(shown))
    return Panel(
        tuple(marks),
        Axis("size that would show over the usual one [1]", low, high, log=True),
        Axis(low=-0.6, high=max(len(shown), 4) - 0.4, ticks=names, grid=False, downwards=True),
    )


def driven(strip: Strip) -> Panel:
    """A map of the share of the time over v_x and a_y; blank where nothing was driven."""
    if not {"v_x", "a_y", "time"} <= strip.map.keys():
        return nothing("where it was driven is not known")
    share = np.asarray(strip.map["time"], dtype=float)
    most = float(np.nanmax(share, initial=0.0))
    if not (isfinite(most) and most > 0):
        return nothing("where it was driven is not known")
    edges = np.asarray(strip.map["v_x"]), np.asarray(strip.map["a_y"])
    drawn = np.where(share > 0, share / most, np.nan)
    cells = Cells(*edges, drawn, BLUE, lightest=LIGHTEST, darkest=DARKEST, gap=0.15)
    ticks = tuple((part, number(100.0 * most * part, 2)) for part in (0.0, 0.5, 1.0))
    ends = [(float(own[0]), float(own[-1])) for own in edges]
    return Panel(
        (cells,), Axis("v_x [m/s]", *ends[0], grid=False), Axis("a_y [m/s²], left positive", *ends[1], grid=False),
        shades=Shades(ticks, "share of the time [%]", BLUE, LIGHTEST, DARKEST),
    )  # fmt: skip
