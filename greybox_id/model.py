"""A model: equations over named symbols. It holds no data and no solver.

The models of this file are discrete maps with memory: the outputs at the next sample follow from windows
of past inputs. A window enters the equations only through `past(signal, weights)`, the inner
product of the signal's last samples with weights, oldest first:

    def equations(u, p, past):
        return {"yaw_rate": past(u.v_x * u.steer, p.F)}

An input that is one of the model's own outputs (or follows from them) closes the loop: `feedback` says
how. Open loop, such an input is taken from the recording; closed loop, from the model's predictions.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from types import MappingProxyType, SimpleNamespace
from typing import Any, Protocol

from .errors import BadModel
from .parameter import Array, Parameter, pack, unpack

Symbol = Any
"""A CasADi SX expression; CasADi ships no type information."""

Namespace = SimpleNamespace
"""Symbols by name: u.v_x, p.m."""


class Past(Protocol):
    """Inner product of a signal's last len(weights) samples with weights, oldest sample first."""

    def __call__(self, signal: Symbol, weights: Sequence[Symbol]) -> Symbol:
        """The inner product."""


@dataclass(frozen=True)
class Actuator:
    """A dynamic element between a recorded command and what the equations see of it.

    Attributes
    ----------
    signal : the input it stands before.
    step : (state, command, p, sample_time) -> (next state, what the equations see at this sample);
        the state is one number.
    """

    signal: str
    step: Callable[[Symbol, Symbol, Namespace, float], tuple[Symbol, Symbol]]


@dataclass(frozen=True)
class Sensor:
    """A dynamic element between an output of the equations and what is recorded of it.

    Attributes
    ----------
    signal : the output it stands behind.
    weights : p, sample_time -> weights of the last samples of the output, newest first; they sum to one
        for a sensor that is only late.
    """

    signal: str
    weights: Callable[[Namespace, float], Sequence[Symbol]]


@dataclass(frozen=True)
class Model:
    """Equations over named symbols.

    Attributes
    ----------
    name : the word it is called by on the command line.
    about : one sentence.
    inputs : recorded signals the equations read.
    outputs : recorded signals they predict.
    parameters : in the order of the parameter vector.
    equations : (u, p, past) -> output name -> expression for the output one sample after the newest input.
    feedback : (y, u) -> input name -> expression, for the inputs that come from the outputs in closed loop.
    sample_time : s; the recording must have it.
    defaults : input name -> value taken when a recording lacks it (a flat road).
    symmetric : the vehicle is taken to be the same in a mirror; fitting then sees every recording mirrored too.
    parts : models of some of the outputs that can be fitted alone first; they share parameters by name.
    step_2_holds : parameters that the closed loop does not move once their part is fitted alone.
    actuators, sensors : put there by effects.
    settings : hyperparameters from which the model was built, for the record.
    effects : names of the effects added to it.
    together : sentences on parameters that the equations let appear only in combinations.
    """

    name: str
    about: str
    inputs: tuple[str, ...]
    outputs: tuple[str, ...]
    parameters: tuple[Parameter, ...]
    equations: Callable[[Namespace, Namespace, Past], Mapping[str, Symbol]]
    sample_time: float
    feedback: Callable[[Namespace, Namespace], Mapping[str, Symbol]] | None = None
    defaults: Mapping[str, float] = field(default_factory=lambda: MappingProxyType({}))
    symmetric: bool = False
    parts: tuple[Model, ...] = ()
    step_2_holds: tuple[str, ...] = ()
    actuators: tuple[Actuator, ...] = ()
    sensors: tuple[Sensor, ...] = ()
    settings: Mapping[str, object] = field(default_factory=lambda: MappingProxyType({}))
    effects: tuple[str, ...] = ()
    together: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        names = [parameter.name for parameter in self.parameters]
        twice = sorted({name for name in names if names.count(name) > 1})
        if twice:
            raise BadModel(f"Model {self.name} has two parameters of the name {', '.join(twice)}.")
        if not self.sample_time > 0:
            raise BadModel(f"Model {self.name} needs a sample time above zero; {self.sample_time} s was given.")

    def __getitem__(self, name: str) -> Parameter:
        for parameter in self.parameters:
            if parameter.name == name:
                return parameter
        names = ", ".join(parameter.name for parameter in self.parameters)
        raise BadModel(f"Model {self.name} has no parameter {name!r}; it has {names}.")

    def __add__(self, effect: Callable[[Model], Model]) -> Model:
        """The model with an effect."""
        return effect(self)

    @property
    def size(self) -> int:
        """How many numbers the parameters hold."""
        return sum(parameter.size for parameter in self.parameters)

    @property
    def values(self) -> Array:
        """Nominal values of all parameters as one vector."""
        return pack(self.parameters)

    def with_values(self, vector: Array) -> Model:
        """The same model with other parameter values."""
        return replace(self, parameters=unpack(self.parameters, vector))

    def with_parameters(self, *parameters: Parameter) -> Model:
        """The same model with the named parameters replaced, or appended when it has none of that name."""
        new = {parameter.name: parameter for parameter in parameters}
        kept = tuple(new.pop(parameter.name, parameter) for parameter in self.parameters)
        return replace(self, parameters=kept + tuple(new.values()))

    def with_actuator(self, actuator: Actuator) -> Model:
        """The same model with an actuator before one of its inputs; the first one added is nearest the command."""
        if actuator.signal not in self.inputs:
            raise BadModel(f"Model {self.name} has no input {actuator.signal}; it has {', '.join(self.inputs)}.")
        return replace(self, actuators=(*self.actuators, actuator))

    def with_sensor(self, sensor: Sensor) -> Model:
        """The same model with a sensor behind one of its outputs; one sensor per output."""
        if sensor.signal not in self.outputs:
            raise BadModel(f"Model {self.name} has no output {sensor.signal}; it has {', '.join(self.outputs)}.")
        if any(other.signal == sensor.signal for other in self.sensors):
            raise BadModel(f"Model {self.name} already has a sensor model behind {sensor.signal}.")
        return replace(self, sensors=(*self.sensors, sensor))
