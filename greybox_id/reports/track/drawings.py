"""The pictures of a track with their words: estimates over time, forces over slip, and whether the filter knows how
wrong it is.
"""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes

from ..drawing import Drawing
from ..figures.sheet import Sheet, band
from ..figures.slips import forces_over_slip
from ..figures.style import BLUE, DOTTED, INK, MEASURED, PALE, ZERO, look, symbol
from ..numbers import pretty_unit
from .digest import Course, Digest

TALL = 68.0
BORDER = look(INK, 0.5, dashes=DOTTED)
"""Where a run begins."""
SHARE = 0.995
"""The axis shows this share of the estimates; a band may open further."""
MIDDLE, LOW = 60.0, 75.0


def drawings(found: Digest) -> tuple[Drawing, ...]:
    """Estimates over time, forces over slip angle where a model has them, and the innovations over time and lags."""
    how = f"{found.filter.upper()} and smoother" if found.smoothed else found.filter.upper()
    more = " What was measured of them is drawn beside them." if found.course.measured else ""
    more += f" Of {found.course.every} rows one is drawn." if found.course.every > 1 else ""
    if found.runs > 1:
        more += " Runs begin at dotted lines; where their clocks begin anew they are laid one behind the other."
    made = [
        Drawing(
            "estimates",
            over_time(found),
            f"Estimates over time ({how}), with bands of two standard deviations.{more}",
            "Estimates over time with bands.",
        )
    ]
    slips = forces_over_slip(found.course.values)
    if slips is not None:
        made.append(
            Drawing(
                "forces_over_slip",
                slips,
                "Lateral force of each axle over its slip angle, as estimated: darker where more samples lie.",
                "Lateral force over slip angle, front and rear, as a density of samples.",
            )
        )
    made += [
        Drawing(
            "innovations",
            squares(found),
            "Normalised innovations squared (NIS), means over 2 s, and within which bounds 95 % of them lie if the "
            "filter knows how wrong it is.",
            "NIS of each reading over time with its bounds.",
        ),
        Drawing(
            "whiteness",
            whiteness(found),
            "Correlation of innovations with those a lag later. If the filter takes from the readings all that they "
            "tell, an innovation does not depend on those before; what stays outside the band is something the model "
            "lacks, or noise that has a memory of its own.",
            "Correlation of the innovations of each reading over lags, with its band.",
        ),
    ]
    return tuple(made)


def over_time(found: Digest) -> Sheet:
    """Estimates with bands of two standard deviations, one panel each."""
    course = found.course
    sheet = Sheet((TALL,) * len(course.sds), joined=True)
    for ax, name in zip(sheet.grid[:, 0], course.sds, strict=True):
        _draw(ax, course, name)
        ax.set_ylabel(f"{symbol(name)}\n[{pretty_unit(found.estimates[name].unit)}]")
    ax.set(xlabel="time [s]", xlim=(np.min(course.time), np.max(course.time)))
    return sheet


def _draw(ax: Axes, course: Course, name: str) -> None:
    """Estimates of every run; the axis shows most of them, bands may open further."""
    for run in np.unique(course.run):
        own = course.run == run
        first = run == course.run[0]
        time, values, sd = course.time[own], course.values[name][own], course.sds[name][own]
        if not first:
            ax.axvline(float(time[0]), **BORDER)
        band(ax, time, values - 2 * sd, values + 2 * sd, label="± 2 sd" if first else None)
        ax.plot(time, values, **look(BLUE, 0.9, "estimate" if first else None))
    if name in course.measured:
        ax.plot(course.time, course.measured[name], **MEASURED | {"linewidth": 0.7})
    low, high = np.nanquantile(course.values[name], [1 - SHARE, SHARE])
    margin = 0.35 * (high - low) + 2 * float(np.nanmedian(course.sds[name]))
    if margin > 0:
        ax.set_ylim(low - margin, high + margin)


def squares(found: Digest) -> Sheet:
    """Normalised innovations squared over time, one panel for each reading."""
    ends = np.array([np.min(found.course.time), np.max(found.course.time)])
    sheet = Sheet((MIDDLE,) * len(found.innovations), joined=True)
    for ax, (name, own) in zip(sheet.grid[:, 0], found.innovations.items(), strict=True):
        band(ax, ends, np.full(2, own.low), np.full(2, own.high), PALE, "95 % of windows, if consistent", 0.4)
        ax.plot(own.time, own.nis, **look(BLUE, 0.6, "mean over 2 s", dots=1.2))
        ax.set(ylabel=f"NIS {symbol(name)}\n[1]", yscale="log")
    ax.set(xlabel="time [s]", xlim=ends)
    return sheet


def whiteness(found: Digest) -> Sheet:
    """Correlations of innovations with later ones, one panel for each reading."""
    sheet = Sheet((LOW,), len(found.innovations))
    for ax, (name, own) in zip(sheet.grid[0], found.innovations.items(), strict=True):
        half = np.full(2, found.consistency[name].correlation_bound)
        band(ax, own.lags[[0, -1]], -half, half, PALE, "95 % if independent", 0.4)
        ax.axhline(0.0, **ZERO)
        ax.plot(own.lags, own.correlation, **look(BLUE, 0.9, dots=1.2))
        ax.set(
            xlabel="lag [s]", xlim=(0.0, own.lags[-1]), ylabel="correlation [1]", ylim=(-0.6, 1.05), title=symbol(name)
        )
        ax.set_yticks((-0.5, 0.0, 0.5, 1.0), ("−0.5", "0", "0.5", "1"))
    return sheet
