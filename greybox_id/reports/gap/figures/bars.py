"""Errors of every channel over the horizons, before and after, with the floor."""

from __future__ import annotations

import math

import numpy as np
from matplotlib.axes import Axes

from ....gap import Closure, Errors
from ....parameter import Array
from ...figures.sheet import Sheet, notice_sheet
from ...figures.style import label
from .looks import AFTER, BEFORE, EDGED, FLOOR, row_of

WIDE = 0.36
"""Of a bar; the distance between horizons is one."""


def bars(closure: Closure, applied: bool) -> Sheet:
    """A panel for each channel: bars of RMSE over the horizons, the floor as a line across each pair.

    Parameters
    ----------
    closure : whose errors.
    applied : whether there is anything after; without, only what was before is drawn.
    """
    channels = list(dict.fromkeys(own.channel for own in closure.errors))
    if not channels:
        return notice_sheet("no errors over horizons were kept")
    horizons = sorted({own.horizon for own in closure.errors}, key=lambda h: math.inf if h is None else h)
    sheet, axes = row_of(len(channels), 82.0)
    for ax, channel in zip(axes, channels, strict=True):
        own = {error.horizon: error for error in closure.errors if error.channel == channel}
        at = [k for k, horizon in enumerate(horizons) if horizon in own]
        found = [own[horizons[k]] for k in at]
        _draw(ax, np.array(at, dtype=float), found, applied)
        ax.set(xlabel="horizon [s]", xlim=(-0.6, len(horizons) - 0.4), title=label(channel, found[0].unit))
        ax.set_xticks(range(len(horizons)), ["free" if h is None else f"{h:g}" for h in horizons])
        ax.grid(visible=False, axis="x")
    axes[0].set_ylabel("RMSE")
    return sheet


def _draw(ax: Axes, at: Array, found: list[Errors], applied: bool) -> None:
    shift = WIDE / 2 if applied else 0.0
    ax.bar(at - shift, [own.before for own in found], WIDE, color=BEFORE["color"], label=BEFORE["label"], **EDGED)
    if applied:
        ax.bar(at + shift, [own.after for own in found], WIDE, color=AFTER["color"], label=AFTER["label"], **EDGED)
    across = np.concatenate([[k - 1.25 * WIDE, k + 1.25 * WIDE, np.nan] for k in at])
    ax.plot(across, np.concatenate([[own.floor, own.floor, np.nan] for own in found]), **FLOOR)
