"""A discrete map with memory: the outputs at the next sample follow from windows of past inputs.

A window enters the equations only through `past(signal, weights)`, the inner product of the signal's last
samples with weights, oldest first:

    def equations(u, p, past):
        return {"yaw_rate": past(u.v_x * u.steer, p.F)}

If an input is one of the model's outputs (or follows from them), `feedback` defines how the loop is closed. Open loop,
such an input is taken from the recording; closed loop, from the model's predictions.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from types import SimpleNamespace
from typing import ClassVar, Protocol

from ..base.errors import BadModel
from .model import Model, Namespace, Symbol


class Past(Protocol):
    """Inner product of a signal's last len(weights) samples with weights, oldest sample first."""

    def __call__(self, signal: Symbol, weights: Sequence[Symbol]) -> Symbol:
        """The inner product."""


@dataclass(frozen=True)
class SampledActuator:
    """A dynamic element between a recorded command and the equations.

    Attributes
    ----------
    signal : the input it acts on.
    step : (state, command, p, sample_time) -> (next state, its output at this sample); the state is one number.
    """

    signal: str
    step: Callable[[Symbol, Symbol, Namespace, float], tuple[Symbol, Symbol]]


@dataclass(frozen=True)
class SampledSensor:
    """A dynamic element between an output of the equations and its recorded reading.

    Attributes
    ----------
    signal : the output it acts on.
    weights : p, sample_time -> weights of the last samples of the output, newest first; they sum to one for a pure
        latency.
    """

    signal: str
    weights: Callable[[Namespace, float], Sequence[Symbol]]


@dataclass(frozen=True, kw_only=True, repr=False)
class MemoryModel(Model):
    """Equations over windows of past inputs.

    Attributes
    ----------
    equations : (u, p, past) -> output name -> expression for the output one sample after the newest input.
    feedback : (y, u) -> input name -> expression, for inputs computed from the outputs in closed loop.
    sample_time : s; the recording must have it.
    step_2_holds : parameters that the closed-loop fit holds at the values from the fit of their part.
    actuators, sensors : added by effects.
    """

    kind: ClassVar[str] = "memory"
    called: ClassVar[str] = "a model with memory"
    learnt: ClassVar[bool] = True

    equations: Callable[[Namespace, Namespace, Past], Mapping[str, Symbol]]
    sample_time: float
    feedback: Callable[[Namespace, Namespace], Mapping[str, Symbol]] | None = None
    parts: tuple[MemoryModel, ...] = ()
    step_2_holds: tuple[str, ...] = ()
    actuators: tuple[SampledActuator, ...] = ()
    sensors: tuple[SampledSensor, ...] = ()

    def __post_init__(self) -> None:
        super().__post_init__()
        if not self.sample_time > 0:
            raise BadModel(f"Model {self.name} needs a sample time above zero; {self.sample_time} s was given.")

    @property
    def states(self) -> tuple[()]:
        """Empty: its memory is in its windows."""
        return ()

    def with_constants(self, names: Collection[str]) -> MemoryModel:
        """The same model with numbers, the present values, in place of these parameters."""
        numbers = {name: self[name].array.astype(object) for name in names}
        constants = {name: value if value.shape else value.item() for name, value in numbers.items()}

        def completed(p: Namespace) -> Namespace:
            return SimpleNamespace(**vars(p), **constants)

        def driven(actuator: SampledActuator) -> SampledActuator:
            return replace(actuator, step=lambda state, command, p, dt: actuator.step(state, command, completed(p), dt))

        def read(sensor: SampledSensor) -> SampledSensor:
            return replace(sensor, weights=lambda p, dt: sensor.weights(completed(p), dt))

        return replace(
            self,
            parameters=tuple(p for p in self.parameters if p.name not in constants),
            equations=lambda u, p, past: self.equations(u, completed(p), past),
            actuators=tuple(driven(actuator) for actuator in self.actuators),
            sensors=tuple(read(sensor) for sensor in self.sensors),
            parts=(),
            step_2_holds=(),
        )

    def with_actuator(self, actuator: SampledActuator) -> MemoryModel:
        """The same model with an actuator on one of its inputs; the first one added is nearest the command."""
        if actuator.signal not in self.inputs:
            raise BadModel(f"Model {self.name} has no input {actuator.signal}; it has {', '.join(self.inputs)}.")
        return replace(self, actuators=(*self.actuators, actuator))

    def with_sensor(self, sensor: SampledSensor) -> MemoryModel:
        """The same model with a sensor on one of its outputs; at most one per output."""
        if sensor.signal not in self.outputs:
            raise BadModel(f"Model {self.name} has no output {sensor.signal}; it has {', '.join(self.outputs)}.")
        if any(other.signal == sensor.signal for other in self.sensors):
            raise BadModel(f"Model {self.name} already has a sensor model behind {sensor.signal}.")
        return replace(self, sensors=(*self.sensors, sensor))
