"""A motion model as CasADi functions of one segment: the state at its end, the sensors' readings at its start.

A segment is a stretch of time over which commands are linear in time and nothing is read. Its data are
`[h, u, slope]` and, if timing is a parameter, `[h_by, begin_by, guess]`: the derivatives of the segment's length and
beginning by each shift (delay or latency), and the shifts' values for which the segments were laid out.

The full state is z = [states, actuators, relaxed quantities]. Actuators are advanced exactly, states by one step of the
classical Runge-Kutta method, relaxed quantities by an exponential formula on the same stages (`Path`), so that lags
much shorter than a segment, or zero, add no cost.

Named quantities are intermediate results between states and derivatives, on which a model's effects and lags act.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from copy import copy
from functools import cached_property
from math import factorial
from types import SimpleNamespace
from typing import Any

import casadi as cs

from ...base.errors import BadModel, near_or_all
from ...models.model import Namespace, Symbol
from ...models.motion_model import MotionModel
from ...models.parameter import placed
from ...models.smooth import SERIES, mean_and_slope
from ..kernel import Kernel
from ..trace import called, must_be_numbers, tracing
from ..virtual import SampledFunction

Relax = Callable[[str, Symbol, "NamedQuantities"], Symbol]
"""(quantity, its instantaneous value, q) -> the value after its lag."""


class NothingBefore:
    """The quantities before the first pass: all zero."""

    def __getattr__(self, name: str) -> float:
        return 0.0


class NamedQuantities:
    """The `q` of a model's dynamics: an assigned quantity passes through its alterations and lag before it is stored.

    Parameters
    ----------
    model : the model with the alterations.
    x, u, p : states, inputs and parameters; inputs and parameters are altered here, `stated` are the original ones.
    relax : applies the lag of an assigned quantity.
    before : the quantities of the previous pass; None in the first pass, which sees them as zero.
    """

    def __init__(
        self, model: MotionModel, x: Namespace, u: Namespace, p: Namespace, relax: Relax, before: Any = None
    ) -> None:
        vars(self).update(
            x=x, u=SimpleNamespace(**vars(u)), p=SimpleNamespace(**vars(p)), stated=p,
            before=before or NothingBefore(),
            _alterations=model.alterations, _relaxed=_by_quantity(model), _relax=relax,
        )  # fmt: skip
        for name, change in model.alterations:
            for item in (self.p, self.u):
                if hasattr(item, name) and name not in model.quantities:
                    setattr(item, name, change(getattr(item, name), self))

    def __setattr__(self, name: str, value: Symbol) -> None:
        for altered, change in self._alterations:
            if altered == name:
                value = change(value, self)
        if name in self._relaxed:
            value = self._relax(name, value, self)
        vars(self)[name] = value

    def __getattr__(self, name: str) -> Any:
        raise AttributeError(f"The dynamics read {name} before they assign it, or never assign it.")


def _by_quantity(model: MotionModel) -> frozenset[str]:
    return frozenset(relaxation.quantity for relaxation in model.relaxations)


JUST_AFTER = 1e-5
"""Time after its commands at which a row is measured, s."""
TINY_TIME = 1e-15
"""Added to time constants, s: the limit of no lag without a division by zero."""
TINY_RATIO = 1e-9
"""Added to a step over the time constant: padding segments have zero length."""

TimeConstants = Mapping[str, Callable[[NamedQuantities], Symbol]]
"""Relaxed quantity -> (q -> time constant, s)."""


def without_lag(name: str, value: Symbol, q: NamedQuantities) -> Symbol:
    """The instantaneous value: no lag at all."""
    del name, q
    return value


def just_after(standing: Mapping[str, Symbol], time_constants: TimeConstants) -> Relax:
    """Values of relaxed quantities `JUST_AFTER` they were at `standing`."""

    def relax(name: str, value: Symbol, q: NamedQuantities) -> Symbol:
        T = time_constants[name](q) + TINY_TIME
        return value + (standing[name] - value) * cs.exp(-JUST_AFTER / T)

    return relax


def moves_just_after(standing: Mapping[str, Symbol], time_constants: TimeConstants, moves: dict[str, Symbol]) -> Relax:
    """As `just_after`; each quantity's change is stored in `moves`, without loss of digits by cancellation."""
    seen = just_after(standing, time_constants)

    def relax(name: str, value: Symbol, q: NamedQuantities) -> Symbol:
        moves[name] = (standing[name] - value) * cs.expm1(-JUST_AFTER / (time_constants[name](q) + TINY_TIME))
        return seen(name, value, q)

    return relax


