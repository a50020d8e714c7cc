"""Figures of a gap's errors, causes and location, for a report and for a page of their own."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from math import inf, isfinite
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import to_rgba_array

from ...base.numbers import listed, number
from ...base.shorthands import Array
from ...base.statistics import NORMAL
from ...base.version import __version__
from ...fitting.scores.horizons import Errors
from ...gap.estimation.strip import Strip, running
from ...gap.estimation.varying import PATH, MagnitudeCourse
from ...gap.gap import Closure, Gap, Limit, Ranked
from ...models.effects import EFFECTS
from ..document import Document, Drawing, VerdictBox
from ..figures.sheet import (
    BLUE,
    DASHED,
    FAINT,
    INK,
    ORANGE,
    PALE,
    PURPLE,
    RUST,
    SMALL,
    ZERO,
    Look,
    Sheet,
    band,
    cells,
    label,
    look,
    notice,
    notice_sheet,
    shades,
    symbol,
)
from ..pdf import write_pdf, write_png
from .words import handy, judged, main_words, verdict

BEFORE = look(ORANGE, 1.1, "original model")
AFTER = look(BLUE, 1.3, "with the applied effects", dashes=DASHED)
MOVED = "with re-estimated parameters"
FLOOR = look(INK, 1.2, "floor: the error that noise alone leaves")
EXCESS = RUST
"""Colour of errors beyond noise, from pale to dark."""
EDGED: Look = {"edgecolor": INK, "linewidth": 0.4}
"""Style of bars."""
LEAST_AXES = 3
"""Least number of axes for which a row has space: none are wider than a third of the page."""


def row_of(count: int, height: float) -> tuple[Sheet, list[Axes]]:
    """Axes in one row."""
    sheet = Sheet((height,), max(count, LEAST_AXES))
    for ax in sheet.grid[0, count:]:
        ax.remove()
    return sheet, list(sheet.grid[0, :count])


WIDE = 0.36
"""Width of a bar; the distance between horizons is one."""


def after_words(closure: Closure, applied: bool) -> str:
    """Label of the errors after: with effects, or with re-estimated parameters only; "" if no error differs."""
    if applied:
        return str(AFTER["label"])
    return MOVED if any(error.after != error.before for error in closure.errors) else ""


def bars(closure: Closure, after: str) -> Sheet:
    """RMSE over the horizons, a panel per channel, with the floor as a line across each pair of bars.

    Parameters
    ----------
    closure : its errors are drawn.
    after : label of the errors after; "" draws only those before.
    """
    channels = list(dict.fromkeys(error.channel for error in closure.errors))
    if not channels:
        return notice_sheet("errors over horizons were not computed")
    horizons = sorted({error.horizon for error in closure.errors}, key=lambda h: math.inf if h is None else h)
    sheet, axes = row_of(len(channels), 82.0)
    for ax, channel in zip(axes, channels, strict=True):
        by_horizon = {error.horizon: error for error in closure.errors if error.channel == channel}
        at = [k for k, horizon in enumerate(horizons) if horizon in by_horizon]
        errors = [by_horizon[horizons[k]] for k in at]
        _draw(ax, np.array(at, dtype=float), errors, after)
        ax.set(xlabel="horizon [s]", xlim=(-0.6, len(horizons) - 0.4), title=label(channel, errors[0].unit))
        ax.set_xticks(range(len(horizons)), ["free" if h is None else f"{h:g}" for h in horizons])
        ax.grid(visible=False, axis="x")
    axes[0].set_ylabel("RMSE")
    return sheet


def _draw(ax: Axes, at: Array, errors: list[Errors], after: str) -> None:
    shift = WIDE / 2 if after else 0.0
    ax.bar(at - shift, [item.before for item in errors], WIDE, color=BEFORE["color"], label=BEFORE["label"], **EDGED)
    if after:
        ax.bar(at + shift, [item.after for item in errors], WIDE, color=AFTER["color"], label=after, **EDGED)
    across = np.concatenate([[k - 1.25 * WIDE, k + 1.25 * WIDE, np.nan] for k in at])
    ax.plot(across, np.concatenate([[item.floor, item.floor, np.nan] for item in errors]), **FLOOR)


SHARE_OPACITY = (0.04, 1.0)


def regimes(ax: Axes, strip: Strip) -> None:
    """Draw a map of the share of the gap over v_x and a_y; grey outside the data."""
    if not {"v_x", "a_y", "gap"} <= strip.map.keys():
        notice(ax, "speed and lateral acceleration are not recorded in every row")
        return
    share = np.asarray(strip.map["gap"], dtype=float)
    if not np.any(np.isfinite(share)) or not np.nanmax(share) > 0:
        notice(ax, "no gap to show in a map")
        return
    if not np.all(np.isfinite(share)):
        never = np.where(np.isfinite(share), np.nan, 1.0)
        cells(ax, *_edges(strip), never, FAINT, opacity=(0.9, 0.9), label="never driven")
    draw_map(ax, strip, np.maximum(share, 0.0), "share of the gap [%]", EXCESS, SHARE_OPACITY)


def draw_map(ax: Axes, strip: Strip, share: Array, words: str, colour: str, opacity: tuple[float, float]) -> None:
    """Draw shares, NaN for none, over v_x and a_y, with their scale."""
    (v_x, a_y), most = _edges(strip), float(np.nanmax(share))
    cells(ax, v_x, a_y, share / most, colour, opacity=opacity)
    shades(ax, [(part, number(100.0 * most * part, 2)) for part in (0.0, 0.5, 1.0)], words, colour, opacity=opacity)
    ax.set(xlabel="v_x [m/s]", xlim=v_x[[0, -1]], ylabel="a_y [m/s²], left positive", ylim=a_y[[0, -1]])
    ax.grid(visible=False)


def _edges(strip: Strip) -> tuple[Array, Array]:
    return np.asarray(strip.map["v_x"]), np.asarray(strip.map["a_y"])


MOST_LIMITS = 12
"""Most effects drawn."""
SIZES = (0.01, 30.0)
"""Range of the axis, relative to the usual size; larger sizes end in an arrow."""
LIMITS_HEIGHT = 150.0
TIME_OPACITY = (0.12, 0.9)


def limits(gap: Gap) -> Sheet | None:
    """Bars of detection limits relative to usual sizes, and the map of the driving; None if there is neither."""
    columns = bool(gap.limits) + (gap.strip is not None)
    if not columns:
        return None
    sheet = Sheet((LIMITS_HEIGHT,), columns, widths=(1.3, 1.0)[:columns])
    if gap.limits:
        _sizes(sheet.first(), gap.limits)
    if gap.strip is not None:
        driven(sheet.grid[0, -1], gap.strip)
    return sheet


def _sizes(ax: Axes, by_effect: Mapping[str, Limit]) -> None:
    shown = [*by_effect.items()][:MOST_LIMITS]
    at, (low, high) = np.arange(len(shown)), SIZES
    ends = np.array([min(max(item.share, 1.3 * low), high) for _, item in shown])
    unseen = np.array([item.share >= 1.0 for _, item in shown])
    for colour, words, k in (
        (PALE, "usual size is below the detection limit", unseen),
        (BLUE, "would show", ~unseen),
    ):
        if np.any(k):
            ax.barh(at[k], ends[k] - low, 0.6, low, color=colour, label=words, **EDGED)
    for row, (_, item) in enumerate(shown):
        if item.share > high:
            ax.text(0.8 * high, row, ">", size=SMALL, ha="center", va="center_baseline", color=INK)
    ax.axvline(1.0, **look(INK, 0.8))
    ax.set(xlabel="smallest detectable size / usual size [1]", xscale="log", xlim=SIZES,
           ylim=(max(len(shown), 4) - 0.4, -0.6))  # fmt: skip
    ax.set_yticks(at, [name.replace("_", " ") for name, _ in shown])
    ax.grid(visible=False, axis="y")


def driven(ax: Axes, strip: Strip) -> None:
    """Draw a map of the share of the time over v_x and a_y; blank outside the data."""
    share = np.asarray(strip.map.get("time", 0.0), dtype=float)
    most = float(np.nanmax(share, initial=0.0))
    if not {"v_x", "a_y", "time"} <= strip.map.keys() or not (isfinite(most) and most > 0):
        notice(ax, "speed and lateral acceleration are not known")
        return
    draw_map(ax, strip, np.where(share > 0, share, np.nan), "share of the time [%]", BLUE, TIME_OPACITY)


MOST, LEAST_ROWS = 6, 4
"""Most effects drawn, and least number of rows with space."""
REACH = (-0.6, 2.6)
"""Range of the axis, relative to the estimate; longer intervals end in an arrow."""
RANKING_HEIGHT = 106.0


def ranking(gap: Gap) -> Sheet:
    """Bars of probability, with lines between effects that cannot be distinguished, and intervals of the magnitudes.

    Intervals are relative to the estimate: zero is the absent effect, one its estimate. A map of the gap over speed
    and lateral acceleration follows if there is one.
    """
    shown, beside = list(gap.ranking[:MOST]), int(gap.strip is not None)
    if shown:
        sheet = Sheet((RANKING_HEIGHT,), 2 + beside, widths=(0.8, 1.0, 1.0)[: 2 + beside])
        _probabilities(sheet.grid[0, 0], gap, shown)
        _intervals(sheet.grid[0, 1], shown)
    else:
        sheet = Sheet((RANKING_HEIGHT,), 1 + beside, widths=(1.4, 1.0)[: 1 + beside])
        notice(sheet.first(), "no effect stands out")
    if gap.strip is not None:
        regimes(sheet.grid[0, -1], gap.strip)
    return sheet


def aliases(shown: Sequence[Ranked]) -> list[list[int]]:
    """Sets of rows that cannot be distinguished, directly or through others; without sets of one row."""
    place = {item.effect: k for k, item in enumerate(shown)}
    group = list(range(len(shown)))
    for k, item in enumerate(shown):
        for name in item.indistinguishable_from:
            if name in place:
                one, other = group[k], group[place[name]]
                group = [min(one, other) if g in (one, other) else g for g in group]
    result = [[k for k, g in enumerate(group) if g == one] for one in dict.fromkeys(group)]
    return [members for members in result if len(members) > 1]


def relative(effect: str, value: float, magnitude: float) -> float:
    """A magnitude relative to the estimate, from the effect's null: 0 is the absent effect, 1 the estimate."""
    definition = EFFECTS.get(effect)
    null = float(definition.parameter.array) if definition is not None else 0.0
    if not isfinite(null):  # a limit: the larger, the weaker the effect
        return magnitude / value if value else inf
    return (value - null) / (magnitude - null) if magnitude != null else float("nan")


