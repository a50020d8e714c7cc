"""Figures 3 and 4 of the transfer-learning paper and learning curves, drawn of what the bench measured."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from ..reports.figures.sheet import Sheet, band
from ..reports.figures.style import BLUE, CHAIN, DASHED, DOTTED, MEASURED, ORANGE, PURPLE, RUST, Look, label, look

UNITS = {"v_y": "m/s", "yaw_rate": "rad/s"}
COLOURS = (BLUE, ORANGE, PURPLE, RUST)
DASHES = ("-", DASHED, CHAIN, DOTTED)


def looks(names: Sequence[str]) -> dict[str, Look]:
    """How models are drawn, in their order."""
    return {
        name: look(COLOURS[k % len(COLOURS)], 1.1, name, dashes=DASHES[k % len(DASHES)]) for k, name in enumerate(names)
    }


def over_durations(durations: Sequence[Mapping[str, Any]]) -> Sheet:
    """Fig. 3: RMSE of free runs over how long they have run, by output."""
    sheet = Sheet((120.0,), len(UNITS))
    lines = looks([own["model"] for own in durations])
    for ax, (output, unit) in zip(sheet.grid[0], UNITS.items(), strict=True):
        for own in durations:
            ax.plot(own["seconds"], own[output], **lines[own["model"]] | {"marker": "o", "markersize": 2.4})
        ax.set(xlabel="time since the start [s]", ylabel=f"RMSE of {label(output, unit)}", ylim=(0.0, None))
    return sheet


def slalom(traces: Mapping[str, Any]) -> Sheet:
    """Fig. 4: a slalom, measured and predicted, with 95 % bands: a row of axes for each method."""
    lines = looks([own["model"] for own in traces["lines"]])
    sheet = Sheet((80.0,) * len(lines), len(UNITS), joined=True)
    seconds = np.array(traces["seconds"])
    for row, own in zip(sheet.grid, traces["lines"], strict=True):
        line = lines[own["model"]]
        for ax, (output, unit) in zip(row, UNITS.items(), strict=True):
            mean, reach = np.array(own[output]), np.array(own[f"{output}_reach"])
            band(ax, seconds, mean - reach, mean + reach, line["color"])
            ax.plot(seconds, traces["measured"][output], **MEASURED)
            ax.plot(seconds, mean, **line)
            ax.set_ylabel(label(output, unit))
    for ax in sheet.grid[-1]:
        ax.set_xlabel("time since the start [s]")
    return sheet


def learning_curves(curves: Sequence[Mapping[str, Any]]) -> Sheet:
    """RMSE on val over the share of the training recordings, and what transfer makes of it with 95 % intervals."""
    sheet = Sheet((110.0, 90.0), len(UNITS), joined=True)
    lines = {"learning": look(ORANGE, 1.1, "MLP", dashes=DASHED, dots=1.6),
             "transfer": look(BLUE, 1.1, "MLP, transfer learning", dots=1.6)}  # fmt: skip
    for column, (output, unit) in zip(sheet.grid.T, UNITS.items(), strict=True):
        own = [each for each in curves if each["output"] == output]
        share = 100 * np.array([each["share"] for each in own])
        for method, line in lines.items():
            column[0].plot(share, [each[method] for each in own], **line)
        column[0].set(ylabel=f"RMSE of {label(output, unit)}", ylim=(0.0, None))
        ratio, low, high = (np.array([each[name] for each in own]) for name in ("ratio", "low", "high"))
        column[1].axhline(1.0, color=MEASURED["color"], linewidth=0.6)
        band(column[1], share, low, high)
        column[1].plot(share, ratio, **lines["transfer"])
        column[1].set(xlabel="share of the training recordings [%]", ylabel="with transfer over without")
    return sheet
