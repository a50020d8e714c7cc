"""Estimates over time, each with its band and, where there is one, what was measured of it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ..figures.style import MEASURED, symbol
from ..numbers import pretty_unit
from ..plot.figure import Figure, Panel
from ..plot.marks import Band, Curve, Mark, Rule
from ..plot.palette import BLUE, DOTTED, INK, Line
from ..plot.scale import Axis
from .digest import Course, Digest

HEIGHT = 68.0
BORDER = Line(INK, DOTTED, 0.5)
"""Where a run begins."""
SHARE = 0.995
"""The axis shows this share of the estimates; a band may open further."""


def over_time(found: Digest) -> Figure:
    """Estimates with bands of two standard deviations, one panel each."""
    course = found.course
    x = Axis("time [s]", float(np.min(course.time)), float(np.max(course.time)))
    panels = [Panel(tuple(_marks(course, name)), x, _axis(found, name)) for name in course.sds]
    return Figure(tuple((panel,) for panel in panels), (HEIGHT,) * len(panels), joined=True)


def _marks(course: Course, name: str) -> list[Mark]:
    marks: list[Mark] = []
    for run in np.unique(course.run):
        own = course.run == run
        first = run == course.run[0]
        time, values, sd = course.time[own], course.values[name][own], course.sds[name][own]
        low, high = (values + side * 2 * sd for side in (-1, 1))
        if not first:
            marks.append(Rule(float(time[0]), BORDER, upright=True))
        marks.append(Band(time, low, high, words="± 2 sd" if first else ""))
        marks.append(Curve(time, values, Line(BLUE, width=0.9, words="estimate" if first else "")))
    if name in course.measured:
        marks.append(Curve(course.time, course.measured[name], replace(MEASURED, width=0.7)))
    return marks


def _axis(found: Digest, name: str) -> Axis:
    """An axis that shows most of the estimates; bands may open further."""
    values, sds = found.course.values[name], found.course.sds[name]
    low, high = np.nanquantile(values, [1 - SHARE, SHARE])
    margin = 0.35 * (high - low) + 2 * float(np.nanmedian(sds))
    words = f"{symbol(name)}\n[{pretty_unit(found.estimates[name].unit)}]"
    return Axis(words, float(low - margin), float(high + margin)) if margin > 0 else Axis(words)
