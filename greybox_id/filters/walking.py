"""What is tracked: from names to a model in which these walk.

    parameters     walk at random, off for good: tyres that warm or wear, a load that shifts
    disturbances   come and go about where they stand: bank and wind, play of the steering

Either may be a parameter of the model; the magnitude of an effect; a combination that a quantity scales, as cornering
stiffness is; a quantity of the equations, as the axle force F_yf, which then takes the place of the tyre model; or an
input that was not recorded, as the driving force, which then follows from the readings alone.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace

import numpy as np

from ..base.errors import BadInput, near_or_all
from ..base.signals import unit_of, unit_of_quantity
from ..models.effect import Effect
from ..models.model import Symbol
from ..models.motion_model import MotionModel, Quantities
from ..models.parameter import Parameter
from .state_space import Tracked

SHARE = 0.2
"""How well a positive parameter is known where nothing is said: this share of itself."""
USUAL = {"N": 3000.0, "N m": 1000.0, "m/s^2": 3.0, "rad": 0.01, "rad/s": 0.02, "A": 20.0, "1": 0.2}
"""How far something else is from its value where nothing is said, by unit."""
GRAVITY = 9.81


def walking(
    model: MotionModel, parameters: Sequence[str], disturbances: Sequence[str], effects: Mapping[str, Effect]
) -> tuple[MotionModel, tuple[Tracked, ...]]:
    """The model with what is to be tracked among its parameters, and how each of them walks.

    Raises
    ------
    BadInput : a name that stands for nothing in this model, or one that is there twice.
    """
    names = [*parameters, *disturbances]
    twice = sorted({name for name in names if names.count(name) > 1})
    if twice:
        raise BadInput(f"{', '.join(twice)} is named twice; name it once.")
    tracked: list[Tracked] = []
    for name in names:
        model, value = _found(model, name, effects)
        if any(other.name == value for other in tracked):
            raise BadInput(f"{name} is named twice: it is {value} by another name; name it once.")
        tracked.append(_tracked(model, value, returns=name in disturbances))
    return model, tuple(tracked)


def trackable(model: MotionModel) -> tuple[str, ...]:
    """Names that can be tracked: scaled combinations, parameters, inputs and quantities."""
    scaled = (combination.name for combination in model.combinations if combination.scaled_by)
    numbers = (parameter.name for parameter in model.parameters if parameter.shape == ())
    return tuple(dict.fromkeys((*scaled, *numbers, *model.inputs, *model.quantities)))


def _found(model: MotionModel, name: str, effects: Mapping[str, Effect]) -> tuple[MotionModel, str]:
    """The model with a parameter that stands for what is named, and the parameter's name."""
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
        factor = Parameter(scaled, "1", 1.0, (1e-3, 1e3), about=f"{name} over its nominal value")
        return model.with_parameters(factor).altered(**{scaled: _scaling(scaled)}), scaled
    if name in model.inputs:
        signals = model.aliases.get(name, (name,))
        free = replace(model, defaults={**model.defaults, name: 0.0})
        same = next((signal for signal in signals if signal in model.quantities), "")
        if same:  # what the input leads to, in a unit that needs no factor
            return _found(free, same, effects)
        return free.with_parameters(Parameter(name, unit_of(signals[0]), 0.0)).altered(**{name: _given(name)}), name
    if name in model.quantities:
        parameter = Parameter(name, unit_of_quantity(name), 0.0, about="in place of what the equations say")
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
    entry = model[name]
    value = float(entry.array)
    positive = entry.bounds[0] >= 0 and value > 0
    sd = SHARE * value if positive else _usual(model, entry)
    if entry.prior is not None and np.isfinite(float(np.asarray(entry.prior.sd))):
        sd = float(np.asarray(entry.prior.sd))
    return Tracked(name, entry.unit, value, sd, logarithmic=positive, returns=returns)


def _usual(model: MotionModel, parameter: Parameter) -> float:
    if parameter.unit == "N" and "m" in model:
        return 0.3 * float(model["m"].array) * GRAVITY
    return USUAL.get(parameter.unit, max(abs(float(parameter.array)), 1.0))
