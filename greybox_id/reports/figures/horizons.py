"""Errors over the horizon of prediction, beside those of persistence."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes

from ...scores.metrics import FREE_RUN
from ...signals import unit_of
from .sheet import Sheet, sheet_of
from .style import BLUE, DASHED, NOISE, ORANGE, ZERO, Look, label, look, symbol

ONE_ROW, COLUMNS = 4, 3
"""So many panels stand in one row; of more, so many do."""

LINES = {
    "train": look(BLUE, 0.9, "model, training", dashes=DASHED, dots=1.6),
    "validate": look(BLUE, 1.5, "model, validation", dots=1.6),
}
"""By role."""
HELD = {
    "train": look(ORANGE, 0.9, "persistence, training", dashes=DASHED, dots=1.6),
    "validate": look(ORANGE, 1.5, "persistence, validation", dots=1.6),
}

Scores = Mapping[str, Mapping[str, Mapping[str, Any]]]
"""Role -> protocol -> output -> {rmse, rmse_sd}."""


def horizons(outputs: Sequence[str], own: Scores, held: Scores, noise: Mapping[str, float]) -> Sheet:
    """A panel for each output: RMSE with its standard error over the horizon, and in free run.

    Parameters
    ----------
    outputs : in order.
    own, held : errors of the model and of persistence.
    noise : output -> standard deviation of the residuals of the fit.
    """
    protocols = list(dict.fromkeys(protocol for of_role in own.values() for protocol in of_role))
    sheet, axes = sheet_of(len(outputs), len(outputs) if len(outputs) <= ONE_ROW else COLUMNS, 108.0)
    for ax, name in zip(axes, outputs, strict=True):
        if name in noise:
            ax.axhline(noise[name], **NOISE | {"label": "residuals of the fit, sd"})
        if FREE_RUN in protocols[1:]:
            ax.axvline(protocols.index(FREE_RUN) - 0.5, **ZERO)
        for lines, scores in ((HELD, held), (LINES, own)):
            for role, of_role in scores.items():
                _draw(ax, of_role, protocols, name, lines[role])
        ax.set(xlabel="horizon [s]", xlim=(-0.35, len(protocols) - 0.65), ylabel=label("RMSE", unit_of(name)),
               yscale="log", title=symbol(name))  # fmt: skip
        ax.set_xticks(range(len(protocols)), [_tick(protocol) for protocol in protocols])
    return sheet


def _draw(ax: Axes, scores: Mapping[str, Mapping[str, Any]], protocols: Sequence[str], name: str, line: Look) -> None:
    """One curve over the horizons, the free run apart from it."""
    at = np.array([k for k, protocol in enumerate(protocols) if name in scores.get(protocol, {})], dtype=float)
    errors = [scores[protocols[int(k)]][name] for k in at]
    rmse = np.array([error["rmse"] for error in errors])
    sd = np.array([error["rmse_sd"] if math.isfinite(error["rmse_sd"]) else 0.0 for error in errors])
    free = np.array([protocols[int(k)] == FREE_RUN for k in at], dtype=bool)
    ax.plot(at[~free], rmse[~free], **line)
    ax.plot(at[free], rmse[free], **line | {"linestyle": "", "label": None})
    ax.vlines(at, rmse - sd, rmse + sd, color=line["color"], linewidth=0.7)


def _tick(protocol: str) -> str:
    return "free" if protocol == FREE_RUN else protocol.removesuffix(" s ahead")
