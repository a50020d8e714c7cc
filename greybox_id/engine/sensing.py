"""Sensors: what is recorded of an output, with its derivative by the parameters."""

from __future__ import annotations

import casadi as cs
import numpy as np

from ..model import Symbol
from ..parameter import Array
from .sampled import SampledFunction
from .trace import Index, Trace, namespace


class Sensing:
    """All sensors of a model as one function of a run's predictions.

    Before the first prediction a sensor sees the first prediction held.
    """

    def __init__(self, trace: Trace) -> None:
        self._sensors = [_Weights(trace, k) for k in range(len(trace.model.sensors))]

    def __call__(self, y: Array, by_p: Array | None, p: Array) -> tuple[Array, Array | None]:
        """(rows, outputs) predictions and (rows, outputs, parameters) derivative -> the same as recorded."""
        if not self._sensors:
            return y, by_p
        y, by_p = y.copy(), None if by_p is None else by_p.copy()
        for sensor in self._sensors:
            sensor(y, by_p, p)
        return y, by_p

    def expression(self, y: Symbol, p: Symbol) -> Symbol:
        """What is recorded, (outputs, rows), as an expression of a run's predictions and of the parameters."""
        rows = [y[k, :] for k in range(y.shape[0])]
        for sensor in self._sensors:
            rows[sensor.column] = sensor.expression(rows[sensor.column], p)
        return cs.vertcat(*rows)


class _Weights:
    def __init__(self, trace: Trace, number: int) -> None:
        model = trace.model
        sensor = model.sensors[number]
        self.column = model.outputs.index(sensor.signal)
        p = cs.SX.sym("p", model.size)
        weights = cs.densify(cs.vertcat(*sensor.weights(namespace(model, p), model.sample_time)))
        self.touched: Index = np.flatnonzero(cs.which_depends(weights, p, 1, False))
        slopes = cs.densify(cs.jacobian(weights, p)[:, self.touched.tolist()])
        self._weights = SampledFunction(cs.Function("weights", [p], [weights]))
        self._slopes = SampledFunction(cs.Function("slopes", [p], [cs.vec(slopes.T)]))

    def expression(self, y: Symbol, p: Symbol) -> Symbol:
        """This sensor's reading of an output, (1, rows)."""
        weights = self._weights.function(p)
        length = y.shape[1]
        held = [min(lag, length) for lag in range(weights.shape[0])]
        late = [cs.horzcat(cs.repmat(y[0], 1, lag), y[: length - lag]) for lag in held]
        return sum(weights[lag] * shifted for lag, shifted in enumerate(late))

    def __call__(self, y: Array, by_p: Array | None, p: Array) -> None:
        """Replace this sensor's column of y, and of its derivative, in place."""
        weights = self._weights(p)[0]
        rows = np.maximum(np.arange(len(y))[:, None] - np.arange(len(weights)), 0)
        seen = y[:, self.column][rows]
        if by_p is not None:
            by_p[:, self.column] = np.einsum("l,rlp->rp", weights, by_p[:, self.column][rows])
            by_p[:, self.column, self.touched] += seen @ self._slopes(p).reshape(len(weights), len(self.touched))
        y[:, self.column] = seen @ weights
