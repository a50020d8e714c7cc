"""A traced motion model with what integrates it, shared by problems over different recordings and horizons."""

from __future__ import annotations

from copy import copy
from functools import cached_property

import casadi as cs
import numpy as np

from ...base.shorthands import Array, Index
from ...models.motion_model import MotionModel
from ..kernel import Kernel
from ..sampled import SampledFunction
from .runs import MotionRun
from .schedule import Schedule
from .trace import MotionTrace

AT_A_TIME = 4096
"""Rows whose starts are worked out at a time: with derivatives by 30 parameters, some 10 MB of ten states."""


class Simulator:
    """A traced model and its kernel.

    Parameters
    ----------
    model : the model.
    compiled : whether the kernel is compiled; None decides by the work.
    """

    def __init__(self, model: MotionModel, compiled: bool | None = None) -> None:
        self.trace = MotionTrace(model)
        self.kernel = Kernel(self.trace.step, self.trace.output, compiled=compiled)
        self.actuators = self._actuators() if model.actuators else None
        self._starts: dict[tuple[tuple[str, ...], tuple[str, ...]], SampledFunction] = {}
        self._touched: dict[tuple[str, ...], Index] = {}

    def of(self, model: MotionModel) -> Simulator:
        """The same of a model with the same equations, whose values, bounds and beliefs are others."""
        result = copy(self)
        result.trace = copy(self.trace)
        result.trace.model = model
        return result

    def shifts(self, p: Array) -> Array:
        """Values of the delays and latencies, s."""
        if self.trace.shift_count == 0:
            return np.empty(0)
        return np.asarray(self.trace.timing(p).full()).ravel()

    def start(
        self, measured: tuple[str, ...], readings: Array, inputs: Array, p: Array, given: tuple[str, ...] = ()
    ) -> tuple[Array, Array]:
        """States at starts, (n, nz), and their derivative by the parameters, (n, nz, parameters).

        Parameters
        ----------
        measured : states that have a reading.
        readings : (n, measured).
        inputs : (n, inputs).
        p : (parameters,) or (n, parameters).
        given : those of the measured states whose reading is the state itself, past all sensors.
        """
        key = (measured, given)
        if key not in self._starts:
            y, u, q = (cs.SX.sym(name, size) for name, size in zip("yuq", self._sizes(measured), strict=True))
            z = self.trace.start(measured, given)(y, u, q)
            stacked = cs.vertcat(z, cs.vec(cs.jacobian(z, q).T))
            self._starts[key] = SampledFunction(cs.Function("starts", [y, u, q], [cs.densify(stacked)]))
        result = np.broadcast_to(
            self._starts[key](readings, inputs, p), (len(readings), self.trace.size * (1 + self.trace.model.size))
        )
        return result[:, : self.trace.size], result[:, self.trace.size :].reshape(len(readings), self.trace.size, -1)

    def start_touched(self, measured: tuple[str, ...]) -> Index:
        """Parameters that the starting states depend on."""
        if measured not in self._touched:
            function = self.trace.start(measured)
            pattern = function.jac_sparsity(0, 2) if function.numel_in(2) else cs.Sparsity(function.numel_out(0), 0)
            self._touched[measured] = np.array(sorted(set(pattern.get_col())), dtype=np.intp)
        return self._touched[measured]

    @cached_property
    def actuators_touched(self) -> Index:
        """Parameters that actuators depend on."""
        pattern = self.trace.actuation.jac_sparsity(0, 2)
        return np.array(sorted({*pattern.get_triplet()[1]}), dtype=np.intp)

    def _actuators(self) -> Kernel:
        """A kernel of the actuators alone, which reads their states."""
        a, s, p = (cs.SX.sym(name, self.trace.actuation.numel_in(k)) for k, name in enumerate("asp"))
        return Kernel(self.trace.actuation, cs.Function("standing", [a, s, p], [a]))

    def _sizes(self, measured: tuple[str, ...]) -> tuple[int, int, int]:
        return len(measured), len(self.trace.model.inputs), self.trace.model.size


def observed(simulator: Simulator, run: MotionRun, plan: Schedule, p: Array) -> Array:
    """(n, nz) states at every row, after the model was run along a recording and set back to every reading.

    It is set back where all states that are read at all have a reading, and begins at their first ones.

    Parameters
    ----------
    simulator : the model.
    run : the run.
    plan : its segments.
    p : (parameters,).
    """
    model = simulator.trace.model
    names = run.states_read(model)
    states = [simulator.trace.names.index(name) for name in names]
    readings = run.measured[:, [model.outputs.index(name) for name in names]]
    complete = np.all(np.isfinite(readings), axis=1)
    first = [item[np.isfinite(item)][0] for item in readings.T]
    given = np.where(complete[:, None], readings, first)
    corrected = np.empty((len(run), simulator.trace.size))
    for first_row in range(0, len(run), AT_A_TIME):  # each row's start comes with derivatives, which nobody keeps
        rows = slice(first_row, first_row + AT_A_TIME)
        corrected[rows], _ = simulator.start(names, given[rows], run.inputs[rows], p)
    z = corrected.copy()
    starts = plan.row_segment
    carries = len(states) < z.shape[1]
    stops = np.union1d(np.flatnonzero(complete[1:]) + 1, len(run) - 1)
    simulated, last = simulator.kernel.along(plan.segments, p), 0
    with np.errstate(all="ignore"):
        for row in stops:
            if carries or row > last + 1 or not complete[row]:
                begin = int(starts[last])
                result = simulated(z[last], begin, int(starts[row]))
                z[last + 1 : row + 1] = result[starts[last + 1 : row + 1] - begin]
                if complete[row]:
                    z[row, states] = corrected[row, states]
            last = row
    return z