def _probabilities(ax: Axes, gap: Gap, shown: Sequence[Ranked]) -> None:
    """Bars of probability, and lines between rows that cannot be distinguished."""
    for colour, words, is_applied in ((BLUE, "applied", True), (PALE, "not applied", False)):
        rows = [k for k, item in enumerate(shown) if (item.effect in gap.applied) == is_applied]
        if rows:
            ax.barh(rows, [shown[k].probability for k in rows], 0.5, color=colour, label=words, **EDGED)
    sets = aliases(shown)
    for k, members in enumerate(sets):
        line = look(PURPLE, 1.4, "cannot be distinguished" if k == 0 else None, dots=2.2)
        joined = [float(row) if row in members else np.nan for row in range(members[0], members[-1] + 1)]
        ax.plot(np.full(len(joined), 1.08 + 0.12 * k), joined, **line)  # no line across rows of other sets
    ax.set(xlabel="probability [1]", xlim=(0.0, 1.04 + 0.12 * len(sets)), ylim=_rows(shown))
    ax.set_xticks((0.0, 0.5, 1.0), ("0", "0.5", "1"))
    ax.set_yticks(range(len(shown)), [item.effect.replace("_", " ") for item in shown])
    ax.grid(visible=False, axis="y")


def _intervals(ax: Axes, shown: Sequence[Ranked]) -> None:
    ax.axvline(0.0, **ZERO)
    for row, item in enumerate(shown):
        _interval(ax, row, item)
    ax.set(xlabel="95 % interval / estimate [1]", xlim=REACH, ylim=_rows(shown), xticks=(0, 1, 2), yticks=())


