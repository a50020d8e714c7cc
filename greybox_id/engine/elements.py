"""Actuators and sensors of models with memory, between recorded signals and the equations, with derivatives."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from functools import cached_property
from types import SimpleNamespace

import casadi as cs
import numpy as np

from ..base.errors import BadModel
from ..base.shorthands import Array, Index
from ..models.memory_model import MemoryModel
from ..models.model import Namespace, Symbol
from ..models.parameter import placed
from .virtual import SampledFunction


def namespace(model: MemoryModel, vector: Symbol) -> Namespace:
    """The parameters of a model by name, from one vector: p.m an expression, p.F an array of expressions."""
    named = {}
    for parameter, place in placed(model.parameters):
        if parameter.shape == ():
            named[parameter.name] = vector[place.start]
        else:
            entries = np.empty(parameter.size, dtype=object)
            entries[:] = [vector[k] for k in range(place.start, place.stop)]
            named[parameter.name] = entries.reshape(parameter.shape)
    return SimpleNamespace(**named)


class Actuation:
    """All actuators of a model, in order, as one function of a run's recorded inputs.

    An actuator starts each run, and each piece of a joined run, in steady state at the first command.
    """

    def __init__(self, model: MemoryModel, fed_back: Collection[str]) -> None:
        for actuator in model.actuators:
            if actuator.signal in fed_back:
                raise BadModel(
                    f"Model {model.name} feeds {actuator.signal} back from its own outputs; "
                    "an actuator can act only on a recorded command."
                )
        self._steps = [_Step(model, k) for k in range(len(model.actuators))]
        fixed = np.concatenate([np.full(q.size, q.fixed) for q in model.parameters])
        self._moving = not np.all(fixed[self.touched])

    def __call__(self, recorded: Array, p: Array, pieces: Sequence[slice]) -> tuple[Array, Array | None]:
        """Recorded inputs (n, inputs) -> inputs of the equations, and their derivative (n, inputs, parameters).

        The derivative is None if every parameter that acts through an actuator is fixed.
        """
        if not self._steps:
            return recorded, None
        acting = recorded.copy()
        by_p = np.zeros((*recorded.shape, len(p)))
        for step in self._steps:
            for piece in pieces:
                place = (piece, step.column)
                acting[place], by_p[place] = step(acting[place], by_p[place], p)
        return acting, by_p if self._moving else None

    @cached_property
    def touched(self) -> Index:
        """Parameters that act through an actuator."""
        return np.unique(np.concatenate([np.empty(0, dtype=np.intp), *[step.touched for step in self._steps]]))


class _Step:
    """One actuator with its sensitivities, run along a command in CasADi's virtual machine."""

    def __init__(self, model: MemoryModel, number: int) -> None:
        actuator = model.actuators[number]
        self.column = model.inputs.index(actuator.signal)
        state, command, p = cs.SX.sym("state"), cs.SX.sym("command"), cs.SX.sym("p", model.size)
        both = cs.vertcat(*actuator.step(state, command, namespace(model, p), model.sample_time))
        touched = set(np.flatnonzero(cs.which_depends(both, p, 1, False)).tolist())
        for earlier in range(number):
            if model.actuators[earlier].signal == actuator.signal:
                touched |= set(_Step(model, earlier).touched.tolist())
        self.touched: Index = np.array(sorted(touched), dtype=np.intp)
        state_by_p = cs.SX.sym("state_by_p", len(touched))
        command_by_p = cs.SX.sym("command_by_p", len(touched))
        by_p = (
            cs.jacobian(both, state) @ state_by_p.T
            + cs.jacobian(both, command) @ command_by_p.T
            + cs.jacobian(both, p)[:, self.touched.tolist()]
        )
        acting = cs.vertcat(*[p[int(k)] for k in self.touched])  # passing all weights at every sample is slow
        self._step = cs.Function(
            "actuator",
            [cs.vertcat(state, state_by_p), cs.vertcat(command, command_by_p), acting],
            [cs.vertcat(both[0], by_p[0, :].T), cs.vertcat(both[1], by_p[1, :].T)],
        )
        self._along: dict[int, cs.Function] = {}

    def __call__(self, command: Array, command_by_p: Array, p: Array) -> tuple[Array, Array]:
        start = np.concatenate([command[:1], command_by_p[0, self.touched]])
        inputs = np.column_stack([command, command_by_p[:, self.touched]])
        if len(command) not in self._along:
            self._along[len(command)] = self._step.mapaccum("actuators", len(command))
        _, along = self._along[len(command)](start, inputs.T, np.tile(p[self.touched, None], len(command)))
        values = along.full()
        by_p = np.zeros((len(command), len(p)))
        by_p[:, self.touched] = values[1:].T
        return values[0], by_p


class Sensing:
    """All sensors of a model as one function of a run's predictions.

    Before the first prediction a sensor sees a constant: the first prediction.
    """

    def __init__(self, model: MemoryModel) -> None:
        self._sensors = [_Weights(model, k) for k in range(len(model.sensors))]

    @property
    def plain(self) -> bool:
        """Whether there are no sensors: readings are the predictions."""
        return not self._sensors

    def __call__(self, y: Array, by_p: Array | None, p: Array) -> tuple[Array, Array | None]:
        """(rows, outputs) predictions and (rows, outputs, parameters) derivative -> the same of the readings."""
        if not self._sensors:
            return y, by_p
        y, by_p = y.copy(), None if by_p is None else by_p.copy()
        for sensor in self._sensors:
            sensor(y, by_p, p)
        return y, by_p


class _Weights:
    def __init__(self, model: MemoryModel, number: int) -> None:
        sensor = model.sensors[number]
        self.column = model.outputs.index(sensor.signal)
        p = cs.SX.sym("p", model.size)
        weights = cs.densify(cs.vertcat(*sensor.weights(namespace(model, p), model.sample_time)))
        self.touched: Index = np.flatnonzero(cs.which_depends(weights, p, 1, False))
        slopes = cs.densify(cs.jacobian(weights, p)[:, self.touched.tolist()])
        self._weights = SampledFunction(cs.Function("weights", [p], [weights]))
        self._slopes = SampledFunction(cs.Function("slopes", [p], [cs.vec(slopes.T)]))

    def __call__(self, y: Array, by_p: Array | None, p: Array) -> None:
        """Replace this sensor's column of y, and of its derivative, in place."""
        weights = self._weights(p)[0]
        rows = np.maximum(np.arange(len(y))[:, None] - np.arange(len(weights)), 0)
        past = y[:, self.column][rows]
        if by_p is not None:
            by_p[:, self.column] = np.einsum("l,rlp->rp", weights, by_p[:, self.column][rows])
            by_p[:, self.column, self.touched] += past @ self._slopes(p).reshape(len(weights), len(self.touched))
        y[:, self.column] = past @ weights
