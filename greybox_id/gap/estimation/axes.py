"""Axes along which a diagnosis moves parameters: nuisances, which have priors, and candidates, which have none."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from itertools import product
from math import exp, inf, isinf, log, pi
from sys import float_info
from types import SimpleNamespace

import numpy as np

from ...engine.simulation import Diagnosed
from ...models.effect import Effect
from ...models.memory_model import MemoryModel
from ...models.parameter import Parameter

ZONE = "zone of indifference"
"""Source of a prior that no file states."""
DIRECTIONS = (0.0, pi / 2, pi, -pi / 2)
SECONDS = {"J": (1e-3, 1e-2, 0.1, 1.0, 10.0), "m/s": (0.5, 1.0, 3.0), "Hz": (0.6, 1.0, 1.7, 2.9)}
"""By unit, factors on the usual value of a second parameter at which it is tried; other units: 1 alone."""
SHARE = (0.0, 1.0)
"""Bounds of a second parameter that is the share of a quantity on which an effect acts."""


@dataclass(frozen=True)
class Axis:
    """One parameter that is moved, in a coordinate that is finite at its null value.

    Attributes
    ----------
    name, unit : the parameter's.
    index : in the parameter vector.
    inverse : whether the coordinate is one over the value, for limits whose null is infinity.
    null, low, high : coordinates.
    mean, sd : prior of the coordinate; the sd is infinite where there is none.
    scale : usual size of a change.
    shift : whether delays or latencies depend on the parameter.
    gradual : whether the derivative at the null describes larger magnitudes.
    narrow : whether the prior is a zone of indifference, so small that the derivative at the null suffices.
    relative : whether the coordinate is the logarithm of the value.
    """

    name: str
    unit: str
    index: int
    inverse: bool
    null: float
    low: float
    high: float
    mean: float
    sd: float
    scale: float
    shift: bool = False
    gradual: bool = True
    narrow: bool = False
    relative: bool = False

    @property
    def abrupt(self) -> bool:
        """Whether a small magnitude already has an effect that its derivative at the null does not describe.

        With the least delay, a reading is taken before the command of its row instead of just after it.
        """
        return self.shift or not self.gradual

    def value(self, coordinate: float) -> float:
        """The parameter's value at a coordinate."""
        if self.relative:
            return exp(coordinate)
        if not self.inverse:
            return coordinate
        return inf if coordinate <= 0 else 1 / coordinate

    def coordinate(self, value: float) -> float:
        """The coordinate at which the parameter has this value."""
        if self.relative:
            return log(max(value, float_info.min))
        return 1 / value if self.inverse else value

    def relatively(self) -> Axis:
        """The axis with its prior on the logarithm, where the parameter is positive: 5 m +- 20 % is never 0 m.

        With 5 m +- 1 m, a length of 5 cm, or no inertia, would cost as little as one that is twice as large.
        """
        if self.inverse or not (self.low >= 0 and self.mean > 0):
            return self
        new = replace(self, relative=True)
        null, low, high, mean = (new.coordinate(item) for item in (self.null, self.low, self.high, self.mean))
        sd = self.sd / self.mean
        return replace(new, null=null, low=low, high=high, mean=mean, sd=sd, scale=sd)


@dataclass(frozen=True)
class ActingRows:
    """Where an effect acts that begins or ends within recordings.

    Attributes
    ----------
    rows : of all N.
    recording, run : name of the recording in which it begins or ends, and number of the run, from 1.
    since, until : s of the recording's time; None where it acts from the start, or to the end.
    """

    rows: slice
    recording: str
    run: int = 1
    since: float | None = None
    until: float | None = None

    @property
    def lasts(self) -> bool:
        """Whether it still acts at the end, and so after the recordings."""
        return self.until is None


@dataclass(frozen=True)
class Candidate:
    """An effect that may be the cause, or one of its forms: second parameters may be held.

    Attributes
    ----------
    effect : its name.
    axes : its magnitude first, then second parameters.
    gradual : whether the derivative at the null describes larger magnitudes.
    part : where it acts; None: everywhere.
    never_beside : effects that are other forms of it.
    reads : outputs on which it acts, where it changes only what sensors read; empty: it acts on the motion.
    """

    effect: str
    axes: tuple[Axis, ...]
    gradual: bool = True
    part: ActingRows | None = None
    never_beside: frozenset[str] = frozenset()
    reads: frozenset[str] = frozenset()

    @property
    def held(self) -> tuple[float, ...]:
        """Coordinates of second parameters that are held: they define the form of the effect."""
        return tuple(axis.low for axis in self.axes[1:] if axis.low == axis.high)

    @property
    def free(self) -> int:
        """Number of axes that are estimated."""
        return len(self.axes) - len(self.held)


