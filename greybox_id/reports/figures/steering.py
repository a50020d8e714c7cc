"""Steering characteristic: the path's curvature over the steering angle at several speeds, as the model has it."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.figure import Figure

from ...engine.trace import Trace
from ...fit import Fit
from ...memory_model import MemoryModel
from ...model import Model
from ...parameter import Array
from ..recordings import Seen
from .style import DENSITY, LEVELS, canvas, label, look

MOVING = 0.25
"""Curvature is measured where the vehicle is faster than this share of its top speed: yaw_rate/v_x is noise below."""
QUANTILES = (0.1, 0.95)
"""Of the speeds driven, between which the characteristic is drawn at three."""
NEAR = 0.15
"""A recorded sample counts as of a speed when it is within this share of it."""
SEEN = (0.005, 0.995)
"""Quantiles of the angles driven at a speed; the characteristic is drawn thin beyond them."""
ROUNDS = 30
"""Rounds in which inputs that follow from the outputs settle."""


def has_steering(model: Model) -> bool:
    """Whether a model has a steering characteristic: a yaw rate from speed and steering angle."""
    return "yaw_rate" in model.outputs and {"v_x", "steer"} <= set(model.inputs)


def steering(fit: Fit, recordings: Sequence[Seen]) -> Figure | None:
    """The model's quasi steady state over the density of what was measured; None for a model that has none."""
    model = fit.model
    if not isinstance(model, MemoryModel) or not has_steering(model):
        return None
    v_x, steer, yaw_rate = (
        np.concatenate([one.recording[name] for one in recordings]) for name in ("v_x", "steer", "yaw_rate")
    )
    whole = np.isfinite(v_x) & np.isfinite(steer) & np.isfinite(yaw_rate)
    top = float(np.quantile(v_x[whole], 0.99))
    moving = whole & (v_x > MOVING * top)
    v_x, steer, yaw_rate = v_x[moving], steer[moving], yaw_rate[moving]
    trace = Trace(model)
    with look():
        figure = canvas(3.0)
        axes = figure.subplots()
        if len(v_x):
            rho = yaw_rate / v_x
            cells = axes.hexbin(
                steer, rho, gridsize=(60, 34), bins="log", mincnt=1, cmap=DENSITY, linewidths=0.1,
                extent=(float(steer.min()), float(steer.max()), *np.quantile(rho, [0.002, 0.998])),
            )  # fmt: skip
            bar = figure.colorbar(cells, ax=axes, pad=0.02)
            bar.set_label("measured samples per cell [1]")
            bar.outline.set_visible(False)
            speeds = sorted(
                {
                    round(float(speed), 1)
                    for speed in np.linspace(np.quantile(v_x, QUANTILES[0]), np.quantile(v_x, QUANTILES[1]), 3)
                }
            )
            angles = np.linspace(float(steer.min()), float(steer.max()), 161)
        else:
            speeds, angles = [1.0], np.linspace(-0.3, 0.3, 161)
        for speed, (colour, style) in zip(speeds, LEVELS[-len(speeds) :], strict=True):
            rho = steady_yaw_rate(trace, angles, speed) / speed
            near = steer[np.abs(v_x - speed) < NEAR * speed]
            low, high = np.quantile(near, SEEN) if len(near) else (0.0, 0.0)
            inside = (angles >= low) & (angles <= high)
            words = f"model at {speed:g} m/s"
            axes.plot(angles, rho, color=colour, linewidth=0.6)
            axes.plot(angles[inside], rho[inside], color=colour, linestyle=style, linewidth=1.9, label=words)
        axes.set_xlabel(label("steer", "rad"))
        axes.set_ylabel("curvature ρ = yaw rate / $v_x$ [1/m]")
        axes.legend(loc="upper left")
    return figure


def steady_yaw_rate(trace: Trace, steer: Array, v_x: float) -> Array:
    """Yaw rate at constant inputs, held over the whole window, without longitudinal acceleration.

    Parameters
    ----------
    trace : the model's equations.
    steer : (n,) steering angles, rad.
    v_x : speed, m/s.

    Returns
    -------
    (n,) rad/s. Inputs besides v_x, steer and a_x = 0 follow from the outputs where the model says how; the others
    are at the model's default, else zero.
    """
    model, p = trace.model, trace.model.values
    u = np.zeros((len(steer), len(model.inputs)))
    for k, name in enumerate(model.inputs):
        u[:, k] = steer if name == "steer" else v_x if name == "v_x" else model.defaults.get(name, 0.0)
    gains = trace.weights(p).reshape(len(trace.tap_signal), trace.memory).sum(axis=1)
    following = [(k, model.inputs.index(name)) for k, name in enumerate(trace.fed_back) if name != "a_x"]
    for _ in range(ROUNDS if following else 1):
        y = trace.head(trace.stage(u, p)[:, trace.tap_signal] * gains, u, p)
        if following:
            held = trace.feedback(y, u)
            for place, column in following:
                u[:, column] = held[:, place]
    rates: Array = y[:, model.outputs.index("yaw_rate")]
    return rates
