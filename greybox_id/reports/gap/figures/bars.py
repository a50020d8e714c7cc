"""Errors of every channel over the horizons, before and after, with the floor."""

from __future__ import annotations

import math
from typing import Any

from matplotlib.ticker import MaxNLocator

from ....gap import Closure
from ...figures.style import label
from .looks import AFTER, BEFORE, FLOOR, Sheet, nothing, row_of

WIDE = 0.36
"""Of a bar; the distance between horizons is one."""


def bars(sheet: Sheet, closure: Closure, applied: bool) -> None:
    """A panel for each channel: bars of RMSE over the horizons, the floor as a line across each pair.

    Parameters
    ----------
    sheet : to draw on.
    closure : whose errors.
    applied : whether there is anything after; without, only what was before is drawn.
    """
    channels = list(dict.fromkeys(own.channel for own in closure.errors))
    if not channels:
        nothing(sheet.subplots(), "no errors over horizons were kept")
        return
    horizons = sorted({own.horizon for own in closure.errors}, key=lambda h: math.inf if h is None else h)
    for channel, axes in zip(channels, row_of(sheet, channels), strict=True):
        own = {error.horizon: error for error in closure.errors if error.channel == channel}
        at = [k for k, horizon in enumerate(horizons) if horizon in own]
        found = [own[horizons[k]] for k in at]
        shift = WIDE / 2 if applied else 0.0
        shape: dict[str, Any] = {"width": WIDE, "edgecolor": "black", "linewidth": 0.4, "zorder": 2}
        axes.bar([k - shift for k in at], [e.before for e in found], color=BEFORE.colour, label=BEFORE.words, **shape)
        if applied:
            axes.bar([k + shift for k in at], [e.after for e in found], color=AFTER.colour, label=AFTER.words, **shape)
        ends = [(k - 1.25 * WIDE, k + 1.25 * WIDE) for k in at]
        axes.hlines(
            [e.floor for e in found], *zip(*ends, strict=True), color=FLOOR.colour, linewidth=FLOOR.width,
            label=FLOOR.words, zorder=3,
        )  # fmt: skip
        axes.set_xticks(range(len(horizons)), ["free" if h is None else f"{h:g}" for h in horizons])
        axes.set_xlim(-0.6, len(horizons) - 0.4)
        axes.grid(axis="x", visible=False)
        axes.yaxis.set_major_locator(MaxNLocator(4, steps=[1, 2, 5, 10]))
        axes.set_title(label(channel, found[0].unit))
        axes.set_xlabel("horizon [s]")
        if channel == channels[0]:
            axes.set_ylabel("RMSE")
            named = dict(zip(*reversed(axes.get_legend_handles_labels()), strict=True))
            words = [line.words for line in (BEFORE, AFTER, FLOOR) if line.words in named]
            sheet.legend([named[own] for own in words], words, loc="outside lower center", ncols=3)