def _rows(shown: Sequence[Ranked]) -> tuple[float, float]:
    return max(len(shown), LEAST_ROWS) - 0.4, -0.6


def _interval(ax: Axes, row: int, ranked: Ranked) -> None:
    """Estimate and interval of one effect, with both as text above."""
    ends = sorted(relative(ranked.effect, end, ranked.magnitude) for end in ranked.interval)
    centred: dict[str, Any] = {"ha": "center", "va": "center_baseline", "color": INK, "clip_on": True}
    ax.text(1.0, row - 0.36, main_words(ranked), size=7.2, **centred)
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


LARGEST = 100.0
"""Largest mean square error, relative to noise, in the range of colours."""
STRIPS_HEIGHT = 96.0
DOT = 4.4
"""Diameter of a dot on the path, points."""
PATH_OPACITY = (0.12, 1.0)


def strips(strip: Strip, stretch: Mapping[str, float], applied: bool) -> Sheet:
    """Mean square errors relative to noise over time, and along the path as shades.

    Parameters
    ----------
    strip : its errors are drawn.
    stretch : "from", "to", s: the stretch with half of the gap, shaded; nothing is shaded if empty.
    applied : whether to draw errors after.
    """
    if len(strip.time) < 2:
        return notice_sheet("too short for a plot over time")
    placed = len(strip.x) == len(strip.time) and bool(np.any(np.isfinite(strip.x)))
    sheet = Sheet((STRIPS_HEIGHT,), 1 + placed, widths=(1.6, 1.0)[: 1 + placed])
    _along_time(sheet.first(), running(strip.time), strip, stretch, applied)
    if placed:
        _along_path(sheet.grid[0, 1], strip)
    return sheet


