"""Figure of the course of an effect that varies."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import to_rgba_array

from ...base.numbers import number
from ...base.shorthands import Array
from ...base.statistics import NORMAL
from ...gap.estimation.varying import PATH, MagnitudeCourse
from ..document import Drawing
from ..figures.sheet import BLUE, INK, PALE, RUST, ZERO, Sheet, band, look, shades
from .words import handy

HEIGHT, DOT = 96.0, 5.0
OPACITY = (0.1, 1.0)


def course_drawing(course: MagnitudeCourse) -> Drawing:
    """The magnitude along the path or over time, with its 95 % interval; at its places, too, where these are known."""
    name, unit = course.effect.replace("_", " "), handy(course.unit, course.sd)
    placed = course.along == PATH
    sheet = Sheet((HEIGHT,), 1 + placed, widths=(1.6, 1.0)[: 1 + placed])
    value, sd, order = unit.factor * course.value, unit.factor * course.value_sd, np.argsort(course.at)
    ax, words = sheet.first(), f"{name} [{unit.unit or '1'}]"
    at = course.at[order]
    band(ax, at, (value - NORMAL * sd)[order], (value + NORMAL * sd)[order], label="95 % interval")
    ax.axhline(0.0, **ZERO)
    ax.plot(at, value[order], **look(INK, 1.2, "estimate"))
    first = "distance until a place is first passed [m]" if placed else "time along the recordings [s]"
    ax.set(xlabel=first, ylabel=f"deviation of\n{words}", xlim=(at[0], at[-1]) if at[-1] > at[0] else None)
    if placed:
        _at_places(sheet.grid[0, 1], course, value, words)
    caption = (
        f"Estimated course of {course.effect} {'along the path' if placed else 'over time'}, less its constant part, "
        "with its 95 % interval."
    )
    return Drawing("gap_course", sheet, caption, f"Course of {name}.")


def _at_places(ax: Axes, course: MagnitudeCourse, value: Array, words: str) -> None:
    most = max(float(np.max(np.abs(value))), 1e-300)
    share = np.abs(value) / most
    colours = np.where(value > 0, BLUE, RUST)
    faces = [to_rgba_array(colour, OPACITY[0] + (OPACITY[1] - OPACITY[0]) * by)[0]
             for colour, by in zip(colours.tolist(), share.tolist(), strict=True)]  # fmt: skip
    order = np.argsort(share, kind="stable")
    ax.scatter(course.x[order], course.y[order], DOT**2, facecolors=np.array(faces)[order], edgecolors=PALE,
               linewidths=0.25)  # fmt: skip
    ax.set(xlabel="x [m]", ylabel="y [m]", aspect="equal", adjustable="datalim")
    scale = [(0.0, number(-most, 2)), (0.5, "0"), (1.0, number(most, 2))]
    shades(ax, scale, words, BLUE, RUST, opacity=OPACITY)
