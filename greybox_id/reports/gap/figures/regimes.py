"""Where in speed and lateral acceleration a gap lies."""

from __future__ import annotations

import numpy as np

from ....gap import Strip
from ...numbers import number
from ...plot.areas import Cells
from ...plot.figure import Panel, Shades, nothing
from ...plot.marks import Mark
from ...plot.palette import FAINT
from ...plot.scale import Axis
from .looks import EXCESS

LIGHTEST, DARKEST = 0.04, 1.0


def regimes(strip: Strip) -> Panel:
    """A map of the share of the gap over v_x and a_y; grey where nothing was driven."""
    if not {"v_x", "a_y", "gap"} <= strip.map.keys():
        return nothing("speed and lateral acceleration are not recorded")
    share = np.asarray(strip.map["gap"], dtype=float)
    most = float(np.nanmax(share, initial=0.0))
    if not np.any(np.isfinite(share)) or not most > 0:
        return nothing("no gap to be placed in a map")
    edges = np.asarray(strip.map["v_x"]), np.asarray(strip.map["a_y"])
    marks: list[Mark] = []
    if not np.all(np.isfinite(share)):
        never = np.where(np.isfinite(share), np.nan, 1.0)
        marks.append(Cells(*edges, never, FAINT, lightest=0.9, darkest=0.9, words="never driven"))
    marks.append(Cells(*edges, np.maximum(share, 0.0) / most, EXCESS, lightest=LIGHTEST, darkest=DARKEST, gap=0.15))
    ticks = tuple((part, number(100.0 * most * part, 2)) for part in (0.0, 0.5, 1.0))
    ends = [(float(own[0]), float(own[-1])) for own in edges]
    return Panel(
        tuple(marks), Axis("v_x [m/s]", *ends[0], grid=False), Axis("a_y [m/s²], left positive", *ends[1], grid=False),
        shades=Shades(ticks, "share of the gap [%]", EXCESS, LIGHTEST, DARKEST),
    )  # fmt: skip
