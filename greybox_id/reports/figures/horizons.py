"""Errors over the horizon of prediction, beside those of holding the last reading."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from ...scores.metrics import FREE_RUN
from ...signals import unit_of
from ..plot.figure import Figure, Panel, grid
from ..plot.marks import Curve, Mark, Rule
from ..plot.palette import BLUE, DASHED, ORANGE, Line
from ..plot.scale import Axis
from .style import NOISE, label, symbol

ONE_ROW, COLUMNS = 4, 3
"""So many panels stand in one row; of more, so many do."""

LINES = {
    "train": Line(BLUE, DASHED, 0.9, "model, training"),
    "validate": Line(BLUE, width=1.5, words="model, validation"),
}
"""By role."""
HELD = {
    "train": Line(ORANGE, DASHED, 0.9, "last reading held, training"),
    "validate": Line(ORANGE, width=1.5, words="last reading held, validation"),
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
    ticks = tuple((float(k), _tick(protocol)) for k, protocol in enumerate(protocols))
    x = Axis("horizon [s]", -0.35, len(protocols) - 0.65, ticks=ticks)
    panels = []
    for name in outputs:
        marks: list[Mark] = (
            [Rule(noise[name], replace(NOISE, words="residuals of the fit, sd"))] if name in noise else []
        )
        if FREE_RUN in protocols[1:]:
            marks.append(Rule(protocols.index(FREE_RUN) - 0.5, upright=True))
        for role, of_role in held.items():
            marks += _curves(of_role, protocols, name, HELD[role])
        for role, of_role in own.items():
            marks += _curves(of_role, protocols, name, LINES[role])
        panels.append(Panel(tuple(marks), x, Axis(label("RMSE", unit_of(name)), log=True), symbol(name)))
    return grid(panels, len(panels) if len(panels) <= ONE_ROW else COLUMNS, 108.0)


def _curves(scores: Mapping[str, Mapping[str, Any]], protocols: Sequence[str], name: str, line: Line) -> list[Mark]:
    """One curve over the horizons, the free run apart from it."""
    at = np.array([k for k, protocol in enumerate(protocols) if name in scores.get(protocol, {})], dtype=float)
    errors = [scores[protocols[int(k)]][name] for k in at]
    rmse = np.array([error["rmse"] for error in errors])
    sd = np.array([error["rmse_sd"] if math.isfinite(error["rmse_sd"]) else 0.0 for error in errors])
    free = np.array([protocols[int(k)] == FREE_RUN for k in at], dtype=bool)
    return [
        Curve(at[rows], rmse[rows], line if joined else replace(line, words=""), 1.6, sd[rows], joined)
        for rows, joined in ((~free, True), (free, False))
        if np.any(rows)
    ]


def _tick(protocol: str) -> str:
    return "free" if protocol == FREE_RUN else protocol.removesuffix(" s ahead")
