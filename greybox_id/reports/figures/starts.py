"""Where several starts of a fit ended: whether those that are as good are the same, and those that are not, where."""

from __future__ import annotations

import numpy as np

from ...fit import Fit
from ...provenance import Stage
from .sheet import Sheet
from .style import BLUE, INK, ORANGE, SMALL, look, symbol

SAME_OBJECTIVE = 1e-3
"""Starts whose objective is within this share of the best count as having found the same."""
REACH = 6.0
"""Standard deviations drawn; what is further off lies at the edge, beside an arrow."""
ROW, MOST = 13.0, 24
"""Points per parameter, and parameters drawn: those that starts spread most."""


def starts(fit: Fit, stage: Stage) -> Sheet | None:
    """Where each start ended, in standard deviations from the estimate, row by row; None for one start."""
    found = spread_of(fit, stage)
    if not found:
        return None
    shown = sorted(found, key=lambda name: -max(abs(off) for off, _ in found[name]))[:MOST]
    sheet = Sheet((max(ROW * len(shown), 40.0),))
    ax = sheet.first()
    ax.axvline(0.0, **look(INK, 0.5))
    for same, colour, words, dots in (
        (False, ORANGE, "another objective", 2.0),
        (True, BLUE, "the best objective", 2.6),
    ):
        at = [(off, row) for row, name in enumerate(shown) for off, own in found[name] if own is same]
        if at:
            x, y = np.array(at).T
            ax.plot(np.clip(x, -REACH, REACH), y, **look(colour, label=words, dashes="", dots=dots))
            for side, row in sorted({(np.sign(off), row) for off, row in at if abs(off) > REACH}):
                ax.text(1.05 * side * REACH, row, ">" if side > 0 else "<", size=SMALL, ha="center",
                        va="center_baseline", color=INK)  # fmt: skip
    ax.set(xlabel="end of each start less the estimate, over its standard deviation [1]",
           xlim=(-1.1 * REACH, 1.1 * REACH), ylim=(len(shown) - 0.4, -0.6))  # fmt: skip
    ax.set_yticks(range(len(shown)), [symbol(name) for name in shown])
    ax.grid(visible=False, axis="y")
    return sheet


def same_as_best(stage: Stage) -> list[bool]:
    """Of every start, whether its objective is that of the best."""
    best = min(stage.starts)
    return [abs(own - best) <= SAME_OBJECTIVE * abs(best) for own in stage.starts]


def spread_of(fit: Fit, stage: Stage) -> dict[str, list[tuple[float, bool]]]:
    """Free numbers with a standard deviation -> of every start, where it ended beside the estimate, in standard
    deviations, and whether its objective is that of the best; empty for a single start.
    """
    found = {}
    for name in stage.ended_at[0] if len(stage.ended_at) > 1 else ():
        sd = float(np.ravel(fit.sd.get(name, 0.0))[0])
        if name in fit.model and np.isfinite(sd) and sd > 0:
            estimate = float(np.ravel(fit.model[name].array)[0])
            ends = [(own[name] - estimate) / sd for own in stage.ended_at]
            found[name] = list(zip(ends, same_as_best(stage), strict=True))
    return found
