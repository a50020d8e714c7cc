"""Weights of every parameter that is a finite impulse response."""

from __future__ import annotations

from itertools import product

import numpy as np
from matplotlib.axes import Axes

from ...engine.trace import Trace
from ...fit import Fit
from ...memory_model import MemoryModel
from ...parameter import Parameter
from ...signals import SIGNALS
from ..numbers import number, quantity
from .sheet import Sheet, band, sheet_of
from .style import BLUE, ZERO, label, look, symbol

COLUMNS = 3
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


def impulse_responses(fit: Fit) -> Sheet | None:
    """One panel per response, weights over age with a band of one standard deviation; None if the model has none."""
    model = fit.model
    assert isinstance(model, MemoryModel)
    shown = [
        (parameter, rows)
        for parameter in responses(model)
        for rows in ([[index] for index in _indices(parameter)] if _few(parameter) else [_indices(parameter)])
    ]
    if not shown:
        return None
    sheet, axes = sheet_of(len(shown), COLUMNS, 76.0)
    for ax, (parameter, rows) in zip(axes, shown, strict=True):
        _draw(ax, fit, model.sample_time, parameter, rows)
    return sheet


def _draw(ax: Axes, fit: Fit, step: float, parameter: Parameter, rows: list[tuple[int, ...]]) -> None:
    """One response with its band, or several as thin lines. The newest sample is one sample time before the output."""
    age = step * np.arange(float(parameter.shape[-1]), 0.0, -1.0)
    sd = np.asarray(fit.sd.get(parameter.name, np.zeros(parameter.shape)))
    shown = parameter.array
    low, high = float(np.min(shown - sd)), float(np.max(shown + sd))
    room = 0.05 * max(high - low, 1e-12)
    ax.axhline(0.0, **ZERO)
    if len(rows) == 1:
        weights, spread = shown[rows[0]], sd[rows[0]]
        band(ax, age, weights - spread, weights + spread)
        ax.plot(age, weights, **look(BLUE, dots=1.1))
        title = _title(parameter, rows[0])
    else:
        for index in rows:
            ax.plot(age, shown[index], **look(BLUE, 0.6))
        title = f"all {len(rows)}, typical sd {number(float(np.sqrt(np.mean(sd**2))), 2)}"
    ax.set(xlabel="age [s]", xlim=(age[0] + step, 0.0), ylabel=label(parameter.name, parameter.unit),
           ylim=(low - room, high + room), title=title)  # fmt: skip


def _title(parameter: Parameter, index: tuple[int, ...]) -> str:
    """Where the local model stands that a response belongs to, else its number."""
    if index and len(parameter.axes) == len(index):
        return ", ".join(
            f"{symbol(name)} = {quantity(centres[k], SIGNALS[name].unit)}"
            for (name, centres), k in zip(parameter.axes, index, strict=True)
        )
    return f"{symbol(parameter.name)}[{', '.join(str(k + 1) for k in index)}]" if index else ""


def _indices(parameter: Parameter) -> list[tuple[int, ...]]:
    return list(product(*(range(n) for n in parameter.shape[:-1])))


def _few(parameter: Parameter) -> bool:
    return parameter.size // parameter.shape[-1] <= MOST_PANELS
