"""Estimates over time, each with its band and, where there is one, what was measured of it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from ...filters import Track
from ...parameter import Array
from ...recording import Recording
from ..figures.style import MEASURED, symbol
from ..numbers import pretty_unit
from ..plot.figure import Figure, Panel
from ..plot.marks import Band, Curve, Mark
from ..plot.palette import BLUE, Line
from ..plot.scale import Axis

SHOWN = ("sideslip", "C_alpha_f", "C_alpha_r", "F_yf", "F_yr")
"""Drawn where a model has them, and what is tracked after them."""
MOST = 7
HEIGHT = 68.0
POINTS = 1000
"""Of a run's band, at most; of more, every so many."""
SHARE = 0.995
"""The axis shows this share of the estimates; a band may open further."""


def over_time(found: Track, recording: Recording, names: Sequence[str] = ()) -> Figure:
    """Estimates with bands of two standard deviations, one panel each."""
    shown = [n for n in names or dict.fromkeys((*SHOWN, *found.tracked)) if n in found.values and not _hidden(n, found)]
    shown = shown[:MOST]
    x = Axis("time [s]", float(np.min(found.time)), float(np.max(found.time)))
    panels = [Panel(tuple(_marks(found, recording, name)), x, _axis(found, name)) for name in shown]
    return Figure(tuple((panel,) for panel in panels), (HEIGHT,) * len(panels), joined=True)


def _hidden(name: str, found: Track) -> bool:
    """Factors whose product with what they scale is shown already."""
    axle = name.removeprefix("stiffness")
    return name.startswith("stiffness") and f"C_alpha{axle}" in found.values


def _marks(found: Track, recording: Recording, name: str) -> list[Mark]:
    marks: list[Mark] = []
    for run in np.unique(found.run):
        own = found.run == run
        first = run == found.run[0]
        time, values, sd = found.time[own], found.values[name][own], found.sds[name][own]
        every = max(1, len(time) // POINTS)
        low, high = (values + side * 2 * sd for side in (-1, 1))
        words = "± 2 sd" if first else ""
        marks.append(Band(time[::every], low[::every], high[::every], words=words))
        marks.append(Curve(time, values, Line(BLUE, width=0.9, words="estimate" if first else "")))
    measured = _measured(recording, name)
    if measured is not None:
        marks.append(Curve(found.time, measured[found.rows.astype(int)], replace(MEASURED, width=0.7)))
    return marks


def _axis(found: Track, name: str) -> Axis:
    """An axis that shows most of the estimates; bands may open further."""
    values, sds = found.values[name], found.sds[name]
    low, high = np.nanquantile(values, [1 - SHARE, SHARE])
    margin = 0.35 * (high - low) + 2 * float(np.nanmedian(sds))
    words = f"{symbol(name)}\n[{pretty_unit(found.units[name])}]"
    return Axis(words, float(low - margin), float(high + margin)) if margin > 0 else Axis(words)


def _measured(recording: Recording, name: str) -> Array | None:
    if name in recording:
        return recording[name]
    if name == "sideslip" and "v_x" in recording and "v_y" in recording:
        return np.asarray(np.arctan2(recording["v_y"], recording["v_x"]))
    return None
