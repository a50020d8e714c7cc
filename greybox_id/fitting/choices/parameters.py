"""What a user chooses about a model: numbers, or texts with units; what is held, free, believed or started from."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from math import isfinite
from typing import Any

from ...base.errors import BadInput, near_or_all
from ...base.quantity import Quantity, belief, number
from ...models.effect import AnyModel
from ...models.effects import EFFECTS
from ...models.memory_model import MemoryModel
from ...models.model import Model
from ...models.parameter import Parameter, Prior
from ...models.registry import MODELS, vehicle_parameters
from ...models.vehicle import Stated, Vehicle
from ...models.vehicle_file import vehicle as read_vehicle

Magnitudes = dict[str, float | Stated | None]
"""Effect -> its magnitude, held; what is believed of it; None leaves it free."""


@dataclass(frozen=True)
class Choices:
    """What is said of a model's parameters.

    Attributes
    ----------
    fix : name -> where it is held; None holds it where it stands.
    free : names of those that are estimated.
    prior : name -> (mean, sd) or a text such as "6±3"; estimated with that belief, starting at the mean.
    start : name -> where its estimation starts.
    per_run : names of those that have one value for each unbroken run.
    """

    fix: Mapping[str, Quantity | None] = field(default_factory=dict)
    free: Sequence[str] = ()
    prior: Mapping[str, Quantity | tuple[float, float]] = field(default_factory=dict)
    start: Mapping[str, Quantity] = field(default_factory=dict)
    per_run: Sequence[str] = ()

    @property
    def named(self) -> frozenset[str]:
        """The parameters that anything is said of."""
        return frozenset((*self.fix, *self.free, *self.prior, *self.start, *self.per_run))


def with_choices(model: AnyModel, choices: Choices) -> AnyModel:
    """The model with what is said of its parameters.

    Raises
    ------
    BadInput : it has no such parameter, a number cannot be used, or two things said contradict each other.
    """
    changed: dict[str, Parameter] = {}
    stated: dict[str, str] = {}

    def current(name: str, option: str, *against: str) -> Parameter:
        value = changed.get(name) or _parameter(model, name, option)
        if stated.get(name) in against:
            raise BadInput(f"{option} {name} and {stated[name]} {name} exclude each other; omit one of them.")
        stated[name] = option
        return value

    for name in choices.free:
        changed[name] = replace(current(name, "‹free›"), fixed=False)
    for name, given in choices.prior.items():
        parameter = current(name, "‹prior›")
        known = belief(given, parameter.unit, f"‹prior› {name}")
        if known.sd is None:
            raise BadInput(
                f"‹prior› {name}={given}: how well is it known? Write NAME=MEAN±SD (or +-; (mean, sd) in Python), or "
                f"‹fix› {name}={given}."
            )
        moved = _at(parameter, known.value, "‹prior›")
        changed[name] = replace(moved, prior=Prior(known.sd, mean=known.value), fixed=False)
    for name, given in choices.start.items():
        parameter = current(name, "‹start›")
        changed[name] = _at(parameter, number(given, parameter.unit, f"‹start› {name}"), "‹start›")
        if parameter.fixed:
            raise BadInput(
                f"‹start› {name}: {model.name} holds it; add ‹free› {name}, or hold it there: ‹fix› {name}={given}."
            )
    for name, at in choices.fix.items():
        parameter = current(name, "‹fix›", "‹free›", "‹prior›", "‹start›")
        if at is not None:
            parameter = _at(parameter, number(at, parameter.unit, f"‹fix› {name}"), "‹fix›")
        changed[name] = replace(parameter, fixed=True, prior=None)
    for name in choices.per_run:
        parameter = current(name, "‹per_run›", "‹fix›")
        if parameter.fixed:
            raise BadInput(f"‹per_run› {name}: {model.name} holds it; add ‹free› {name}.")
        changed[name] = replace(parameter, scope="run")
    return _replaced(model, changed)


def magnitudes(written: Sequence[str]) -> Magnitudes:
    """Effects with what is said of their magnitudes: EFFECT, EFFECT=VALUE[unit] or EFFECT=MEAN±SD[unit]."""
    result: Magnitudes = {}
    for text in written:
        name, equals, value = (part.strip() for part in text.partition("="))
        if name not in EFFECTS:
            raise BadInput(f"There is no effect {name!r}.{near_or_all(name, EFFECTS)} All of them: greybox effects.")
        if name in result:
            raise BadInput(f"‹effects› {name} is there twice; omit one of them.")
        if not equals:
            result[name] = None
            continue
        known = belief(value, EFFECTS[name].parameter.unit, f"‹effects› {name}")
        result[name] = known.value if known.sd is None else Stated(known.value, known.sd, source="given")
    return result


def believed(effects: Magnitudes, vehicle: Vehicle | None) -> Magnitudes:
    """Effects left free take what the vehicle states of them."""
    stated = vehicle.effects if vehicle is not None else {}
    return {name: stated.get(name) if effect is None else effect for name, effect in effects.items()}


def started(model: AnyModel, effects: Magnitudes) -> AnyModel:
    """The model with free effects where they are plainly there: at their null many have no derivative to follow."""
    new = {}
    for name, effect in effects.items():
        if isinstance(effect, Stated) and name in model and name in EFFECTS:
            value, null = model[name], EFFECTS[name].parameter.array
            if not value.fixed and value.array == null:
                typical = min(max(EFFECTS[name].typical, value.bounds[0]), value.bounds[1])
                new[name] = value.with_value(typical)
    return _replaced(model, new)


def free_effects_suit(model: Model, effects: Mapping[str, object]) -> None:
    """Raise `BadInput` where effects without a magnitude are asked of a model with memory."""
    free = [name for name, effect in effects.items() if effect is None or isinstance(effect, Stated)]
    if free and isinstance(model, MemoryModel):
        unit = EFFECTS[free[0]].parameter.unit
        raise BadInput(
            f"‹effects› {free[0]}: {model.name} is a model with memory, in which effects are held; say at what "
            f"magnitude, in {unit}: ‹effects› {free[0]}=VALUE."
        )


def state_values(given: Mapping[str, Quantity], model: Model) -> dict[str, float]:
    """States at the start of a simulation, in SI.

    Raises
    ------
    BadInput : the model has no such state, or its value is no finite number.
    """
    what = "‹start_state|start›"
    units = {state.name: state.unit for state in getattr(model, "states", ())}
    result = {}
    for name, value in given.items():
        if name not in units:
            known = near_or_all(name, units) if units else ""
            raise BadInput(f"{what} {name}: {model.name} has no state {name}.{known}")
        result[name] = number(value, units[name], f"{what} {name}")
        if not isfinite(result[name]):
            raise BadInput(f"{what} {name}={value}: a state is a finite number.")
    return result


def named_vehicle(name: str | None) -> Vehicle | None:
    """The vehicle of a file or of a shipped name; None where none is named."""
    return None if name is None else read_vehicle(name, vehicle_parameters(), EFFECTS)


def completed(
    name: str | None, settings: Mapping[str, Any], effects: Magnitudes, vehicle: Vehicle | None
) -> tuple[str, dict[str, Any], Magnitudes]:
    """Name, settings and effects of the model that is meant: the vehicle's own where none is named.

    Raises
    ------
    BadInput : neither names one.
    """
    model = vehicle.model if vehicle is not None else None
    if name is not None:
        return name, dict(settings), believed(effects, vehicle)
    if model is None:
        what = f"Vehicle {vehicle.path or vehicle.name} names no model" if vehicle is not None else "No model is named"
        raise BadInput(f"Which model? {what}; add ‹model›, one of {', '.join(MODELS)}.")
    return model.name, {**model.settings, **settings}, {**model.effects, **believed(effects, vehicle)}


def _parameter(model: Model, name: str, option: str) -> Parameter:
    if name in model:
        return model[name]
    if name in EFFECTS:
        raise BadInput(f"{option} {name}: {model.name} lacks this effect; add it with ‹effects› {name}.")
    names = [parameter.name for parameter in model.parameters]
    raise BadInput(
        f"{option} {name}: {model.name} has no parameter {name}.{near_or_all(name, names)} All of them: greybox models "
        f"{model.name}."
    )


def _at(parameter: Parameter, value: float, option: str) -> Parameter:
    if parameter.shape != ():
        raise BadInput(
            f"{option} {parameter.name}: it is an array of {parameter.size} numbers, which one number cannot replace."
        )
    low, high = parameter.bounds
    if not low <= value <= high:
        unit = "" if parameter.unit == "1" else f" {parameter.unit}"
        limits = f"{low:g} to {high:g}{unit}"
        raise BadInput(
            f"{option} {parameter.name}: {value:g}{unit} is outside what models take for it, {limits}. Check its unit."
        )
    return parameter.with_value(value)


def _replaced(model: AnyModel, changed: Mapping[str, Parameter]) -> AnyModel:
    """The model, and those of its parts that have them, with parameters replaced."""
    value = model.with_parameters(*(p for name, p in changed.items() if name in model))
    return replace(value, parts=tuple(_replaced(part, changed) for part in value.parts))
