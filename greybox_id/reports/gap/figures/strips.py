"""A gap along time and along the path."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import LogNorm
from matplotlib.ticker import LogLocator

from ....gap import Strip
from ....parameter import Array
from ...figures.style import PALE
from .looks import AFTER, BEFORE, EXCESS, Sheet, nothing, ticks

LARGEST = 100.0
"""Excess, times the noise, at which colours end at most."""
BAND = 0.07
"""Height of the strip of colours under time, of the panel's."""
TALLEST, WIDEST = 2.0, 2.4
"""Proportions beyond which a path is given more air around it."""


def strips(sheet: Sheet, strip: Strip, stretch: Mapping[str, float], applied: bool) -> None:
    """Mean square errors over the noise's along time, and the path in the same colours.

    Parameters
    ----------
    sheet, strip : to draw on, and what.
    stretch : "from", "to", s: the stretch that holds half of the gap, shaded; empty shades nothing.
    applied : whether there is anything after.
    """
    if len(strip.time) < 2:
        nothing(sheet.subplots(), "too short to be drawn along time")
        return
    path = len(strip.x) == len(strip.time) and bool(np.any(np.isfinite(strip.x)))
    axes = sheet.subplots(1, 2, width_ratios=[1.75, 1.0]) if path else [sheet.subplots()]
    top = float(np.clip(np.nanmax(strip.before, initial=1.0), 3.0, LARGEST))
    colours = {"cmap": EXCESS, "norm": LogNorm(1.0, top, clip=True)}
    along = running(strip.time)
    _along_time(axes[0], along, strip, stretch if np.array_equal(along, strip.time) else {}, applied, colours)
    if path:
        _along_path(sheet, axes[1], strip, colours)


def running(time: Array) -> Array:
    """Time that goes on where it starts again, as it does between recordings."""
    steps = np.diff(time, prepend=time[0] if len(time) else 0.0)
    usual = float(np.median(steps[steps > 0])) if np.any(steps > 0) else 1.0
    if np.all(steps >= 0):
        return time
    return np.asarray(time[0] + np.cumsum(np.where(steps < 0, usual, steps)))


def _along_time(
    axes: Axes, time: Array, strip: Strip, stretch: Mapping[str, float], applied: bool, colours: Mapping[str, Any]
) -> None:
    axes.set_yscale("log")
    if {"from", "to"} <= stretch.keys():
        axes.axvspan(stretch["from"], stretch["to"], color="#e9e9e9", zorder=0, label="holds half of the gap")
    axes.axhline(1.0, color=PALE, linewidth=0.8)
    axes.plot(time, strip.before, **BEFORE.shape())
    if applied:
        axes.plot(time, strip.after, **AFTER.shape())
    half = float(np.median(np.diff(time))) / 2
    edges = np.append(time - half, time[-1] + half)
    axes.pcolormesh(
        edges, [0.0, BAND], strip.before[None, :], transform=axes.get_xaxis_transform(), zorder=4, **colours
    )
    values = np.concatenate([strip.before, strip.after if applied else strip.before])
    values = values[np.isfinite(values) & (values > 0)]
    low, high = (float(np.min(values)), float(np.max(values))) if len(values) else (0.5, 2.0)
    low, high = min(low, 0.7), max(high, 3.0)
    axes.set_ylim(low * (low / high) ** (2.0 * BAND), high * 1.3)
    axes.set_xlim(edges[0], edges[-1])
    ticks(axes.yaxis, low, high)
    axes.set_xlabel("time [s]" if time is strip.time else "time, recordings one after the other [s]")
    axes.set_ylabel("mean square error\nover the noise's [–]")
    if stretch:
        axes.legend(loc="upper left", fontsize=7.5)


def _along_path(sheet: Sheet, axes: Axes, strip: Strip, colours: Mapping[str, Any]) -> None:
    order = np.argsort(np.nan_to_num(strip.before))  # the worst on top
    drawn = axes.scatter(
        strip.x[order], strip.y[order], c=np.maximum(strip.before[order], 1.0), s=9, linewidths=0.2,
        edgecolors="#555555", **colours,
    )  # fmt: skip
    axes.set_aspect("equal", adjustable="datalim")
    axes.set_xlabel("x [m]")
    axes.set_ylabel("y [m]")
    axes.margins(0.08)
    bar = sheet.colorbar(drawn, ax=axes, aspect=20, pad=0.02, format="{x:g}", ticks=LogLocator(subs=(1.0, 2.0, 5.0)))
    bar.set_label("before, over the noise's [–]")
    bar.outline.set_linewidth(0.4)
    bar.minorticks_off()
