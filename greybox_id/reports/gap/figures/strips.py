"""A gap along time and along the path."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from ....gap import Strip
from ....gap.clock import running
from ....parameter import Array
from ...plot.areas import Spots
from ...plot.figure import Figure, Panel, Shades, nothing
from ...plot.marks import Band, Curve, Mark, Rule
from ...plot.palette import PALE, Line
from ...plot.scale import Axis
from .looks import AFTER, BEFORE, EXCESS

LARGEST = 100.0
"""Excess, times the noise, at which colours end at most."""
HEIGHT = 96.0


def strips(strip: Strip, stretch: Mapping[str, float], applied: bool) -> Figure:
    """Mean square errors over the noise's along time, and the path in shades of them.

    Parameters
    ----------
    strip : what is drawn.
    stretch : "from", "to", s: the stretch that holds half of the gap, shaded; empty shades nothing.
    applied : whether there is anything after.
    """
    if len(strip.time) < 2:
        return Figure(((nothing("too short to be drawn along time"),),), (40.0,))
    panels = [_along_time(running(strip.time), strip, stretch, applied)]
    if len(strip.x) == len(strip.time) and bool(np.any(np.isfinite(strip.x))):
        panels.append(_along_path(strip))
    return Figure((tuple(panels),), (HEIGHT,), (1.6, 1.0)[: len(panels)])


def _along_time(time: Array, strip: Strip, stretch: Mapping[str, float], applied: bool) -> Panel:
    values = np.concatenate([strip.before, strip.after if applied else strip.before])
    values = values[np.isfinite(values) & (values > 0)]
    low, high = (float(np.min(values)), float(np.max(values))) if len(values) else (0.5, 2.0)
    low, high = min(low, 0.7) / 1.1, max(high, 3.0) * 1.2
    marks: list[Mark] = []
    if {"from", "to"} <= stretch.keys():
        ends, level = np.array([stretch["from"], stretch["to"]]), np.ones(2)
        marks.append(Band(ends, low * level, high * level, PALE, "holds half of the gap", counts=False))
    marks += [Rule(1.0, Line(PALE, width=0.8)), Curve(time, strip.before, BEFORE)]
    if applied:
        marks.append(Curve(time, strip.after, AFTER))
    x = Axis("time along the recordings [s]", float(time[0]), float(time[-1]))
    return Panel(tuple(marks), x, Axis("mean square error\nover the noise's [1]", low, high, log=True))


def _along_path(strip: Strip) -> Panel:
    top = float(np.clip(np.nanmax(strip.before, initial=1.0), 3.0, LARGEST))
    share = np.log(np.clip(np.nan_to_num(strip.before, nan=1.0), 1.0, top)) / np.log(top)
    ticks = [own for own in (1.0, 2.0, 5.0, 10.0, 20.0, 50.0, 100.0) if own <= top]
    ticks = ticks[:: max(1, round(len(ticks) / 4))]
    return Panel(
        (Spots(strip.x, strip.y, share, EXCESS),), Axis("x [m]"), Axis("y [m]"), equal=True,
        shades=Shades(
            tuple((float(np.log(own) / np.log(top)), f"{own:g}") for own in ticks), "before, over the noise's [1]",
            EXCESS, 0.12, 1.0,
        ),
    )  # fmt: skip
