"""Box plot of the errors: every output, every run of every recording, every protocol."""

from __future__ import annotations

from collections.abc import Sequence

from matplotlib.axes import Axes
from matplotlib.colors import to_rgba
from matplotlib.figure import Figure
from matplotlib.patches import Patch

from ...fit import Fit
from ...parameter import Array
from ...scores.metrics import Protocol
from ..recordings import Seen, run_rows
from .style import INK, PALE, PROTOCOL_LINES, canvas, label, look

MOST_RUNS = 6
"""A recording of more runs is shown as a whole only."""

_ROLES = {"train": "training", "validate": "validation"}


def errors(fit: Fit, recordings: Sequence[Seen]) -> Figure:
    """Prediction minus measurement; boxes hold half of the samples, whiskers 95 % of them."""
    groups = _groups(recordings)
    protocols: list[Protocol] = [p for p in PROTOCOL_LINES if p in recordings[0].predicted]  # type: ignore[misc]
    with look():
        figure = canvas(1.75 * len(fit.model.outputs) + 0.55)
        panels = figure.subplots(len(fit.model.outputs), 1, sharex=True, squeeze=False)[:, 0]
        for k, (name, axes) in enumerate(zip(fit.model.outputs, panels, strict=True)):
            axes.axhline(0.0, color=INK, linewidth=0.6)
            for n, (_, one, run) in enumerate(groups):
                shown = [p for p in protocols if run is None or p != "published"]
                for j, protocol in enumerate(shown):
                    _box(axes, n + (j - (len(shown) - 1) / 2) * 0.24, _residuals(one, protocol, run, k), protocol)
            for n in range(1, len(groups)):
                if groups[n][1] is not groups[n - 1][1]:
                    axes.axvline(n - 0.5, color=PALE, linewidth=0.6, linestyle=":")
            axes.set_ylabel(f"error of {label(name, recordings[0].recording.unit(name))}")
            axes.grid(visible=False, axis="x")
        panels[-1].set_xticks(range(len(groups)), [words for words, _, _ in groups])
        panels[-1].set_xlim(-0.6, len(groups) - 0.4)
        panels[-1].set_xlabel("recording and run [number]")
        handles = [
            Patch(facecolor=_fill(p), edgecolor=PROTOCOL_LINES[p].colour, label=PROTOCOL_LINES[p].words)
            for p in protocols
        ]
        figure.legend(handles=handles, loc="outside upper center", ncols=len(handles))
    return figure


def _groups(recordings: Sequence[Seen]) -> list[tuple[str, Seen, int | None]]:
    """Words under the boxes, recording, and number of the run or None for the whole recording."""
    groups: list[tuple[str, Seen, int | None]] = []
    for one in recordings:
        groups.append((f"{_ROLES.get(one.role, one.role)},\nall runs", one, None))
        numbers = [number for number, _ in run_rows(one, "honest")]
        if 1 < len(numbers) <= MOST_RUNS:
            groups += [(f"run {number}", one, number) for number in numbers]
    return groups


def _residuals(one: Seen, protocol: Protocol, run: int | None, output: int) -> Array:
    parts = dict(run_rows(one, protocol))
    part = one.predicted[protocol] if run is None else parts[run]
    residuals: Array = part.predicted[:, output] - part.measured[:, output]
    return residuals


def _box(axes: Axes, at: float, values: Array, protocol: Protocol) -> None:
    colour = PROTOCOL_LINES[protocol].colour
    edge = {"color": colour, "linewidth": 0.9}
    axes.boxplot(
        values,
        positions=[at],
        widths=0.19,
        whis=(2.5, 97.5),
        showfliers=False,
        patch_artist=True,
        manage_ticks=False,
        boxprops={"facecolor": _fill(protocol), "edgecolor": colour, "linewidth": 0.9},
        medianprops={"color": INK, "linewidth": 1.1},
        whiskerprops=edge,
        capprops=edge,
    )


def _fill(protocol: Protocol) -> tuple[float, float, float, float]:
    """The protocol's colour on white paper; mixed, not transparent, so that every viewer shows the same."""
    red, green, blue, _ = to_rgba(PROTOCOL_LINES[protocol].colour)
    share = 0.3
    return (1 - share * (1 - red), 1 - share * (1 - green), 1 - share * (1 - blue), 1.0)
