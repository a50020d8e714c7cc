"""Estimates over time, each with its band and, where there is one, what was measured of it."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from ...filters import Track
from ...parameter import Array
from ...recording import Recording
from ..figures.style import BLUE, MEASURED, canvas, legend_above, look, words
from ..numbers import pretty_unit

SHOWN = ("sideslip", "C_alpha_f", "C_alpha_r", "F_yf", "F_yr")
"""Drawn where a model has them, and what is tracked after them."""
MOST = 7
HEIGHT = 1.25
POINTS = 4000
"""Drawn at most; of more, every so many."""
SHARE = 0.995
"""The axis shows this share of the estimates; a band may open further."""


def over_time(found: Track, recording: Recording, names: Sequence[str] = ()) -> Figure:
    """Estimates with bands of two standard deviations, one panel each."""
    shown = [n for n in names or dict.fromkeys((*SHOWN, *found.tracked)) if n in found.values and not _hidden(n, found)]
    shown = shown[:MOST]
    rows = found.rows.astype(int)
    every = max(1, len(rows) // POINTS)
    with look():
        figure = canvas(HEIGHT * len(shown) + 0.6)
        panels = figure.subplots(len(shown), 1, sharex=True, squeeze=False)[:, 0]
        for axes, name in zip(panels, shown, strict=True):
            _band(axes, found, name, every)
            measured = _measured(recording, name)
            if measured is not None:
                line = MEASURED.shape() | {"linewidth": 0.7}
                axes.plot(found.time[::every], measured[rows][::every], label=MEASURED.words, zorder=1.5, **line)
            axes.set_ylabel(f"{words(name)} [{pretty_unit(found.units[name])}]")
            axes.margins(x=0)
        figure.align_ylabels()
        panels[-1].set_xlabel("time [s]")
        legend_above(figure, panels[0])
    return figure


def _hidden(name: str, found: Track) -> bool:
    """Factors whose product with what they scale is shown already."""
    axle = name.removeprefix("stiffness")
    return name.startswith("stiffness") and f"C_alpha{axle}" in found.values


def _band(axes: Axes, found: Track, name: str, every: int) -> None:
    time, values, sds = (a[::every] for a in (found.time, found.values[name], found.sds[name]))
    for run in np.unique(found.run):
        own = found.run[::every] == run
        first = run == found.run[0]
        low, high = values[own] - 2 * sds[own], values[own] + 2 * sds[own]
        axes.fill_between(
            time[own], low, high, color=BLUE, alpha=0.25, linewidth=0, label="± 2 sd" if first else None, zorder=1
        )
        axes.plot(time[own], values[own], color=BLUE, linewidth=0.9, label="estimate" if first else None, zorder=2)
    low, high = np.nanquantile(values, [1 - SHARE, SHARE])
    margin = 0.35 * (high - low) + 2 * float(np.nanmedian(sds))
    if margin > 0:
        axes.set_ylim(low - margin, high + margin)


def _measured(recording: Recording, name: str) -> Array | None:
    if name in recording:
        return recording[name]
    if name == "sideslip" and "v_x" in recording and "v_y" in recording:
        return np.asarray(np.arctan2(recording["v_y"], recording["v_x"]))
    return None
