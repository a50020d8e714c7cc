"""Models with memory as plain functions of state, input and parameters, in closed loop on their own predictions.

The state x holds, in this order, the recent predictions that sensors may still read, the states of actuators, and the
window: past inputs as the equations use them, as far back as they look. Inputs that follow from the model's own outputs
are fed back and are not part of u. A step is one sample.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from functools import cached_property

import casadi as cs

from ..base.signals import SIGNALS, unit_of
from ..engine.elements import namespace
from ..engine.trace import Trace
from ..models.memory_model import MemoryModel
from ..models.model import Model, Symbol, by_kind
from ..models.parameter import pack
from .equations import Equations, Named, entries, joined
from .subject import Subject


class MemoryEquations:
    """Functions of a model with memory, all of dense column vectors.

    Parameters
    ----------
    model : at the values of the default parameters.
    moving : names of the parameters in p; others are constants of the equations. None: p holds all.

    Attributes
    ----------
    values : the default p.
    chosen : the parameters in p.
    states, inputs, parameters, outputs : meaning of the entries of x, u, p and y.
    sample_time : s, of a step.
    all_of_p : all parameters of the model, those in p as symbols.
    trace : the equations in stages: signals of the windows, the windows' products, outputs.
    held : output -> number of its predictions in x, newest first.
    looked_back : input -> number of its past samples in x, oldest first.
    """

    def __init__(self, model: MemoryModel, moving: Collection[str] | None = None) -> None:
        self.model = model
        self.chosen = tuple(p for p in model.parameters if moving is None or p.name in moving)
        self.values = pack(self.chosen)
        self.parameters = tuple(entry for parameter in self.chosen for entry in entries(parameter))
        self.p = cs.SX.sym("p", len(self.parameters))
        self.all_of_p = joined(model, {p.name for p in self.chosen}, self.p)
        self.sample_time = model.sample_time
        self.trace = trace = Trace(model)
        self._window, self._predicted = trace.step
        self._names = tuple(name for name in model.inputs if name not in trace.fed_back)
        self._p = namespace(model, self.all_of_p)
        self._weights = {sensor.signal: sensor.weights(self._p, model.sample_time) for sensor in model.sensors}
        self.held = {name: len(self.sensor_weights(name)) for name in model.outputs}
        self.looked_back = {name: self._depth(k) for k, name in enumerate(model.inputs)}
        self.states = tuple(self._described())
        self.inputs = tuple(Named(name, unit_of(name), _about(name)) for name in self._names)
        self.outputs = tuple(Named(name, unit_of(name), _about(name)) for name in model.outputs)
        self.x = cs.SX.sym("x", len(self.states))
        self.u = cs.SX.sym("u", len(self.inputs))

    @cached_property
    def step(self) -> cs.Function:
        """(x, u, p) -> x one sample later, using the model's own predictions."""
        now, actuators, past = self._split()
        following = self._followed(now, actuators, past, None)
        return cs.Function("step", [self.x, self.u, self.p], [following], ["x", "u", "p"], ["x_next"])

    @cached_property
    def push(self) -> cs.Function:
        """(x, u, y, p) -> x one sample later, using readings y instead: fills the window before the loop runs."""
        y = cs.SX.sym("y", len(self.outputs))
        following = self._followed(*self._split(), y)
        return cs.Function("push", [self.x, self.u, y, self.p], [following], ["x", "u", "y", "p"], ["x_next"])

    @cached_property
    def output(self) -> cs.Function:
        """(x, u, p) -> y, the present readings of sensors."""
        now, _, _ = self._split()
        read = [
            sum(weight * then for weight, then in zip(self.sensor_weights(name), now[name], strict=True))
            for name in self.model.outputs
        ]
        value = cs.densify(cs.vertcat(*read))
        return cs.Function("output", [self.x, self.u, self.p], [value], ["x", "u", "p"], ["y"])

    @cached_property
    def seen(self) -> cs.Function:
        """(newest predictions, actuators, u, p) -> inputs as used by the equations now, actuators one sample later."""
        y, actuators = cs.SX.sym("y", len(self.outputs)), cs.SX.sym("actuators", len(self.model.actuators))
        seen = dict.fromkeys(self.model.inputs, cs.SX(0)) | dict(zip(self._names, cs.vertsplit(self.u), strict=True))
        moved = []
        for k, actuator in enumerate(self.model.actuators):
            after, seen[actuator.signal] = actuator.step(actuators[k], seen[actuator.signal], self._p, self.sample_time)
            moved.append(after)
        if self.trace.fed_back:
            fed = self.trace.feedback.function(y, cs.vertcat(*seen.values()))
            seen |= dict(zip(self.trace.fed_back, cs.vertsplit(fed), strict=True))
        results = [cs.densify(cs.vertcat(*seen.values())), cs.densify(cs.vertcat(*moved))]
        return cs.Function("seen", [y, actuators, self.u, self.p], results, ["y", "a", "u", "p"], ["seen", "a_next"])

    def sensor_weights(self, name: str) -> Sequence[Symbol]:
        """Weights of an output's last predictions, newest first, in its present reading."""
        return self._weights.get(name, (cs.SX(1),))

    def _depth(self, number: int) -> int:
        """Number of samples before the newest one on which the equations depend, for an input."""
        rows = [k for k in range(self.trace.memory) if cs.depends_on(self._predicted, self._window[number, k])]
        return self.trace.memory - 1 - min(rows, default=self.trace.memory - 1)

    def _described(self) -> list[Named]:
        predicted = [
            Named(_ago(f"predicted_{name}", k), unit_of(name), f"{_about(name)}, predicted for {_when(k)}")
            for name, count in self.held.items()
            for k in range(count)
        ]
        actuators = [
            Named(f"{item.signal}_actuator_{k}", unit_of(item.signal), f"state of the actuator of {item.signal}")
            for k, item in enumerate(self.model.actuators)
        ]
        past = [
            Named(_ago(name, k), unit_of(name), f"{_about(name)}, {_when(k)}")
            for name, count in self.looked_back.items()
            for k in range(count, 0, -1)
        ]
        return predicted + actuators + past

    def _split(self) -> tuple[dict[str, list[Symbol]], list[Symbol], dict[str, list[Symbol]]]:
        """Predictions newest first, actuators' states, past inputs oldest first."""
        parts = iter(cs.vertsplit(self.x))
        now = {name: [next(parts) for _ in range(count)] for name, count in self.held.items()}
        actuators = [next(parts) for _ in self.model.actuators]
        return now, actuators, {name: [next(parts) for _ in range(count)] for name, count in self.looked_back.items()}

    def _followed(
        self, now: dict[str, list[Symbol]], actuators: list[Symbol], past: dict[str, list[Symbol]], y: Symbol | None
    ) -> Symbol:
        """x one sample later; y, if given, replaces the prediction."""
        newest = cs.vertcat(*[now[name][0] for name in self.model.outputs])
        seen, moved = self.seen(newest, cs.vertcat(*actuators), self.u, self.p)
        windows = {name: [*past[name], seen[k]] for k, name in enumerate(self.model.inputs)}
        if y is None:
            y = self._prediction(windows)
        predicted = [then for k, name in enumerate(self.model.outputs) for then in (y[k], *now[name][:-1])]
        kept = [then for name in self.model.inputs for then in windows[name][1:]]
        return cs.cse(cs.densify(cs.vertcat(*predicted, moved, *kept)))

    def _prediction(self, windows: dict[str, list[Symbol]]) -> Symbol:
        memory = self.trace.memory
        rows = [cs.horzcat(cs.SX.zeros(1, memory - len(windows[name])), *windows[name]) for name in self.model.inputs]
        predict = cs.Function("predict", [self._window, self.trace.p], [self._predicted])
        return predict(cs.vertcat(*rows), self.all_of_p)


