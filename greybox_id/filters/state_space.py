"""The state space of a filter: a motion model with tracked parameters among its states, and sizes of all noises.

    x = [states, actuators, relaxed quantities | tracked parameters | coloured noise of readings]

Tracked parameters are random walks. Each may be a parameter of the model; the magnitude of an effect; a combination
scaled by a quantity, such as cornering stiffness; a quantity of the equations, such as the axle force F_yf, which then
replaces the tyre model; or an input that was not recorded, such as the driving force, which then follows from the
readings alone. Positive ones walk in their logarithm. Coloured noise is the slow part of a reading's error (a
first-order Gauss-Markov process: roll, bank, vibration), white noise the rest.

There are two kinds of tracked parameters:

    parameters     walk without return: tyres that warm or wear, a load that shifts
    disturbances   return to their start (Gauss-Markov processes): bank and wind, play of the steering

Sizes of noises are parameters by name, appended to the model's in the vector p:

    walk_v_y        random walk of a state or tracked parameter in one root second, m/s per root s
    noise_a_y       standard deviation of a reading's white noise
    colour_a_y      standard deviation of its coloured noise
    memory_a_y      s, its time constant
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import casadi as cs
import numpy as np

from ..base.errors import BadInput, near_or_all
from ..base.signals import unit_of, unit_of_quantity
from ..engine.motion.trace import MotionTrace
from ..engine.virtual import SampledFunction
from ..models.effect import Effect
from ..models.model import Symbol
from ..models.motion_model import MotionModel, Quantities
from ..models.parameter import Parameter

TINY_TIME = 1e-15
"""Added to lengths of segments, s: some are zero."""

SLOWEST = 0.5
"""Speed, m/s, below which the sideslip angle is not defined."""


@dataclass(frozen=True)
class Tracked:
    """A tracked parameter, a random walk.

    Attributes
    ----------
    name : name of a parameter of the model.
    unit : SI unit.
    value : initial value.
    sd : standard deviation of the initial value, in the same unit.
    logarithmic : whether it walks in its logarithm.
    returns : whether it returns to its start (a Gauss-Markov process) instead of walking off.
    """

    name: str
    unit: str
    value: float
    sd: float
    logarithmic: bool
    returns: bool = False

    @property
    def start(self) -> float:
        """Initial value, in the coordinate of the walk."""
        return float(np.log(self.value)) if self.logarithmic else self.value

    @property
    def start_sd(self) -> float:
        """Standard deviation of the initial value, in the coordinate of the walk."""
        return self.sd / self.value if self.logarithmic else self.sd


class StateSpace:
    """A model with tracked parameters and noise.

    Attributes
    ----------
    model : the model; tracked parameters are among its parameters.
    tracked : the tracked parameters, in order.
    coloured : outputs with coloured noise.
    trace : the model's segments as CasADi functions.
    names : names of the entries of x.
    noises : names of the noise parameters, which follow the model's in p.
    step : (x, s, p) -> x at the segment's end, variance of its process noise, F = d x_end / d x.
    throughout : whether process noise enters throughout a segment, not at its end.
    output : (x, s, p) -> readings at the segment's start, variance of their white noise, H = d y / d x.
    """

    def __init__(
        self, model: MotionModel, tracked: Sequence[Tracked], coloured: Sequence[str] = (), *, throughout: bool = False
    ) -> None:
        self.model, self.tracked, self.coloured = model, tuple(tracked), tuple(coloured)
        self.throughout = throughout
        self.trace = trace = MotionTrace(model)
        tracked_names = tuple(one.name for one in self.tracked)
        self.walking = (*trace.names, *tracked_names)
        self.carried = (*(a.name for a in model.actuators), *(r.quantity for r in model.relaxations))
        self.names = (*trace.names, *self.carried, *tracked_names, *(f"{name}_colour" for name in self.coloured))
        self.size = len(self.names)
        self.noises = (
            *(f"walk_{name}" for name in self.walking),
            *(f"memory_{one.name}" for one in self.tracked if one.returns),
            *(f"noise_{name}" for name in model.outputs),
            *(f"{kind}_{name}" for name in self.coloured for kind in ("colour", "memory")),
        )
        x, s = cs.SX.sym("x", self.size), cs.SX.sym("s", trace.segment_size)
        p = cs.SX.sym("p", model.size + len(self.noises))
        end_of_tracked = trace.size + len(self.tracked)
        z, value, colour = x[: trace.size], x[trace.size : end_of_tracked], x[end_of_tracked:]
        parameters = self._parameters(value, p[: model.size])
        noise = dict(zip(self.noises, cs.vertsplit(p[model.size :]), strict=True))
        ahead = cs.vertcat(
            trace.step(z, s, parameters), self._drawn(value, s[0], noise), self._faded(colour, s[0], noise)
        )
        self.step = _differentiated("step", x, s, p, ahead, self._joining(s[0], noise))
        read = [*cs.vertsplit(trace.output(z, s, parameters))]
        for k, name in enumerate(self.coloured):
            read[model.outputs.index(name)] += colour[k]
        white = [noise[f"noise_{name}"] ** 2 for name in model.outputs]
        self.output = _differentiated("output", x, s, p, cs.vertcat(*read), cs.vertcat(*white))
        self._of = (x, s, p, z, parameters)
        self._starts: dict[tuple[str, ...], SampledFunction] = {}

    def seen(self, names: Sequence[str]) -> SampledFunction:
        """(x, s, p) -> the named values, then their derivatives by x, name by name.

        Names are those of states, inputs, quantities and scaled combinations; "sideslip", atan2(v_y, v_x), NaN below
        `SLOWEST`; and those of tracked parameters.
        """
        x, s, p, z, parameters = self._of
        tracked_values = {one.name: parameters[self.place(one.name)] for one in self.tracked}
        requested = dict.fromkeys(n for n in names if n != "sideslip" and n not in tracked_values)
        if "sideslip" in names:
            requested |= dict.fromkeys(("v_x", "v_y"))
        result = (
            dict(zip(requested, cs.vertsplit(self.trace.named_values(tuple(requested))(z, s, parameters)), strict=True))
            | tracked_values
        )
        if "sideslip" in names:
            slow = cs.fabs(result["v_x"]) < SLOWEST
            result["sideslip"] = cs.if_else(slow, cs.SX.nan(), cs.atan2(result["v_y"], result["v_x"]))
        values = cs.densify(cs.vertcat(*[result[name] for name in names]))
        by_x = cs.densify(cs.vec(cs.jacobian(values, x).T))
        return SampledFunction(cs.Function("seen", [x, s, p], [cs.vertcat(values, by_x)]))

    def start(self, read: tuple[str, ...]) -> SampledFunction:
        """(readings of the measured states, inputs, parameters) -> [states, actuators, relaxed] at a run's start."""
        if read not in self._starts:
            self._starts[read] = SampledFunction(self.trace.start(read))
        return self._starts[read]

    def _parameters(self, sx: cs.SX, p: cs.SX) -> cs.SX:
        """The model's parameters, with the present values of the tracked ones."""
        entries = cs.vertsplit(p) if p.numel() else []
        for k, tracked in enumerate(self.tracked):
            entries[self.place(tracked.name)] = cs.exp(sx[k]) if tracked.logarithmic else sx[k]
        return cs.vertcat(*entries)

    def place(self, name: str) -> int:
        """First index of a parameter of the model in p."""
        return sum(p.size for p in self.model.parameters[: [p.name for p in self.model.parameters].index(name)])

    def _faded(self, colour: cs.SX, h: cs.SX, noise: Mapping[str, cs.SX]) -> cs.SX:
        decay = [cs.exp(-h / noise[f"memory_{name}"]) for name in self.coloured]
        return cs.vertcat(*[a * colour[k] for k, a in enumerate(decay)])

    def _drawn(self, sx: cs.SX, h: cs.SX, noise: Mapping[str, cs.SX]) -> cs.SX:
        ends = []
        for k, one in enumerate(self.tracked):
            decay = cs.exp(-h / noise[f"memory_{one.name}"]) if one.returns else 1
            ends.append(one.start + decay * (sx[k] - one.start))
        return cs.vertcat(*ends)

    def _joining(self, h: cs.SX, noise: Mapping[str, cs.SX]) -> cs.SX:
        """Variance of the process noise of each entry of x over a segment."""
        walks = {name: noise[f"walk_{name}"] ** 2 * h for name in self.walking}
        for one in self.tracked:
            if one.returns:
                T = noise[f"memory_{one.name}"]
                walks[one.name] *= self._joined(h, T) * T / (2 * h + TINY_TIME)
        carried = [cs.SX(0)] * len(self.carried)  # deterministic responses to states that have noise already
        coloured = [noise[f"colour_{n}"] ** 2 * self._joined(h, noise[f"memory_{n}"]) for n in self.coloured]
        states = [walks[name] for name in self.trace.names]
        return cs.vertcat(*states, *carried, *[walks[one.name] for one in self.tracked], *coloured)

    def _joined(self, h: cs.SX, T: cs.SX) -> cs.SX:
        """Variance of a Gauss-Markov process's noise over a segment, relative to its stationary variance."""
        share = -cs.expm1(-2 * h / T)
        if not self.throughout:
            return share
        decay = cs.exp(-h / T)
        return share * 3 / (1 + decay + decay**2)  # early noise decays until the end


