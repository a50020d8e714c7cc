"""Where several starts of a fit ended: whether those that are as good are the same, and those that are not, where."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ...fit import Fit
from ...provenance import Stage
from ..convergence import spread_of
from ..plot.figure import Figure, Panel
from ..plot.marks import Curve, Letters, Mark, Rule
from ..plot.palette import BLUE, INK, ORANGE, Line
from ..plot.scale import Axis
from .style import symbol

REACH = 6.0
"""Standard deviations drawn; what is further off lies at the edge, beside an arrow."""
ROW, MOST = 13.0, 24
"""Points per parameter, and parameters drawn: those that starts spread most."""


def starts(fit: Fit, stage: Stage) -> Figure | None:
    """Where each start ended, in standard deviations from the estimate, row by row; None for one start."""
    found = spread_of(fit, stage)
    if not found:
        return None
    shown = sorted(found, key=lambda name: -max(abs(off) for off, _ in found[name]))[:MOST]
    marks: list[Mark] = [Rule(0.0, Line(INK, width=0.5), upright=True)]
    for same, colour, words in ((False, ORANGE, "another objective"), (True, BLUE, "the best objective")):
        at = [(off, float(row)) for row, name in enumerate(shown) for off, own in found[name] if own is same]
        if at:
            marks += _dots(at, Line(colour, words=words), 2.6 if same else 2.0)
    ticks = tuple((float(k), symbol(name)) for k, name in enumerate(shown))
    panel = Panel(
        tuple(marks),
        Axis("end of each start less the estimate, over its standard deviation [1]", -1.1 * REACH, 1.1 * REACH),
        Axis(low=-0.6, high=len(shown) - 0.4, ticks=ticks, grid=False, downwards=True),
    )
    return Figure(((panel,),), (max(ROW * len(shown), 40.0),))


def _dots(at: Sequence[tuple[float, float]], line: Line, size: float) -> list[Mark]:
    x, y = np.array(at).T
    marks: list[Mark] = [Curve(np.clip(x, -REACH, REACH), y, line, size, joined=False)]
    edges = {(np.sign(off), row) for off, row in at if abs(off) > REACH}
    return [
        *marks,
        *(Letters(float(side) * 1.05 * REACH, row, ">" if side > 0 else "<") for side, row in sorted(edges)),
    ]
