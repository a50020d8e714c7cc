"""Weights of every parameter that is a finite impulse response."""

from __future__ import annotations

from itertools import product

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from ...engine.trace import Trace
from ...fit import Fit
from ...memory_model import MemoryModel
from ...parameter import Parameter
from ...signals import SIGNALS
from ..numbers import number, quantity
from .style import BLUE, INK, canvas, label, look, symbol

COLUMNS = 4
MOST_PANELS = 6
"""A parameter of more responses than this (a network's first layer) has them all in one panel, without bands."""


def responses(model: MemoryModel) -> tuple[Parameter, ...]:
    """The parameters whose entries along the last axis are the weights of windows, oldest sample first."""
    trace = Trace(model)
    by_p = trace.weights_by_p
    lag_of = dict(zip(by_p.column.tolist(), (by_p.row % trace.memory).tolist(), strict=True))
    found, start = [], 0
    for parameter in model.parameters:
        entries = range(start, start + parameter.size)
        start += parameter.size
        if len(parameter.shape) == 0 or parameter.shape[-1] < 2:
            continue
        length = parameter.shape[-1]
        lags = [trace.memory - length + k % length for k in range(parameter.size)]
        if [lag_of.get(entry) for entry in entries] == lags:
            found.append(parameter)
    return tuple(found)


def impulse_responses(fit: Fit) -> Figure | None:
    """One panel per response, weights over age with a band of one standard deviation; None if the model has none."""
    model = fit.model
    assert isinstance(model, MemoryModel)
    panels = [
        (parameter, rows)
        for parameter in responses(model)
        for rows in ([[index] for index in _indices(parameter)] if _few(parameter) else [_indices(parameter)])
    ]
    if not panels:
        return None
    height = -(-len(panels) // COLUMNS)
    with look():
        figure = canvas(1.75 * height + 0.1)
        grid = figure.subplots(height, min(COLUMNS, len(panels)), squeeze=False).ravel()
        first: dict[str, Axes] = {}
        for axes, (parameter, rows) in zip(grid, panels, strict=False):
            axes.sharey(first.setdefault(parameter.name, axes))
            _panel(axes, fit, model.sample_time, parameter, rows)
            axes.set_xlabel("age [s]")
            axes.set_ylabel(label(parameter.name, parameter.unit))
        for axes in grid[len(panels) :]:
            axes.remove()
    return figure


def _panel(axes: Axes, fit: Fit, step: float, parameter: Parameter, rows: list[tuple[int, ...]]) -> None:
    """One response with its band, or several as thin lines. The newest sample is one sample time before the output."""
    age = step * np.arange(parameter.shape[-1], 0, -1)
    sd = np.asarray(fit.sd.get(parameter.name, np.zeros(parameter.shape)))
    axes.axhline(0.0, color=INK, linewidth=0.6)
    if len(rows) == 1:
        weights, spread = parameter.array[rows[0]], sd[rows[0]]
        axes.fill_between(age, weights - spread, weights + spread, color="#bcdcee", linewidth=0)
        axes.plot(age, weights, color=BLUE, linewidth=1.1, marker="o", markersize=2.0)
        axes.set_title(_title(parameter, rows[0]), fontsize=8)
    else:
        for index in rows:
            axes.plot(age, parameter.array[index], color=BLUE, linewidth=0.6)
        rms = float(np.sqrt(np.mean(sd**2)))
        axes.set_title(f"all {len(rows)}, typical sd {number(rms, 2)}", fontsize=8)
    axes.set_xlim(age[0] + step, 0.0)


def _title(parameter: Parameter, index: tuple[int, ...]) -> str:
    """Where the local model stands that a response belongs to, else its number."""
    if index and len(parameter.axes) == len(index):
        return "\n".join(
            f"{symbol(name)} = {quantity(centres[k], SIGNALS[name].unit)}"
            for (name, centres), k in zip(parameter.axes, index, strict=True)
        )
    return f"{symbol(parameter.name)}[{', '.join(str(k + 1) for k in index)}]" if index else ""


def _indices(parameter: Parameter) -> list[tuple[int, ...]]:
    return list(product(*(range(n) for n in parameter.shape[:-1])))


def _few(parameter: Parameter) -> bool:
    return parameter.size // parameter.shape[-1] <= MOST_PANELS