def following(paths: Mapping[str, Path], stage: Callable[[Path, Symbol, NamedQuantities], Symbol]) -> Relax:
    """Lags of relaxed quantities in one stage of a Runge-Kutta step."""
    return lambda name, value, q: stage(paths[name], value, q)


class Path:
    """A quantity that follows its instantaneous value w with a first-order lag T, over one Runge-Kutta step.

    Over a step of h seconds w rises linearly by a; the response is a steady lag plus a transient:

        w - a T / h + (y - w_0 + a T / h) exp(-t / T)

    T may be much shorter than a step. A transient sampled at the stages alone would then weigh h / 6 instead of T, so
    stages see instead the straight line with its mean and first moment, as actuators do with commands. The first stage
    does not know a yet; later stages compensate for that, so that mean and first moment over the step are exact again.
    The value at the end follows from a parabola through w at the stages (Cox & Matthews, J. Comput. Phys. 176 (2002),
    treat such exponential formulas in general).

    Parameters
    ----------
    standing : value at the beginning.
    time_constant : T, s.
    h : the step, s.
    """

    def __init__(self, standing: Symbol, time_constant: Callable[[NamedQuantities], Symbol], h: Symbol) -> None:
        self.standing, self.time_constant, self.h = standing, time_constant, h

    def first(self, value: Symbol, q: NamedQuantities) -> Symbol:
        """The first stage."""
        self.w_0, self.off = value, self.standing - value
        self.ratio = r = self._ratio(q)
        self.mean, self.slope = mean_and_slope(r)
        return value + self.off * self._transient(0.0)

    def second(self, value: Symbol, q: NamedQuantities) -> Symbol:
        """The second stage, halfway."""
        del q
        self.w_second = value
        return self._halfway(value)

    def third(self, value: Symbol, q: NamedQuantities) -> Symbol:
        """The third stage, halfway."""
        self.w_third, self.ratio_half = value, self._ratio(q)
        return self._halfway(value)

    def fourth(self, value: Symbol, q: NamedQuantities) -> Symbol:
        """The fourth stage."""
        del q
        return value + self._lag(value - self.w_0, 1.0) - self._lacking(value - self.w_0)

    def end(self, value: Symbol, q: NamedQuantities) -> Symbol:
        """Value of the quantity at the end of the step."""
        del q
        r = self.ratio_half
        weights = [_weight(r, power) for power in range(3)]
        w_half = (self.w_second + self.w_third) / 2  # their errors are opposite
        rise = 4 * w_half - 3 * self.w_0 - value
        bend = 2 * self.w_0 - 4 * w_half + 2 * value
        return cs.exp(-r) * self.standing + weights[0] * self.w_0 + weights[1] * rise + weights[2] * bend

    def _halfway(self, value: Symbol) -> Symbol:
        a = 2 * (value - self.w_0)
        return value + self._lag(a, 0.5) + self._lacking(a) / 2

    def _ratio(self, q: NamedQuantities) -> Symbol:
        return self.h / (self.time_constant(q) + TINY_TIME) + TINY_RATIO

    def _lag(self, a: Symbol, share: float) -> Symbol:
        """Difference between the quantity and its instantaneous value."""
        behind = a / self.ratio
        return (self.off + behind) * self._transient(share) - behind

    def _lacking(self, a: Symbol) -> Symbol:
        """Error of the first stage from not knowing a."""
        return a / self.ratio * (self._transient(0.0) - 1)

    def _transient(self, share: float) -> Symbol:
        """Straight line with the mean and first moment of exp(-t / T), at a share of the step."""
        return self.mean + self.slope * (share - 0.5)


