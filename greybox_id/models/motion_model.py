"""Equations of motion: states, their derivatives, and sensor readings.

    def dynamics(x, u, p, q):
        q.alpha_f = u.steer - atan2(x.v_y + p.l_f * x.yaw_rate, x.v_x)
        q.F_yf = tyre.force(q.alpha_f, ...)
        q.a_y = (q.F_yf * cos(u.steer) + q.F_yr) / p.m
        return {"v_y": q.a_y - x.v_x * x.yaw_rate, ...}

`q` collects the named quantities between states and derivatives. Assigning one applies the effects that alter it before
it is read back, so that an effect needs no copy of the equations. Outputs are states or quantities by name.

Delays and actuators lie between command and vehicle, sensors and latencies between vehicle and recording, in the
order

    command -> delay -> actuators -> altered inputs and parameters -> dynamics with altered quantities -> outputs ->
    sensors -> latency -> recording

Within each of these, effects act in the order in which they were added. Delays and latencies are pure shifts in time
and commute with everything time-invariant, so their place is no restriction.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from types import MappingProxyType
from typing import Any, ClassVar

from ..base.errors import BadModel
from .model import Model, Namespace, Symbol

Quantities = Any
"""q: named quantities as attributes; q.x, q.u, q.p are the states, inputs and parameters, q.before the quantities of
the previous pass, all zero in the first one."""


@dataclass(frozen=True)
class State:
    """One state.

    Attributes
    ----------
    name : a signal's name if the state may be recorded.
    unit : SI unit.
    scale : its typical size; standard deviation of an unmeasured initial value.
    start : initial value if it is not measured at the start of a run: a number, or a function of (x, u, p), where x
        holds the measured states (others at zero).

    Examples
    --------
    >>> import greybox_id as gb
    >>> gb.models.State("yaw_rate", "rad/s", scale=0.5).start
    0.0
    """

    name: str
    unit: str
    scale: float = 1.0
    start: float | Callable[[Namespace, Namespace, Namespace], Symbol] = 0.0


@dataclass(frozen=True)
class Actuator:
    """A dynamic element between a recorded command and the vehicle, with one state: its output.

    Attributes
    ----------
    signal : the input it acts on.
    name : of its state.
    segment : (state, (begin, end) of the command, p, h) -> (state after h, (begin, end) of its output). Commands are
        straight lines over a segment of h seconds, and so is the output: the line with the same mean and first moment
        as the exact response. In all functions p has, in addition to the parameters, `inputs`: name -> such a line of
        every input.
    after : (state, command, p, time) -> output at this time after a step to the command.
    moves : (state, command, p, time) -> that output less the state, computed without cancellation.
    beside : name of another actuator whose state it also reads: `state` is then a pair, its own first. At rest both
        states equal the command.
    """

    signal: str
    name: str
    segment: Callable[[Symbol, tuple[Symbol, Symbol], Namespace, Symbol], tuple[Symbol, tuple[Symbol, Symbol]]]
    after: Callable[[Symbol, Symbol, Namespace, float], Symbol]
    moves: Callable[[Symbol, Symbol, Namespace, float], Symbol]
    beside: str = ""


@dataclass(frozen=True)
class Relaxation:
    """A quantity that follows its instantaneous value with a first-order lag.

    Attributes
    ----------
    quantity : name of the quantity.
    time_constant : q -> s; zero means no lag.
    """

    quantity: str
    time_constant: Callable[[Quantities], Symbol]


@dataclass(frozen=True)
class Validity:
    """Where equations hold; elsewhere they only stay finite, and readings there are not used for estimation.

    Attributes
    ----------
    signal : an input or an output.
    least : smallest absolute value of the signal at which the equations hold, in its unit.
    outputs : the outputs concerned.
    """

    signal: str
    least: float
    outputs: tuple[str, ...]


Alteration = tuple[str, Callable[[Symbol, Quantities], Symbol]]
"""Name of a parameter, input or quantity, and (its value, q) -> its altered value."""

Sensor = Callable[[Namespace, Quantities], Mapping[str, Symbol]]
"""(readings so far, q) -> the readings that change; q.rates holds the derivatives of the states."""

Shift = Callable[[Namespace], Symbol]
"""Parameters -> time, s."""


@dataclass(frozen=True, kw_only=True, repr=False)
class MotionModel(Model):
    """Equations of motion.

    Attributes
    ----------
    states : in order.
    dynamics : (x, u, p, q) -> state name -> derivative.
    quantities : names that `dynamics` assigns, for effects, reports and estimators to use.
    commands : inputs that a controller or driver commands; they are held between rows unless the recording says
        otherwise. Other inputs are measured and interpolated linearly between rows.
    extra_rates : (q) -> derivatives of the states that effects add.
    delays : input -> delay of its command. Several on one input add up.
    actuators : between commands and vehicle.
    alterations : of parameters, inputs and quantities.
    relaxations : of quantities.
    sensors : between outputs and recording.
    latencies : output -> latency of its reading. Several on one output add up.
    passes : number of evaluations of the dynamics. Algebraic loops, as of loads and accelerations, read q.before and
        converge over a few passes.
    validity : where the equations hold; fits leave out other readings.
    rounded : magnitude of an effect -> the input that it rounds to integer multiples of this magnitude.
    learnt : whether constants of the equations are weights of a network, which includes all effects in its training
        data.

    Examples
    --------
    >>> import greybox_id as gb
    >>> model = gb.models.MotionModel(
    ...     name="turner",
    ...     about="yaw rate that lags behind its kinematic value",
    ...     states=(gb.models.State("yaw_rate", "rad/s"),),
    ...     inputs=("steer", "v_x"),
    ...     outputs=("yaw_rate",),
    ...     parameters=(
    ...         gb.models.Parameter("L", "m", 0.33, (0.1, 1.0)),
    ...         gb.models.Parameter("lag", "s", 0.1, (0.01, 1.0)),
    ...     ),
    ...     dynamics=lambda x, u, p, q: {"yaw_rate": (u.v_x * u.steer / p.L - x.yaw_rate) / p.lag},
    ... )
    >>> lap = gb.read(gb.datasets.shipped("racer_train"), columns="roboracer").rows(0, 200)
    >>> bool(0.1 < gb.fit(model, lap).params["L"] < 1.0)
    True
    """

    kind: ClassVar[str] = "motion"
    called: ClassVar[str] = "a model of motion"

    states: tuple[State, ...]
    dynamics: Callable[[Namespace, Namespace, Namespace, Quantities], Mapping[str, Symbol]]
    quantities: tuple[str, ...] = ()
    commands: tuple[str, ...] = ()
    extra_rates: tuple[Callable[[Quantities], Mapping[str, Symbol]], ...] = ()
    delays: tuple[tuple[str, Shift], ...] = ()
    actuators: tuple[Actuator, ...] = ()
    alterations: tuple[Alteration, ...] = ()
    relaxations: tuple[Relaxation, ...] = ()
    sensors: tuple[Sensor, ...] = ()
    latencies: tuple[tuple[str, Shift], ...] = ()
    passes: int = 1
    validity: tuple[Validity, ...] = ()
    rounded: Mapping[str, str] = field(default_factory=lambda: MappingProxyType({}))
    learnt: bool = False

    @property
    def names(self) -> frozenset[str]:
        """All names that an effect may refer to."""
        parameters = (parameter.name for parameter in self.parameters)
        states = (state.name for state in self.states)
        return frozenset((*self.inputs, *self.outputs, *parameters, *states, *self.quantities))

    def unit(self, name: str) -> str:
        """SI unit of a signal, a state or a quantity."""
        stated = {state.name: state.unit for state in self.states}
        return self.units.get(name) or stated.get(name) or Model.unit(self, name)

    def delayed(self, signal: str, by: Shift) -> MotionModel:
        """The same model with a delayed command."""
        self._must_have(signal, self.inputs, "input")
        return replace(self, delays=(*self.delays, (signal, by)))

    def actuated(self, actuator: Actuator) -> MotionModel:
        """The same model with an actuator after those that its input already has."""
        self._must_have(actuator.signal, self.inputs, "input")
        return replace(self, actuators=(*self.actuators, actuator))

    def altered(self, **changes: Callable[[Symbol, Quantities], Symbol]) -> MotionModel:
        """The same model with altered parameters, inputs or quantities; names that it lacks are ignored."""
        known = self.names
        result = tuple((name, change) for name, change in changes.items() if name in known)
        if not result:
            raise BadModel(f"Model {self.name} has none of {', '.join(changes)}.")
        return replace(self, alterations=(*self.alterations, *result))

    def relaxed(self, time_constant: Callable[[Quantities], Symbol], *quantities: str) -> MotionModel:
        """The same model with first-order lags on quantities; names that it lacks are ignored."""
        result = tuple(Relaxation(name, time_constant) for name in quantities if name in self.quantities)
        return replace(self, relaxations=(*self.relaxations, *result))

    def sensed(self, sensor: Sensor) -> MotionModel:
        """The same model with a sensor after those that it already has."""
        return replace(self, sensors=(*self.sensors, sensor))

    def late(self, by: Shift, *outputs: str) -> MotionModel:
        """The same model with delayed readings; outputs that it lacks are ignored."""
        result = tuple((name, by) for name in outputs if name in self.outputs)
        return replace(self, latencies=(*self.latencies, *result))

    def gone_through(self, passes: int) -> MotionModel:
        """The same model with at least this many evaluations of the dynamics."""
        return replace(self, passes=max(passes, self.passes))

    def with_states(self, rates: Callable[[Quantities], Mapping[str, Symbol]], *states: State) -> MotionModel:
        """The same model with further states; `rates` is (q) -> their derivatives."""
        return replace(self, states=(*self.states, *states), extra_rates=(*self.extra_rates, rates))

    def _must_have(self, name: str, among: tuple[str, ...], what: str) -> None:
        if name not in among:
            raise BadModel(f"Model {self.name} has no {what} {name}; it has {', '.join(among)}.")
