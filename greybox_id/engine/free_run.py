"""A model running on its own predictions: the closed loop, simulated in CasADi's virtual machine."""

from __future__ import annotations

from functools import lru_cache

import casadi as cs
import numpy as np

from ..base.shorthands import Array
from .sampled import call
from .trace import Trace


def free_run(trace: Trace, u: Array, measured: Array, p: Array) -> Array:
    """Predictions from row `memory` on, fed back into the windows.

    Parameters
    ----------
    u : (n, inputs) what the equations see; the fed-back inputs hold their measured values before row `memory`
        and are ignored from there on.
    measured : (n, outputs) recorded outputs, of which row memory - 1 starts the loop.
    p : (parameters,).

    Returns
    -------
    (n - memory, outputs) predictions.
    """
    first = trace.memory
    past = trace.stage(u[: first - 1], p) if first > 1 else np.empty((0, trace.stage.outputs))
    state = np.concatenate([past.ravel(), measured[first - 1]])
    samples = len(u) - first
    states = call(
        _accumulated(trace, samples), state, np.nan_to_num(u[first - 1 : -1]), np.tile(p, (samples, 1))
    ).reshape(samples, len(state))
    return states[:, -measured.shape[1] :].copy()


@lru_cache(maxsize=64)
def _accumulated(trace: Trace, steps: int) -> cs.Function:
    """`steps` steps of the loop; the state is the windows' past stage signals, oldest first, and the last outputs."""
    signals, outputs = trace.stage.outputs, len(trace.model.outputs)
    past = cs.SX.sym("past", signals, trace.memory - 1)
    y = cs.SX.sym("y", outputs)
    u = cs.SX.sym("u", len(trace.model.inputs))
    p = cs.SX.sym("p", trace.model.size)
    seen = cs.SX(u)
    for position, name in enumerate(trace.fed_back):
        seen[trace.model.inputs.index(name)] = trace.feedback.function(y, u)[position]
    z = cs.horzcat(past, trace.stage.function(seen, p))
    weights = cs.reshape(trace.weights.function(p), trace.memory, len(trace.tap_signal)).T
    h = cs.vertcat(*[cs.dot(weights[t, :], z[int(s), :]) for t, s in enumerate(trace.tap_signal)])
    following = cs.vertcat(cs.vec(z[:, 1:]), trace.head.function(h, seen, p))
    step = cs.Function("step", [cs.vertcat(cs.vec(past), y), u, p], [following])
    return step.mapaccum("free_run", steps)