def _weight(r: Symbol, power: int) -> Symbol:
    """Integral of r exp(-r (1 - s)) s^power over s from 0 to 1."""
    if power == 0:
        return -cs.expm1(-r)
    series = sum((-r) ** n * factorial(power) / factorial(power + 1 + n) for n in range(6))
    return cs.if_else(r < SERIES, r * series, 1 - power / r * _weight(r, power - 1))


class MotionTrace:
    """A traced motion model.

    Attributes
    ----------
    model : the model.
    size : length of z.
    shift_count : number of distinct delays and latencies in use.
    step : (z, s, p) -> z at the segment's end.
    actuation : (actuators, s, p) -> actuators at the segment's end; they do not depend on the vehicle.
    output : (z, s, p) -> outputs read at the segment's start.
    rates : (z, s, p) -> derivatives of the states just after the segment began.
    stiffness : (z, s, p) -> the derivative of the states' rates by the states, row by row.
    timing : (p) -> the shifts' values, s.
    """

    def __init__(self, model: MotionModel) -> None:
        self.model = model
        self.names = tuple(state.name for state in model.states)
        delayed = [(signal, by) for signal, by in model.delays]
        self.delayed = tuple(dict.fromkeys(signal for signal, _ in delayed))
        self.late = tuple(dict.fromkeys(output for output, _ in model.latencies))
        self.size = len(model.states) + len(model.actuators) + len(model.relaxations)
        self.shift_count = len(self.delayed) + len(self.late)
        self.segment_size = 1 + 2 * len(model.inputs) + 3 * self.shift_count
        z, s, p = cs.SX.sym("z", self.size), cs.SX.sym("s", self.segment_size), cs.SX.sym("p", model.size)
        named = parameters(model, p)
        self.timing = cs.Function("timing", [p], [cs.vertcat(*self._shifts(named))])
        segment = _Segment(model, s, self._shifts(named), self.delayed)
        self.step = cs.Function("step", [z, s, p], [self._step(z, segment, named)])
        a = cs.SX.sym("a", len(model.actuators))
        moved, _ = self._actuated(cs.vertsplit(a) if model.actuators else [], segment, named)
        self.actuation = cs.Function("actuation", [a, s, p], [cs.vertcat(*moved)])
        self.output = cs.Function("output", [z, s, p], [self._output(z, segment, named)])
        x, _, relaxed = self._split(z)
        rates, _ = self._evaluate(x, self._seen(z, segment, named), named, just_after(*self._relaxing(relaxed)))
        must_be_numbers(model, dict(zip(self.names, rates, strict=True)), [z, s, p])
        self.rates = cs.Function("rates", [z, s, p], [cs.vertcat(*rates)])
        A = cs.jacobian(cs.vertcat(*rates), z)[:, : len(model.states)]
        self.stiffness = SampledFunction(cs.Function("stiffness", [z, s, p], [cs.densify(cs.vec(A.T))]))
        self._starts: dict[tuple[tuple[str, ...], tuple[str, ...]], cs.Function] = {}

    @cached_property
    def kernel(self) -> Kernel:
        """The model's kernel, shared by all its simulators."""
        return Kernel(self.step, self.output)

    def of(self, model: MotionModel) -> MotionTrace:
        """The same trace for a model with the same equations but other values, bounds or priors."""
        result = copy(self)
        result.model = model
        return result

    def named_values(self, names: Sequence[str]) -> cs.Function:
        """(z, s, p) -> states, inputs, quantities and scaled combinations by name, just after a segment began.

        Raises `BadModel` for an unknown name.
        """
        z, s, p = cs.SX.sym("z", self.size), cs.SX.sym("s", self.segment_size), cs.SX.sym("p", self.model.size)
        named = parameters(self.model, p)
        segment = _Segment(self.model, s, self._shifts(named), self.delayed)
        x, _, relaxed = self._split(z)
        _, q = self._evaluate(x, self._seen(z, segment, named), named, just_after(*self._relaxing(relaxed)))
        result = vars(q.x) | vars(q.u) | {name: getattr(q, name) for name in self.model.quantities}
        scaled = [combination for combination in self.model.combinations if combination.scaled_by]
        result |= {item.name: item.of(q.p) * getattr(q, item.scaled_by) for item in scaled}
        lacking = [name for name in names if name not in result]
        if lacking:
            raise BadModel(f"Model {self.model.name} has no {', '.join(lacking)}; it has {', '.join(result)}.")
        return cs.Function("told", [z, s, p], [cs.vertcat(*[result[name] for name in names])])

    def flow(self) -> cs.Function:
        """(z, s, p) -> the derivative of z just after a segment began.

        For an actuator or a relaxed quantity it is the mean rate over the first `JUST_AFTER`, which stays finite
        without a lag.
        """
        z, s, p = cs.SX.sym("z", self.size), cs.SX.sym("s", self.segment_size), cs.SX.sym("p", self.model.size)
        named = parameters(self.model, p)
        segment = _Segment(self.model, s, self._shifts(named), self.delayed)
        x, actuators, relaxed = self._split(z)
        changes = dict[str, Symbol]()
        relax = moves_just_after(*self._relaxing(relaxed), changes)
        rates, _ = self._evaluate(x, self._seen(z, segment, named), named, relax)
        seen, of_lags = {name: begin for name, (begin, _) in segment.lines.items()}, list[Symbol]()
        named = beside_inputs(named, segment)
        for state, actuator in zip(self._standing(actuators), self.model.actuators, strict=True):
            of_lags.append(actuator.moves(state, seen[actuator.signal], named, JUST_AFTER) / JUST_AFTER)
            seen[actuator.signal] = actuator.after(state, seen[actuator.signal], named, JUST_AFTER)
        of_lags += [changes[relaxation.quantity] / JUST_AFTER for relaxation in self.model.relaxations]
        return cs.Function("flow", [z, s, p], [cs.vertcat(*rates, *of_lags)])

    def start(self, measured: tuple[str, ...], given: tuple[str, ...] = ()) -> cs.Function:
        """(readings of the measured states, inputs, p) -> z at the start of a run.

        Readings are inverted through the sensors by one Newton step, which is exact for biases, gains and lever
        arms; those that are `given` are the states themselves. Sensors that depend on derivatives of states see zero
        derivatives here: their dependence on the states is so steep that the noise of one reading would be amplified.
        Unmeasured states start as their `State` says, actuators at their command, relaxed quantities at steady state.
        """
        if (measured, given) not in self._starts:
            self._starts[measured, given] = self._start(measured, given)
        return self._starts[measured, given]

    def _start(self, measured: tuple[str, ...], given: tuple[str, ...]) -> cs.Function:
        model = self.model
        y, u, p = cs.SX.sym("y", len(measured)), cs.SX.sym("u", len(model.inputs)), cs.SX.sym("p", model.size)
        named = parameters(model, p)
        inputs = dict(zip(model.inputs, cs.vertsplit(u), strict=True))

        def completed(known: list[Symbol]) -> list[Symbol]:
            result = dict.fromkeys(self.names, cs.SX(0)) | dict(zip(measured, known, strict=True))
            states = SimpleNamespace(**result)
            for state in model.states:
                if state.name not in measured:
                    start = (
                        state.start(states, SimpleNamespace(**inputs), named) if callable(state.start) else state.start
                    )
                    result[state.name] = start
            return [result[name] for name in self.names]

        guess = cs.SX.sym("guess", len(measured))
        _, q = self._evaluate(completed(cs.vertsplit(guess)), inputs, named, without_lag)
        at = {name: k for k, name in enumerate(model.outputs)}
        readings = self._readings([cs.SX(0)] * len(model.states), q)
        read = cs.vertcat(*[guess[k] if name in given else readings[at[name]] for k, name in enumerate(measured)])
        newton = cs.Function("newton", [guess, u, p], [read, cs.jacobian(read, guess)])
        value, J = newton(y, u, p)
        known = y + cs.solve(J, y - value) if measured else y
        x = completed(cs.vertsplit(known))
        _, q = self._evaluate(x, inputs, named, without_lag)
        actuated = [inputs[actuator.signal] for actuator in model.actuators]
        settled = [getattr(q, relaxation.quantity) for relaxation in model.relaxations]
        return cs.Function("start", [y, u, p], [cs.vertcat(*x, *actuated, *settled)])

    def _shifts(self, p: Namespace) -> list[Symbol]:
        delays = [sum(by(p) for item, by in self.model.delays if item == signal) for signal in self.delayed]
        return delays + [sum(by(p) for item, by in self.model.latencies if item == output) for output in self.late]

    def _split(self, z: Symbol) -> tuple[list[Symbol], list[Symbol], list[Symbol]]:
        parts = cs.vertsplit(z)
        a, b = len(self.model.states), len(self.model.states) + len(self.model.actuators)
        return parts[:a], parts[a:b], parts[b:]

    def _evaluate(
        self,
        x: list[Symbol],
        u: Mapping[str, Symbol],
        p: Namespace,
        relax: Relax,
        q: NamedQuantities | None = None,
    ) -> tuple[list[Symbol], NamedQuantities]:
        """Rates and quantities; with the quantities `q` of an instant just before, one pass fewer is enough."""
        model = self.model
        state, rates = SimpleNamespace(**dict(zip(self.names, x, strict=True))), {}
        for _ in range(model.passes if q is None else max(1, model.passes - 1)):
            with tracing(model, {"x": state, "p": p}):  # effects alter inputs and parameters
                q = NamedQuantities(model, state, SimpleNamespace(**u), p, relax, before=q)
            rates = called(model, model.dynamics, {"x": q.x, "u": q.u, "p": q.p}, q.x, q.u, q.p, q)
        assert q is not None
        for more in model.extra_rates:
            vars(q)["rates"] = SimpleNamespace(**rates)
            rates |= more(q)
        missing = [name for name in self.names if name not in rates]
        if missing:
            others = [name for name in rates if name not in self.names]
            but = f" They give {', '.join(others)}, which is not a state." if others else ""
            raise BadModel(f"The dynamics of {model.name} do not give the derivative of {', '.join(missing)}.{but}")
        return [rates[name] for name in self.names], q

    def _step(self, z: Symbol, segment: _Segment, p: Namespace) -> Symbol:
        x, actuators, relaxed = self._split(z)
        h = segment.h
        moved, lines = self._actuated(actuators, segment, p)

        def command(share: float) -> dict[str, Symbol]:
            return {name: begin + share * (end - begin) for name, (begin, end) in lines.items()}

        standing, time_constants = self._relaxing(relaxed)
        paths = {name: Path(value, time_constants[name], h) for name, value in standing.items()}
        k1, q = self._evaluate(x, command(0.0), p, following(paths, Path.first))
        k2, q = self._evaluate(_moved(x, h / 2, k1), command(0.5), p, following(paths, Path.second), q)
        k3, q = self._evaluate(_moved(x, h / 2, k2), command(0.5), p, following(paths, Path.third), q)
        k4, q = self._evaluate(_moved(x, h, k3), command(1.0), p, following(paths, Path.fourth), q)
        end = [v + h / 6 * (a + 2 * b + 2 * c + d) for v, a, b, c, d in zip(x, k1, k2, k3, k4, strict=True)]
        _, q = self._evaluate(end, command(1.0), p, following(paths, Path.end), q)
        followed = [getattr(q, relaxation.quantity) for relaxation in self.model.relaxations]
        return cs.vertcat(*end, *moved, *followed)

    def _actuated(
        self, states: list[Symbol], segment: _Segment, p: Namespace
    ) -> tuple[list[Symbol], dict[str, tuple[Symbol, Symbol]]]:
        """Actuators' states at the segment's end, and the commands after them as (begin, end) lines."""
        lines, moved, p = dict(segment.lines), [], beside_inputs(p, segment)
        for state, actuator in zip(self._standing(states), self.model.actuators, strict=True):
            after, lines[actuator.signal] = actuator.segment(state, lines[actuator.signal], p, segment.h)
            moved.append(after)
        return moved, lines

    def _standing(self, states: list[Symbol]) -> list[Any]:
        """States as passed to the actuators: its own, and for an actuator that reads another one's state, both."""
        of = {actuator.name: state for actuator, state in zip(self.model.actuators, states, strict=True)}
        return [
            (state, of[actuator.beside]) if actuator.beside else state
            for actuator, state in zip(self.model.actuators, states, strict=True)
        ]

    def _relaxing(self, relaxed: list[Symbol]) -> tuple[dict[str, Symbol], TimeConstants]:
        """Values of relaxed quantities, and their time constants."""
        all_of_them = self.model.relaxations
        standing = {item.quantity: value for item, value in zip(all_of_them, relaxed, strict=True)}
        return standing, {item.quantity: item.time_constant for item in all_of_them}

    def _seen(self, z: Symbol, segment: _Segment, p: Namespace) -> dict[str, Symbol]:
        """Inputs after their actuators, just after the segment began."""
        seen, p = {name: begin for name, (begin, _) in segment.lines.items()}, beside_inputs(p, segment)
        for state, actuator in zip(self._standing(self._split(z)[1]), self.model.actuators, strict=True):
            seen[actuator.signal] = actuator.after(state, seen[actuator.signal], p, JUST_AFTER)
        return seen

    def _output(self, z: Symbol, segment: _Segment, p: Namespace) -> Symbol:
        x, _, relaxed = self._split(z)
        rates, q = self._evaluate(x, self._seen(z, segment, p), p, just_after(*self._relaxing(relaxed)))
        return cs.vertcat(*self._readings(rates, q))

    def _readings(self, rates: list[Symbol], q: NamedQuantities) -> list[Symbol]:
        model = self.model
        read = SimpleNamespace(**{name: getattr(q.x, name, None) for name in model.outputs})
        for name in model.outputs:
            if getattr(read, name) is None:
                if name not in vars(q):
                    known = [*self.names, *(var for var in vars(q) if var in model.quantities)]
                    raise BadModel(
                        f"Model {model.name} predicts {name}, which is neither a state nor a quantity that its "
                        f"dynamics assign.{near_or_all(name, known)}"
                    )
                setattr(read, name, getattr(q, name))
        vars(q)["rates"] = SimpleNamespace(**dict(zip(self.names, rates, strict=True)))
        for sensor in model.sensors:
            for name, value in sensor(read, q).items():
                if name in model.outputs:
                    setattr(read, name, value)
        return [getattr(read, name) for name in model.outputs]