def nuisances(model: Diagnosed, effects: Mapping[str, Effect], shifting: frozenset[str]) -> tuple[Axis, ...]:
    """Parameters of the model that have a prior: those with tolerances in a vehicle file."""
    sudden = {effect.parameter.name for effect in effects.values() if not effect.gradual}
    result = []
    for index, parameter in scalars(model):
        if not parameter.fixed and parameter.prior is not None:
            axis = _axis(parameter, index, parameter.name in shifting)
            sd, mean = float(np.asarray(parameter.prior.sd)), parameter.prior.mean
            at = axis.null if mean is None else float(np.asarray(mean))
            result.append(
                replace(
                    axis,
                    mean=at,
                    sd=sd,
                    scale=sd,
                    gradual=parameter.name not in sudden,
                    narrow=parameter.source == ZONE,
                )
            )
    return tuple(result)


def candidates(model: Diagnosed, effects: Mapping[str, Effect], shifting: frozenset[str]) -> tuple[Candidate, ...]:
    """Effects of the model that may be the cause.

    Parameters
    ----------
    model : with all of the effects.
    effects : those whose magnitude may differ from its value in the model.
    shifting : names of parameters on which delays or latencies depend.
    """
    places = {parameter.name: (index, parameter) for index, parameter in scalars(model)}
    result = []
    for name, effect in effects.items():
        index, parameter = places[effect.parameter.name]
        main = _axis(parameter, index, effect.parameter.name in shifting, effect.typical)
        seconds = [_second(*places[other.name]) for other in effect.others]
        if any(second.unit == "rad" for second in seconds):  # with a direction, the magnitude has no sign
            main = replace(main, low=max(main.low, 0.0))
        gradual, instead_of = effect.gradual and not main.shift, frozenset(effect.instead_of)
        for form in product(*map(_forms, seconds)):
            result.append(Candidate(name, (main, *form), gradual, never_beside=instead_of, reads=_reads(effect, model)))
    return tuple(result)


def _reads(effect: Effect, model: Diagnosed) -> frozenset[str]:
    """Outputs on which an effect of a sensor acts; none where the motion takes one of these signals as an input."""
    touched = {*effect.touches}
    only_read = effect.reads_only and touched.isdisjoint(model.inputs)
    return frozenset(touched & {*model.outputs}) if only_read else frozenset()


def shifting(model: Diagnosed) -> frozenset[str]:
    """Parameters on which delays or latencies depend, by evaluating all of them; maps with memory have none."""
    if isinstance(model, MemoryModel):
        return frozenset()
    requested: set[str] = set()

    class Asked(SimpleNamespace):
        def __getattr__(self, name: str) -> float:
            requested.add(name)
            return 0.0

    for _, by in (*model.delays, *model.latencies):
        by(Asked())
    return frozenset(requested)


def scalars(model: Diagnosed) -> list[tuple[int, Parameter]]:
    """A model's parameters that are single numbers, each with its place in the vector of all."""
    result, index = [], 0
    for parameter in model.parameters:
        if parameter.shape == ():
            result.append((index, parameter))
        index += parameter.size
    return result


def _axis(parameter: Parameter, index: int, shift: bool, typical: float | None = None) -> Axis:
    value, (low, high) = float(parameter.array), parameter.bounds
    inverse = isinf(value)
    if inverse:
        null, low, high = 0.0, 0.0, 1 / float(np.asarray(low))
    else:
        null, low, high = value, float(np.asarray(low)), float(np.asarray(high))
    scale = abs(1 / typical if inverse else typical - null) if typical is not None else abs(value) or 1.0
    return Axis(parameter.name, parameter.unit, index, inverse, null, low, high, null, inf, scale, shift)


def _forms(second: Axis) -> tuple[Axis, ...]:
    """A second parameter in its forms: a share is held at none and at all, any other one is free."""
    if (second.low, second.high) != SHARE:
        return (second,)
    return tuple(replace(second, null=at, low=at, high=at) for at in SHARE)


def _second(index: int, parameter: Parameter) -> Axis:
    """A second parameter: free within a factor, or in any direction."""
    axis = _axis(parameter, index, False)
    return replace(axis, scale=0.1 if axis.unit == "rad" else 0.1 * abs(axis.null))