def _along_time(ax: Axes, time: Array, strip: Strip, stretch: Mapping[str, float], applied: bool) -> None:
    values = np.concatenate([strip.before, strip.after if applied else strip.before])
    values = values[np.isfinite(values) & (values > 0)]
    low, high = (float(np.min(values)), float(np.max(values))) if len(values) else (0.5, 2.0)
    low, high = min(low, 0.7) / 1.1, max(high, 3.0) * 1.2
    if {"from", "to"} <= stretch.keys():
        ends, level = np.array([stretch["from"], stretch["to"]]), np.ones(2)
        band(ax, ends, low * level, high * level, PALE, "holds half of the gap")
    ax.axhline(1.0, **look(PALE, 0.8))
    ax.plot(time, strip.before, **BEFORE)
    if applied:
        ax.plot(time, strip.after, **AFTER)
    ax.set(xlabel="time along the recordings [s]", xlim=time[[0, -1]], yscale="log", ylim=(low, high),
           ylabel="mean square error\n/ that of noise [1]")  # fmt: skip


def _along_path(ax: Axes, strip: Strip) -> None:
    top = float(np.clip(np.nanmax(strip.before, initial=1.0), 3.0, LARGEST))
    share = np.log(np.clip(np.nan_to_num(strip.before, nan=1.0), 1.0, top)) / np.log(top)
    ticks = [item for item in (1.0, 2.0, 5.0, 10.0, 20.0, 50.0, 100.0) if item <= top]
    ticks = ticks[:: max(1, round(len(ticks) / 4))]
    placed = np.isfinite(strip.x) & np.isfinite(strip.y)
    order = np.argsort(share[placed], kind="stable")  # darkest dots on top
    x, y, shade = (
        item[placed][order]
        for item in (strip.x, strip.y, PATH_OPACITY[0] + (PATH_OPACITY[1] - PATH_OPACITY[0]) * share)
    )
    ax.scatter(x, y, DOT**2, facecolors=to_rgba_array(EXCESS, shade), edgecolors=PALE, linewidths=0.25)
    ax.set(xlabel="x [m]", ylabel="y [m]", aspect="equal", adjustable="datalim")
    scale = [(float(np.log(tick) / np.log(top)), f"{tick:g}") for tick in ticks]
    shades(ax, scale, "mean square error / that of noise [1]", EXCESS, opacity=PATH_OPACITY)