class _Segment:
    """A segment's length and commands as symbols, with their derivatives by shifts in time."""

    def __init__(self, model: MotionModel, s: Symbol, shifts: list[Symbol], delayed: tuple[str, ...]) -> None:
        count, inputs = len(shifts), len(model.inputs)
        parts = cs.vertsplit(s)
        length, values, slopes = parts[0], parts[1 : 1 + inputs], parts[1 + inputs : 1 + 2 * inputs]
        h_by, begin_by, guess = (parts[1 + 2 * inputs + k * count : 1 + 2 * inputs + (k + 1) * count] for k in range(3))
        moved = [shift - at for shift, at in zip(shifts, guess, strict=True)]  # value zero, derivative one
        self.h = length + sum(a * b for a, b in zip(h_by, moved, strict=True))
        begin = sum(a * b for a, b in zip(begin_by, moved, strict=True))
        self.lines: dict[str, tuple[Symbol, Symbol]] = {}
        for name, value, slope in zip(model.inputs, values, slopes, strict=True):
            offset = begin - moved[delayed.index(name)] if name in delayed else begin
            first = value + slope * offset
            self.lines[name] = (first, first + slope * self.h)


def _moved(x: list[Symbol], h: Symbol, rates: list[Symbol]) -> list[Symbol]:
    return [value + h * rate for value, rate in zip(x, rates, strict=True)]


def beside_inputs(p: Namespace, segment: _Segment) -> Namespace:
    """Parameters with the lines of all inputs added, for actuators that read other inputs than their own."""
    return SimpleNamespace(**vars(p), inputs=segment.lines)


def parameters(model: MotionModel, vector: Symbol) -> Namespace:
    """The parameters by name, from their vector; arrays as flat lists."""
    result: dict[str, Symbol] = {}
    for parameter, place in placed(model.parameters):
        value = cs.vertsplit(vector[place])
        result[parameter.name] = value[0] if parameter.shape == () else value
    return SimpleNamespace(**result)
