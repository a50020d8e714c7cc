"""Equations of motion as plain functions of state, input, parameters and step, from which all targets are written.

The state x holds the model's states, then its actuators', then its relaxed quantities; commands are held over a step.
Pure delays of commands and latencies of readings are not part of these functions: users pass the command that acts, and
read the state at the time of the reading (`delays`, `latencies`).
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass
from functools import cached_property

import casadi as cs
import numpy as np

from ..base.signals import SIGNALS, unit_of, unit_of_quantity
from ..engine.motion.trace import MotionTrace
from ..models.model import Model, Symbol
from ..models.motion_model import MotionModel
from ..models.parameter import Parameter, pack


@dataclass(frozen=True)
class Named:
    """An entry of a vector.

    Attributes
    ----------
    name, unit : SI.
    about : its meaning, for people.
    """

    name: str
    unit: str
    about: str = ""


class Equations:
    """Functions of a motion model, all of dense column vectors.

    Parameters
    ----------
    model : at the values of the default parameters.
    moving : names of the parameters in p; others are constants of the equations. None: p holds all.

    Attributes
    ----------
    values : the default p.
    states, inputs, parameters, outputs : meaning of the entries of x, u, p and y.
    delayed, late : inputs with a delay, outputs with a latency, in the order of `delays` and `latencies`.
    """

    def __init__(self, model: MotionModel, moving: Collection[str] | None = None) -> None:
        self.model = model
        chosen = [p for p in model.parameters if moving is None or p.name in moving]
        self.values = pack(chosen)
        self._trace = trace = MotionTrace(model)
        self.states = tuple(_states(model))
        self.inputs = tuple(_input(model, name) for name in model.inputs)
        self.parameters = tuple(entry for parameter in chosen for entry in entries(parameter))
        self.outputs = tuple(Named(name, unit_of(name, unit_of_quantity(name))) for name in model.outputs)
        self.delayed, self.late = trace.delayed, trace.late
        self.x = cs.SX.sym("x", len(self.states))
        self.u = cs.SX.sym("u", len(self.inputs))
        self.p = cs.SX.sym("p", len(self.parameters))
        self._all_of_p = joined(model, {p.name for p in chosen}, self.p)
        self.dt = cs.SX.sym("dt")

    @cached_property
    def step(self) -> cs.Function:
        """(x, u, p, dt) -> x after dt seconds: one step of the classical Runge-Kutta method, actuators exact."""
        return self._function("step", self._trace.step, self.dt)

    @cached_property
    def ode(self) -> cs.Function:
        """(x, u, p) -> derivative of x."""
        return self._function("ode", self._trace.flow())

    @cached_property
    def output(self) -> cs.Function:
        """(x, u, p) -> y, readings of sensors without their latency."""
        return self._function("output", self._trace.output)

    @property
    def settles(self) -> bool:
        """Whether there are actuators or relaxed quantities."""
        return bool(self.model.actuators or self.model.relaxations)

    @cached_property
    def settled(self) -> cs.Function:
        """(x, u, p) -> x with actuators at their commands and relaxed quantities at their steady values."""
        names = tuple(state.name for state in self.model.states)
        value = self._trace.start(names, names)(self.x[: len(names)], self.u, self._all_of_p)
        return cs.Function(
            "settled", [self.x, self.u, self.p], [cs.cse(cs.densify(value))], ["x", "u", "p"], ["x_next"]
        )

    @cached_property
    def delays(self) -> cs.Function:
        """(p) -> delays, s, of the commands in `delayed`."""
        return self._shifts("delays", slice(None, len(self.delayed)))

    @cached_property
    def latencies(self) -> cs.Function:
        """(p) -> latencies, s, of the outputs in `late`."""
        return self._shifts("latencies", slice(len(self.delayed), None))

    def shifts(self) -> dict[str, float]:
        """Non-zero delays of inputs and latencies of outputs at the default parameters, s."""
        names = [f"delay of {name}" for name in self.delayed] + [f"latency of {name}" for name in self.late]
        values = np.array(self._trace.timing(self.model.values)).ravel()
        late = dict(zip(names, values.tolist(), strict=True))
        return {name: seconds for name, seconds in late.items() if seconds}

    def _function(self, name: str, of: cs.Function, dt: Symbol | None = None) -> cs.Function:
        rest = cs.SX.zeros(self._trace.segment_size - 1 - len(self.inputs))
        segment = cs.vertcat(0 if dt is None else dt, self.u, rest)
        value = cs.cse(cs.densify(of(self.x, segment, self._all_of_p)))
        arguments = {"x": self.x, "u": self.u, "p": self.p} | ({} if dt is None else {"dt": dt})
        return cs.Function(name, list(arguments.values()), [value], list(arguments), [_RESULTS[name]])

    def _shifts(self, name: str, which: slice) -> cs.Function:
        return cs.Function(name, [self.p], [cs.densify(self._trace.timing(self._all_of_p))[which]], ["p"], ["s"])


_RESULTS = {"step": "x_next", "ode": "x_dot", "output": "y"}


def joined(model: Model, moving: Collection[str], p: Symbol) -> Symbol:
    """The model's whole parameter vector: adjustable ones from p, the others as constants."""
    parts, start = [], 0
    for parameter in model.parameters:
        if parameter.name in moving:
            parts.append(p[start : start + parameter.size])
            start += parameter.size
        else:
            parts.append(cs.SX(parameter.array.ravel()))
    return cs.vertcat(*parts)


def entries(parameter: Parameter) -> list[Named]:
    """The entries of a parameter in their order in p: F[0,1] of an array F."""
    if parameter.shape == ():
        return [Named(parameter.name, parameter.unit, parameter.about)]
    places = (",".join(map(str, place)) for place in np.ndindex(*parameter.shape))
    return [Named(f"{parameter.name}[{place}]", parameter.unit, parameter.about) for place in places]


def _states(model: MotionModel) -> list[Named]:
    value = [
        Named(state.name, state.unit, SIGNALS[state.name].about if state.name in SIGNALS else "")
        for state in model.states
    ]
    actuators = [
        Named(actuator.name, unit_of(actuator.signal, ""), f"{actuator.signal} as the vehicle sees it")
        for actuator in model.actuators
    ]
    relaxed = [
        Named(relaxation.quantity, unit_of_quantity(relaxation.quantity), "follows its steady value with a lag")
        for relaxation in model.relaxations
    ]
    return value + actuators + relaxed


def _input(model: MotionModel, name: str) -> Named:
    alternatives = [f"{item} [{unit_of(item)}]" for item in model.aliases.get(name, ())]
    about = " or ".join(alternatives) if alternatives else SIGNALS[name].about if name in SIGNALS else ""
    only = model.aliases[name][0] if len(alternatives) == 1 else name
    return Named(name, unit_of(only, "as recorded"), about)