def course_drawing(course: MagnitudeCourse) -> Drawing:
    """The magnitude along the path or over time, with its 95 % interval; at its places, too, where these are known."""
    name, unit = course.effect.replace("_", " "), handy(course.unit, course.sd)
    placed = course.along == PATH
    sheet = Sheet((STRIPS_HEIGHT,), 1 + placed, widths=(1.6, 1.0)[: 1 + placed])
    value, sd, order = unit.factor * course.value, unit.factor * course.value_sd, np.argsort(course.at)
    ax, words = sheet.first(), f"{name} [{unit.unit or '1'}]"
    at = course.at[order]
    band(ax, at, (value - NORMAL * sd)[order], (value + NORMAL * sd)[order], label="95 % interval")
    ax.axhline(0.0, **ZERO)
    ax.plot(at, value[order], **look(INK, 1.2, "estimate"))
    first = "distance until a place is first passed [m]" if placed else "time along the recordings [s]"
    ax.set(xlabel=first, ylabel=f"deviation of\n{words}", xlim=(at[0], at[-1]) if at[-1] > at[0] else None)
    if placed:
        _course_at_places(sheet.grid[0, 1], course, value, words)
    caption = (
        f"Estimated course of {course.effect} {'along the path' if placed else 'over time'}, less its constant part, "
        "with its 95 % interval."
    )
    return Drawing("gap_course", sheet, caption, f"Course of {name}.")


def _course_at_places(ax: Axes, course: MagnitudeCourse, value: Array, words: str) -> None:
    most = max(float(np.max(np.abs(value))), 1e-300)
    share = np.abs(value) / most
    colours = np.where(value > 0, BLUE, RUST)
    faces = [to_rgba_array(colour, PATH_OPACITY[0] + (PATH_OPACITY[1] - PATH_OPACITY[0]) * by)[0]
             for colour, by in zip(colours.tolist(), share.tolist(), strict=True)]  # fmt: skip
    order = np.argsort(share, kind="stable")
    ax.scatter(course.x[order], course.y[order], DOT**2, facecolors=np.array(faces)[order], edgecolors=PALE,
               linewidths=0.25)  # fmt: skip
    ax.set(xlabel="x [m]", ylabel="y [m]", aspect="equal", adjustable="datalim")
    scale = [(0.0, number(-most, 2)), (0.5, "0"), (1.0, number(most, 2))]
    shades(ax, scale, words, BLUE, RUST, opacity=PATH_OPACITY)


LEAST_DENSITY = 3.0
"""Least end of the axis; its least start is the inverse."""


