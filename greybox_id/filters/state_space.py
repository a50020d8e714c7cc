"""A motion model as a filter sees it: what is tracked joins the states, and every noise has a size.

    x = [states, actuators, relaxed quantities | what is tracked | colour of readings]

What is tracked walks at random. It may be a parameter; an input, which is then taken from nowhere but the readings; or
a quantity of the equations, such as the axle force F_yf, which then replaces the tyre model. What is positive walks in
its logarithm, in shares of itself. Colour is the slow part of a reading's error (a first-order Gauss-Markov process:
roll, bank, vibration), white noise the rest.

Noise is of the same kind as parameters, numbers by name, and follows them in the vector p:

    walk_v_y        how far a state or what is tracked walks in the root of a second, m/s per root s
    noise_a_y       standard deviation of a reading's white noise
    colour_a_y      standard deviation of its coloured noise
    memory_a_y      s, its time constant
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import casadi as cs
import numpy as np

from ..engine.motion.trace import MotionTrace
from ..engine.sampled import SampledFunction
from ..models.motion_model import MotionModel

TINY_TIME = 1e-15
"""Added to lengths of segments, s: some have none."""

SLOWEST = 0.5
"""Below this speed, m/s, there is no sideslip angle to speak of."""


@dataclass(frozen=True)
class Tracked:
    """Something that walks at random.

    Attributes
    ----------
    name : a parameter of the model by that name.
    unit : SI unit.
    value : where it starts.
    sd : how well that is known, in the same unit.
    logarithmic : whether it walks in its logarithm.
    returns : whether it is drawn back to where it started (a Gauss-Markov process) instead of walking off for good.
    """

    name: str
    unit: str
    value: float
    sd: float
    logarithmic: bool
    returns: bool = False

    @property
    def start(self) -> float:
        """Where it starts, in the coordinate it walks in."""
        return float(np.log(self.value)) if self.logarithmic else self.value

    @property
    def start_sd(self) -> float:
        """How well that is known, in the coordinate it walks in."""
        return self.sd / self.value if self.logarithmic else self.sd


class StateSpace:
    """A model with what is tracked and its noise.

    Attributes
    ----------
    model : the model; what is tracked is among its parameters.
    tracked : what walks, in order.
    coloured : outputs whose error has a slow part.
    trace : the model's segments as CasADi functions.
    names : of the entries of x.
    noises : names of the noise parameters, which follow the model's in p.
    step : (x, s, p) -> x at the segment's end, variance of the noise that joined, F = d x_end / d x.
    throughout : whether that noise joins all along a segment, and not at its end.
    output : (x, s, p) -> readings at the segment's start, variance of their white noise, H = d y / d x.
    """

    def __init__(
        self, model: MotionModel, tracked: Sequence[Tracked], coloured: Sequence[str] = (), *, throughout: bool = False
    ) -> None:
        self.model, self.tracked, self.coloured = model, tuple(tracked), tuple(coloured)
        self.throughout = throughout
        self.trace = trace = MotionTrace(model)
        own_names = tuple(one.name for one in self.tracked)
        self.walking = (*trace.names, *own_names)
        self.carried = (*(a.name for a in model.actuators), *(r.quantity for r in model.relaxations))
        self.names = (*trace.names, *self.carried, *own_names, *(f"{name}_colour" for name in self.coloured))
        self.size = len(self.names)
        self.noises = (
            *(f"walk_{name}" for name in self.walking),
            *(f"memory_{one.name}" for one in self.tracked if one.returns),
            *(f"noise_{name}" for name in model.outputs),
            *(f"{kind}_{name}" for name in self.coloured for kind in ("colour", "memory")),
        )
        x, s = cs.SX.sym("x", self.size), cs.SX.sym("s", trace.segment_size)
        p = cs.SX.sym("p", model.size + len(self.noises))
        behind = trace.size + len(self.tracked)
        z, value, colour = x[: trace.size], x[trace.size : behind], x[behind:]
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
        """(x, s, p) -> what is named, then its derivatives by x, name by name.

        Names are those of states, inputs, quantities and scaled combinations; "sideslip", atan2(v_y, v_x), NaN below
        `SLOWEST`; and those of what is tracked.
        """
        x, s, p, z, parameters = self._of
        value = {one.name: parameters[self.place(one.name)] for one in self.tracked}
        requested = dict.fromkeys(n for n in names if n != "sideslip" and n not in value)
        if "sideslip" in names:
            requested |= dict.fromkeys(("v_x", "v_y"))
        result = (
            dict(zip(requested, cs.vertsplit(self.trace.told(tuple(requested))(z, s, parameters)), strict=True)) | value
        )
        if "sideslip" in names:
            slow = cs.fabs(result["v_x"]) < SLOWEST
            result["sideslip"] = cs.if_else(slow, cs.SX.nan(), cs.atan2(result["v_y"], result["v_x"]))
        values = cs.densify(cs.vertcat(*[result[name] for name in names]))
        by_x = cs.densify(cs.vec(cs.jacobian(values, x).T))
        return SampledFunction(cs.Function("seen", [x, s, p], [cs.vertcat(values, by_x)]))

    def start(self, read: tuple[str, ...]) -> SampledFunction:
        """(readings of the states read, inputs, parameters) -> [states, actuators, relaxed] where a run starts."""
        if read not in self._starts:
            self._starts[read] = SampledFunction(self.trace.start(read))
        return self._starts[read]

    def _parameters(self, sx: cs.SX, p: cs.SX) -> cs.SX:
        """The model's parameters, those tracked from where they have walked to."""
        entries = cs.vertsplit(p) if p.numel() else []
        for k, tracked in enumerate(self.tracked):
            entries[self.place(tracked.name)] = cs.exp(sx[k]) if tracked.logarithmic else sx[k]
        return cs.vertcat(*entries)

    def place(self, name: str) -> int:
        """Where a parameter of the model begins in p."""
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
        """Variance of what joins each entry of x over a segment."""
        walks = {name: noise[f"walk_{name}"] ** 2 * h for name in self.walking}
        for one in self.tracked:
            if one.returns:
                T = noise[f"memory_{one.name}"]
                walks[one.name] *= self._joined(h, T) * T / (2 * h + TINY_TIME)
        carried = [cs.SX(0)] * len(self.carried)  # exact responses, and followers of what has noise already
        coloured = [noise[f"colour_{n}"] ** 2 * self._joined(h, noise[f"memory_{n}"]) for n in self.coloured]
        states = [walks[name] for name in self.trace.names]
        return cs.vertcat(*states, *carried, *[walks[one.name] for one in self.tracked], *coloured)

    def _joined(self, h: cs.SX, T: cs.SX) -> cs.SX:
        """Variance of a Gauss-Markov process's noise over a segment, in shares of the process's own."""
        value = -cs.expm1(-2 * h / T)
        if not self.throughout:
            return value
        decay = cs.exp(-h / T)
        return value * 3 / (1 + decay + decay**2)  # what joins early fades until the end


def _differentiated(name: str, x: cs.SX, s: cs.SX, p: cs.SX, value: cs.SX, variance: cs.SX) -> cs.Function:
    both = cs.cse(cs.densify(value))
    return cs.Function(name, [x, s, p], [both, cs.densify(variance), cs.jacobian(both, x)])