def _differentiated(name: str, x: cs.SX, s: cs.SX, p: cs.SX, value: cs.SX, variance: cs.SX) -> cs.Function:
    both = cs.cse(cs.densify(value))
    return cs.Function(name, [x, s, p], [both, cs.densify(variance), cs.jacobian(both, x)])


SHARE = 0.2
"""Default standard deviation of a positive parameter, relative to its value."""
USUAL = {"N": 3000.0, "N m": 1000.0, "m/s^2": 3.0, "rad": 0.01, "rad/s": 0.02, "A": 20.0, "1": 0.2}
"""Default standard deviation of other parameters, by unit."""
GRAVITY = 9.81


def walking(
    model: MotionModel, parameters: Sequence[str], disturbances: Sequence[str], effects: Mapping[str, Effect]
) -> tuple[MotionModel, tuple[Tracked, ...]]:
    """The model with tracked parameters among its parameters, and their random walks.

    Raises
    ------
    BadInput : a name is unknown to this model, or given twice.
    """
    names = [*parameters, *disturbances]
    twice = sorted({name for name in names if names.count(name) > 1})
    if twice:
        raise BadInput(f"{', '.join(twice)} is named twice; name it once.")
    tracked: list[Tracked] = []
    for name in names:
        model, parameter_name = _with_parameter(model, name, effects)
        if any(other.name == parameter_name for other in tracked):
            raise BadInput(f"{name} is named twice: it is {parameter_name} by another name; name it once.")
        tracked.append(_tracked(model, parameter_name, returns=name in disturbances))
    return model, tuple(tracked)


