"""Errors over the horizon of prediction, beside those of holding the last reading."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator

from ...scores.metrics import FREE_RUN
from ...signals import unit_of
from .style import BLUE, INK, NOISE, ORANGE, Line, canvas, label, legend_above, look, symbol

ONE_ROW, COLUMNS = 4, 3
"""So many panels stand in one row; of more, so many do."""

LINES = {
    "train": Line(BLUE, (0, (4, 1.2)), 0.9, "model, training"),  # type: ignore[arg-type]
    "validate": Line(BLUE, "-", 1.5, "model, validation"),
}
"""By role."""
HELD = {
    "train": Line(ORANGE, (0, (4, 1.2)), 0.9, "last reading held, training"),  # type: ignore[arg-type]
    "validate": Line(ORANGE, "-", 1.5, "last reading held, validation"),
}

Scores = Mapping[str, Mapping[str, Mapping[str, Any]]]
"""Role -> protocol -> output -> {rmse, rmse_sd}."""


def horizons(outputs: Sequence[str], own: Scores, held: Scores, noise: Mapping[str, float]) -> Figure:
    """A panel for each output: RMSE with its standard error over the horizon, and in free run.

    Parameters
    ----------
    outputs : in order.
    own, held : errors of the model and of holding the last reading.
    noise : output -> standard deviation of the residuals of the fit.
    """
    protocols = list(dict.fromkeys(protocol for of_role in own.values() for protocol in of_role))
    width = len(outputs) if len(outputs) <= ONE_ROW else COLUMNS
    height = -(-len(outputs) // width)
    with look():
        figure = canvas((2.1 if height == 1 else 1.7 * height) + 0.4)
        panels = figure.subplots(height, width, squeeze=False).ravel()
        for name, axes in zip(outputs, panels, strict=False):
            axes.set_yscale("log")
            for role, of_role in own.items():
                _draw(axes, of_role, protocols, name, LINES[role], marker="o")
            for role, of_role in held.items():
                _draw(axes, of_role, protocols, name, HELD[role], marker="s")
            if name in noise:
                axes.axhline(noise[name], label="residuals of the fit, sd", **NOISE.shape())
            axes.yaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
            axes.yaxis.set_major_formatter("{x:g}")
            axes.yaxis.set_minor_formatter("")
            axes.set_xticks(range(len(protocols)), [_tick(protocol) for protocol in protocols])
            axes.set_xlim(-0.35, len(protocols) - 0.65)
            if FREE_RUN in protocols[1:]:
                axes.axvline(protocols.index(FREE_RUN) - 0.5, color=INK, linewidth=0.5)
            axes.set_title(symbol(name))
            axes.set_xlabel("horizon [s]")
            axes.set_ylabel(label("RMSE", unit_of(name)))
        for axes in panels[len(outputs) :]:
            axes.remove()
        legend_above(figure, panels[0], columns=3)
    return figure


def _draw(
    axes: Axes, scores: Mapping[str, Mapping[str, Any]], protocols: Sequence[str], name: str, line: Line, marker: str
) -> None:
    """One curve over the horizons, the free run apart from it."""
    at = [k for k, protocol in enumerate(protocols) if name in scores.get(protocol, {})]
    errors = [scores[protocols[k]][name] for k in at]
    rmse = [error["rmse"] for error in errors]
    sd = [error["rmse_sd"] if math.isfinite(error["rmse_sd"]) else 0.0 for error in errors]
    ahead = sum(protocols[k] != FREE_RUN for k in at)
    shape = line.shape() | {"marker": marker, "markersize": 3.0, "elinewidth": 0.7, "capsize": 1.5}
    axes.errorbar(at[:ahead], rmse[:ahead], sd[:ahead], label=line.words, **shape)
    axes.errorbar(at[ahead:], rmse[ahead:], sd[ahead:], **(shape | {"linestyle": ""}))


def _tick(protocol: str) -> str:
    return "free" if protocol == FREE_RUN else protocol.removesuffix(" s ahead")
