"""Box plot of the errors: every output, every run of every recording, every protocol."""

from __future__ import annotations

from collections.abc import Sequence

from ...fit import Fit
from ...parameter import Array
from ..plot.areas import Boxes
from ..plot.figure import Figure, Panel
from ..plot.marks import Mark, Rule
from ..plot.palette import DOTTED, PALE, Line
from ..plot.scale import Axis
from ..recordings import Seen, run_rows
from .style import PROTOCOL_LINES, label

MOST_RUNS = 6
"""A recording of more runs is shown as a whole only."""
WIDE, APART = 0.19, 0.24
"""Of a box, and between boxes of one group."""

_ROLES = {"train": "training", "validate": "validation"}


def errors(fit: Fit, recordings: Sequence[Seen]) -> Figure:
    """Prediction minus measurement; boxes hold half of the samples, whiskers 95 % of them."""
    groups = _groups(recordings)
    names = tuple((float(k), words) for k, (words, _, _) in enumerate(groups))
    x = Axis("recording and run [number]", -0.6, len(groups) - 0.4, ticks=names, grid=False)
    return Figure(
        tuple(
            (
                Panel(
                    tuple(_marks(recordings, groups, k)),
                    x,
                    Axis(f"error of {label(name, recordings[0].recording.unit(name))}"),
                ),
            )
            for k, name in enumerate(fit.model.outputs)
        ),
        (84.0,) * len(fit.model.outputs),
        joined=True,
    )


Groups = Sequence[tuple[str, Seen, int | None]]


def _marks(recordings: Sequence[Seen], groups: Groups, output: int) -> list[Mark]:
    marks: list[Mark] = [Rule(0.0)]
    for n in range(1, len(groups)):
        if groups[n][1] is not groups[n - 1][1]:
            marks.append(Rule(n - 0.5, Line(PALE, DOTTED, 0.6), upright=True))
    for protocol in (p for p in PROTOCOL_LINES if p in recordings[0].predicted):
        at, values = [], []
        for n, (_, one, run) in enumerate(groups):
            shown = [p for p in PROTOCOL_LINES if p in one.predicted and (run is None or p != "published")]
            if protocol in shown:
                at.append(n + (shown.index(protocol) - (len(shown) - 1) / 2) * APART)
                values.append(_residuals(one, protocol, run, output))
        line = PROTOCOL_LINES[protocol]
        marks.append(Boxes(at, values, WIDE, line.colour, line.words))
    return marks


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
