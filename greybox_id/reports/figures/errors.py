"""Box plot of the errors: every output, every run of every recording, every protocol."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes

from ...fit import Fit
from ...parameter import Array
from ..recordings import Seen, run_rows
from .sheet import Sheet
from .style import DOTTED, INK, PALE, PROTOCOL_LINES, ZERO, label, look

MOST_RUNS = 6
"""A recording of more runs is shown as a whole only."""
QUANTILES = (0.025, 0.25, 0.5, 0.75, 0.975)
"""Ends of whiskers and boxes, and the bar between."""
WIDE, APART = 0.19, 0.24
"""Of a box, and between boxes of one group."""

_ROLES = {"train": "training", "validate": "validation"}


def errors(fit: Fit, recordings: Sequence[Seen]) -> Sheet:
    """Prediction minus measurement; boxes hold half of the samples, whiskers 95 % of them."""
    groups = _groups(recordings)
    sheet = Sheet((84.0,) * len(fit.model.outputs), joined=True)
    for k, (ax, name) in enumerate(zip(sheet.grid[:, 0], fit.model.outputs, strict=True)):
        _draw(ax, recordings, groups, k)
        ax.set_ylabel(f"error of {label(name, recordings[0].recording.unit(name))}")
    ax.set(xlabel="recording and run [number]", xlim=(-0.6, len(groups) - 0.4))
    ax.set_xticks(range(len(groups)), [words for words, _, _ in groups])
    return sheet


Groups = Sequence[tuple[str, Seen, int | None]]


def _draw(ax: Axes, recordings: Sequence[Seen], groups: Groups, output: int) -> None:
    ax.axhline(0.0, **ZERO)
    ax.grid(visible=False, axis="x")
    for n in range(1, len(groups)):
        if groups[n][1] is not groups[n - 1][1]:
            ax.axvline(n - 0.5, **look(PALE, 0.6, dashes=DOTTED))
    for protocol in (p for p in PROTOCOL_LINES if p in recordings[0].predicted):
        at, boxes = [], []
        for n, (_, one, run) in enumerate(groups):
            shown = [p for p in PROTOCOL_LINES if p in one.predicted and (run is None or p != "published")]
            if protocol in shown:
                at.append(n + (shown.index(protocol) - (len(shown) - 1) / 2) * APART)
                ends = np.nanquantile(_residuals(one, protocol, run, output), QUANTILES)
                boxes.append(dict(zip(("whislo", "q1", "med", "q3", "whishi"), ends, strict=True)))
        colour, words = (PROTOCOL_LINES[protocol][name] for name in ("color", "label"))
        line = {"color": colour, "linewidth": 0.9}
        ax.bxp(boxes, at, widths=WIDE, showfliers=False, patch_artist=True, manage_ticks=False, whiskerprops=line,
               capprops=line, medianprops={"color": INK, "linewidth": 1.2}, label=words,
               boxprops={"facecolor": f"{colour}4d", "edgecolor": colour, "linewidth": 0.9})  # fmt: skip


def _groups(recordings: Sequence[Seen]) -> Groups:
    """Words under the boxes, recording, and number of the run or None for the whole recording."""
    groups: list[tuple[str, Seen, int | None]] = []
    for one in recordings:
        groups.append((f"{_ROLES.get(one.role, one.role)},\nall runs", one, None))
        numbers = [number for number, _ in run_rows(one, "honest")]
        if 1 < len(numbers) <= MOST_RUNS:
            groups += [(f"run {number}", one, number) for number in numbers]
    return groups


def _residuals(one: Seen, protocol: str, run: int | None, output: int) -> Array:
    parts = dict(run_rows(one, protocol))
    part = one.predicted[protocol] if run is None else parts[run]
    residuals: Array = part.predicted[:, output] - part.measured[:, output]
    return residuals