def trackable(model: MotionModel) -> tuple[str, ...]:
    """Names that can be tracked: scaled combinations, parameters, inputs and quantities."""
    scaled = (combination.name for combination in model.combinations if combination.scaled_by)
    numbers = (parameter.name for parameter in model.parameters if parameter.shape == ())
    return tuple(dict.fromkeys((*scaled, *numbers, *model.inputs, *model.quantities)))


def _with_parameter(model: MotionModel, name: str, effects: Mapping[str, Effect]) -> tuple[MotionModel, str]:
    """The model with a parameter for the named value, and the parameter's name."""
    if name in model:
        if model[name].shape != ():
            raise BadInput(f"{name} is an array of {model[name].size} numbers; only single numbers are tracked.")
        return model, name
    scaled = next(
        (
            combination.scaled_by
            for combination in model.combinations
            if combination.name == name and combination.scaled_by
        ),
        "",
    )
    if scaled:
        factor = Parameter(scaled, "1", 1.0, (1e-3, 1e3), about=f"ratio of {name} to its nominal value")
        return model.with_parameters(factor).altered(**{scaled: _scaling(scaled)}), scaled
    if name in model.inputs:
        signals = model.aliases.get(name, (name,))
        free = replace(model, defaults={**model.defaults, name: 0.0})
        quantity = next((signal for signal in signals if signal in model.quantities), "")
        if quantity:  # track the quantity that the input determines, in a unit that needs no factor
            return _with_parameter(free, quantity, effects)
        return free.with_parameters(Parameter(name, unit_of(signals[0]), 0.0)).altered(**{name: _given(name)}), name
    if name in model.quantities:
        parameter = Parameter(name, unit_of_quantity(name), 0.0, about="in place of its equation")
        return model.with_parameters(parameter).altered(**{name: _given(name)}), name
    if name in effects and effects[name].concerns(model):
        return model + effects[name], effects[name].parameter.name
    raise BadInput(
        f"{model.name} has no {name} that could be tracked.{near_or_all(name, (*trackable(model), *effects))}"
    )


def _scaling(name: str) -> Callable[[Symbol, Quantities], Symbol]:
    def scaled(value: Symbol, q: Quantities) -> Symbol:
        return value * getattr(q.p, name)

    return scaled


def _given(name: str) -> Callable[[Symbol, Quantities], Symbol]:
    def given(value: Symbol, q: Quantities) -> Symbol:
        del value
        return getattr(q.p, name)

    return given


def _tracked(model: MotionModel, name: str, returns: bool) -> Tracked:
    parameter = model[name]
    value = float(parameter.array)
    positive = parameter.bounds[0] >= 0 and value > 0
    sd = SHARE * value if positive else _usual(model, parameter)
    if parameter.prior is not None and np.isfinite(float(np.asarray(parameter.prior.sd))):
        sd = float(np.asarray(parameter.prior.sd))
    return Tracked(name, parameter.unit, value, sd, logarithmic=positive, returns=returns)


def _usual(model: MotionModel, parameter: Parameter) -> float:
    if parameter.unit == "N" and "m" in model:
        return 0.3 * float(model["m"].array) * GRAVITY
    return USUAL.get(parameter.unit, max(abs(float(parameter.array)), 1.0))
