"""Steering characteristic: the path's curvature over the steering angle at several speeds, as the model has it."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ...engine.trace import Trace
from ...fit import Fit
from ...memory_model import MemoryModel
from ...model import Model
from ...parameter import Array
from ..recordings import Seen
from .density import density, scale_of_counts
from .sheet import Sheet
from .style import LEVELS, label

MOVING = 0.25
"""Curvature is measured where the vehicle is faster than this share of its top speed: yaw_rate/v_x is noise below."""
QUANTILES = (0.1, 0.95)
"""Of the speeds driven, between which the characteristic is drawn at three."""
NEAR = 0.15
"""A recorded sample counts as of a speed when it is within this share of it."""
SEEN = (0.005, 0.995)
"""Quantiles of the angles driven at a speed; the characteristic is drawn thin beyond them."""
POINTS = 161
ROUNDS = 30
"""Rounds in which inputs that follow from the outputs settle."""


def has_steering(model: Model) -> bool:
    """Whether a model has a steering characteristic: a yaw rate from speed and steering angle."""
    return "yaw_rate" in model.outputs and {"v_x", "steer"} <= set(model.inputs)


def steering(fit: Fit, recordings: Sequence[Seen]) -> Sheet | None:
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
    sheet = Sheet((150.0,))
    ax = sheet.first()
    speeds, angles = [1.0], np.linspace(-0.3, 0.3, POINTS)
    if len(v_x):
        rho = yaw_rate / v_x
        low, high = np.quantile(rho, [0.002, 0.998])
        ends = (float(steer.min()), float(steer.max())), (float(low), float(high))
        scale_of_counts(ax, density(ax, steer, rho, *ends))
        slow, fast = (float(own) for own in np.quantile(v_x, QUANTILES))
        speeds = sorted({round(float(speed), 1) for speed in np.linspace(slow, fast, 3)})
        angles = np.linspace(float(steer.min()), float(steer.max()), POINTS)
    for speed, line in zip(speeds, LEVELS[-len(speeds) :], strict=True):
        rho = steady_yaw_rate(trace, angles, speed) / speed
        near = steer[np.abs(v_x - speed) < NEAR * speed]
        first, last = np.quantile(near, SEEN) if len(near) else (0.0, 0.0)
        inside = (angles >= first) & (angles <= last)
        ax.plot(angles, rho, **line | {"linewidth": 0.6, "linestyle": "-"})
        thick = line | {"linewidth": 1.9, "label": f"model at {speed:g} m/s"}
        ax.plot(angles, np.where(inside, rho, np.nan), **thick)
    ax.set(xlabel=label("steer", "rad"), ylabel="curvature = yaw rate / v_x [1/m]")
    return sheet


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