def equations_of(subject: Subject) -> Equations | MemoryEquations:
    """The functions of a model of either kind.

    Raises
    ------
    BadInput : there are none, as for hybrids whose network has a memory, or predicts increments.
    """
    return exported(subject.model, subject)


@by_kind
def exported(model: Model, subject: Subject) -> Equations | MemoryEquations:
    """The functions of a subject's model: by default those of equivalent equations of motion."""
    return subject.equations


@exported.register(MemoryModel)
def _exported(model: MemoryModel, subject: Subject) -> MemoryEquations:
    return MemoryEquations(model, subject.moving)


def shifts_left_out(subject: Subject) -> list[str]:
    """Sentences on delays and latencies, which the functions of a motion model do not include."""
    equations = equations_of(subject)
    if isinstance(equations, MemoryEquations):  # the windows include them
        return []
    result = ", ".join(f"{name} {1e3 * seconds:.4g} ms" for name, seconds in equations.shifts().items())
    return (
        [f"Not included in the functions: {result}. Pass them the command that acts at the time of the step."]
        if result
        else []
    )


def _about(name: str) -> str:
    return SIGNALS[name].about if name in SIGNALS else name


def _ago(name: str, samples: int) -> str:
    return f"{name}_{samples}_ago" if samples else name


def _when(samples: int) -> str:
    return "now" if samples == 0 else f"{samples} sample{'s' * (samples > 1)} ago"