def spectra(strip: Strip, applied: bool) -> Sheet:
    """Spectral density of the errors relative to that of the noise, a panel per channel."""
    positive = strip.frequency > 0
    if not strip.spectrum_before or not np.any(positive):
        return notice_sheet("no spectra of the errors were kept")
    shown = [*strip.spectrum_before.values(), *(strip.spectrum_after.values() if applied else ())]
    densities = np.concatenate([item[positive] for item in shown])
    densities = densities[np.isfinite(densities) & (densities > 0)]
    low, high = (float(densities.min()), float(densities.max())) if len(densities) else (1.0, 1.0)
    low, high = min(low, 1.0 / LEAST_DENSITY), max(high, LEAST_DENSITY)
    sheet, axes = row_of(len(strip.spectrum_before), 80.0)
    for ax, (channel, before) in zip(axes, strip.spectrum_before.items(), strict=True):
        ax.axhline(1.0, **look(PALE, 0.8))
        ax.plot(strip.frequency[positive], before[positive], **BEFORE)
        if applied and channel in strip.spectrum_after:
            ax.plot(strip.frequency[positive], strip.spectrum_after[channel][positive], **AFTER)
        ax.set(xlabel="frequency [Hz]", xscale="log", yscale="log", ylim=(low, high), title=symbol(channel))
    axes[0].set_ylabel("PSD of errors / noise [1]")
    return sheet


def drawings(gap: Gap) -> tuple[Drawing, ...]:
    """Figures of errors, causes and location, with captions."""
    closure, held_out = judged(gap)
    applied = bool(gap.applied)
    on = f"{listed([*(closure.recordings or gap.recordings)])}{' (held out)' if held_out else ''}"
    figures = [
        Drawing(
            "gap_errors", bars(closure, after_words(closure, applied)),
            f"Errors of every channel over the prediction horizon, on {on}.",
            "Bars of errors over horizons, before and after, with the floor.",
        ),
        _causes(gap),
    ]  # fmt: skip
    figures += [course_drawing(course) for course in gap.courses]
    if gap.strip is not None:
        stretch = gap.where.time if gap.gap_detected else {}
        figures += [
            Drawing(
                "gap_along", strips(gap.strip, stretch, applied),
                "Mean square error of all channels, divided by that of the noise, along time and along the path.",
                "Errors over time and along the path.",
            ),
            Drawing(
                "gap_spectra", spectra(gap.strip, applied),
                "Spectral density of the errors, divided by that of the noise; 1 means that only noise is left.",
                "Spectra of the errors, divided by those of the noise.",
            ),
        ]  # fmt: skip
    return tuple(figures)


def _causes(gap: Gap) -> Drawing:
    """Ranking of the effects; if there is no gap, detection limits."""
    if gap.gap_detected or not gap.limits:
        caption = (
            "Probability of each effect, and the 95 % interval of its magnitude, divided by the estimate (0: the "
            "effect is absent)" + (". Map: share of the gap over speed and lateral acceleration." if gap.strip else ".")
        )
        alt = "Bars of probabilities of effects with their intervals; map of the gap."
        return Drawing("gap_ranking", ranking(gap), caption, alt)
    caption = (
        "Effects that are hardest to detect: their smallest detectable size, divided by their usual size. Map: speeds "
        "and lateral accelerations that were driven (blank: never driven)."
    )
    return Drawing("gap_limits", limits(gap), caption, "Bars of the smallest detectable sizes; map of what was driven.")


def page(gap: Gap) -> Document:
    """The verdict of the diagnosis above its figures, as one page of any length."""
    shown = tuple(replace(one, caption="") for one in drawings(gap))
    about = f"on {listed([*gap.recordings])}"
    return Document(
        f"Gap of {gap.model}",
        about,
        "a gap",
        f"greybox-id {__version__}",
        (VerdictBox(tuple(verdict(gap))), *shown),
        endless=True,
    )


def write_picture(gap: Gap, path: str | Path) -> Path:
    """Write the page as PNG or PDF, by the suffix of the file's name, atomically."""
    write = write_pdf if Path(path).suffix.lower() == ".pdf" else write_png
    return write(page(gap), path)
