"""Errors of every channel over the horizons, before and after, with the floor."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from ....gap import Closure, Errors
from ...figures.style import label
from ...plot.areas import Bars
from ...plot.figure import Figure, Panel, nothing
from ...plot.marks import Curve, Mark
from ...plot.scale import Axis
from .looks import AFTER, BEFORE, FLOOR, row_of

WIDE = 0.36
"""Of a bar; the distance between horizons is one."""


def bars(closure: Closure, applied: bool) -> Figure:
    """A panel for each channel: bars of RMSE over the horizons, the floor as a line across each pair.

    Parameters
    ----------
    closure : whose errors.
    applied : whether there is anything after; without, only what was before is drawn.
    """
    channels = list(dict.fromkeys(own.channel for own in closure.errors))
    if not channels:
        return Figure(((nothing("no errors over horizons were kept"),),), (40.0,))
    horizons = sorted({own.horizon for own in closure.errors}, key=lambda h: math.inf if h is None else h)
    ticks = tuple((float(k), "free" if h is None else f"{h:g}") for k, h in enumerate(horizons))
    x = Axis("horizon [s]", -0.6, len(horizons) - 0.4, ticks=ticks, grid=False)
    panels = []
    for channel in channels:
        own = {error.horizon: error for error in closure.errors if error.channel == channel}
        at = np.array([float(k) for k, horizon in enumerate(horizons) if horizon in own])
        found = [own[horizons[int(k)]] for k in at]
        y = Axis("RMSE" if channel == channels[0] else "", low=0.0)
        panels.append(Panel(tuple(_marks(at, found, applied)), x, y, label(channel, found[0].unit)))
    return row_of(panels, 82.0)


def _marks(at: np.ndarray, found: list[Errors], applied: bool) -> list[Mark]:
    shift = WIDE / 2 if applied else 0.0
    marks: list[Mark] = [_bars(at - shift, [own.before for own in found], BEFORE.colour, BEFORE.words)]
    if applied:
        marks.append(_bars(at + shift, [own.after for own in found], AFTER.colour, AFTER.words))
    across = np.concatenate([[k - 1.25 * WIDE, k + 1.25 * WIDE, np.nan] for k in at])
    floors = np.concatenate([[own.floor, own.floor, np.nan] for own in found])
    marks.append(Curve(across, floors, replace(FLOOR)))
    return marks


def _bars(at: np.ndarray, heights: list[float], colour: str, words: str) -> Bars:
    return Bars(at - WIDE / 2, at + WIDE / 2, np.array(heights), colour, words, edged=True)
