"""What a user chooses about a model, as written: numbers with units, what is held, free, believed or started from."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from math import isfinite
from typing import Any

from ...base.errors import BadInput, near_or_all
from ...base.signals import unit_of
from ...base.units import to_si
from ...models.effect import AnyModel
from ...models.effects import EFFECTS
from ...models.memory_model import MemoryModel
from ...models.model import Model
from ...models.parameter import Parameter, Prior
from ...models.registry import MODELS, vehicle_parameters
from ...models.vehicle import Stated, Vehicle
from ...models.vehicle_file import vehicle as read_vehicle

_NUMBER = r"[+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?|[+-]?inf(?:inity)?"
_WRITTEN = re.compile(rf"\s*({_NUMBER})\s*(.*?)\s*", re.IGNORECASE)


@dataclass(frozen=True)
class Belief:
    """A number as written, in its SI unit: value, and standard deviation where one was written."""

    value: float
    sd: float | None = None


def named(pair: str, what: str) -> tuple[str, str]:
    """NAME and what is written behind its equals sign."""
    name, equals, text = pair.partition("=")
    if not equals or not name.strip() or not text.strip():
        raise BadInput(f"{pair!r} is not {what}.")
    return name.strip(), text.strip()


def number(text: str, unit: str, where: str) -> float:
    """A number with or without a unit, in SI.

    Parameters
    ----------
    text : "3.5", "3.5kg", "30 ms".
    unit : the SI unit of what it stands for, which a bare number is taken to be in.
    where : what it stands for, for the sentence of an error.

    Raises
    ------
    BadInput : it is no number, or its unit measures something else.
    """
    value, written = _split(text, where)
    factor, offset = _conversion(written, unit, where)
    return factor * value + offset


def belief(text: str, unit: str, where: str) -> Belief:
    """A number that may have a standard deviation: "6", "6±3", "6+-3 1/rad", "6 +/- 3", "31±3 ms".

    The unit stands at the end, for both; where each has its own, both count.

    Raises
    ------
    BadInput : one of the two is no number, a unit measures something else, or the standard deviation is not above zero.
    """
    mean, *rest = re.split(r"\s*(?:±|\+/-|\+-)\s*", text.strip())
    if not rest:
        return Belief(number(mean, unit, where))
    if len(rest) > 1:
        raise BadInput(f"{where}: {text!r} is not MEAN±SD, as in 6±3.")
    (value, entry), (sd, written) = _split(mean, where), _split(rest[0], where)
    factor, offset = _conversion(entry or written, unit, where)
    spread = _conversion(written, unit, where)[0] * sd
    if not (spread > 0 and isfinite(spread)):
        raise BadInput(f"{where}: the standard deviation in {text!r} must be a number above zero.")
    if not isfinite(value):
        raise BadInput(f"{where}: the mean in {text!r} must be a finite number.")
    return Belief(factor * value + offset, spread)


def _split(text: str, where: str) -> tuple[float, str]:
    """The number, and the unit behind it."""
    result = _WRITTEN.fullmatch(text.replace("−", "-"))
    if result is None:
        raise BadInput(f"{where}: {text!r} is no number; write 3.5 or, with a unit, 3.5kg.")
    return float(result[1]), result[2]


def _conversion(written: str, unit: str, where: str) -> tuple[float, float]:
    """Factor and offset to the SI unit."""
    if not written or written == unit:
        return 1.0, 0.0
    try:
        result = to_si(written, unit)
    except BadInput as error:
        raise BadInput(f"{where}: {error}.") from error
    return result.factor, result.offset


Magnitudes = dict[str, float | Stated | None]
"""Effect -> its magnitude, held; what is believed of it; None leaves it free."""


@dataclass(frozen=True)
class Choices:
    """What is said of a model's parameters, each as written.

    Attributes
    ----------
    fix : NAME holds it where it stands, NAME=VALUE[unit] there.
    free : NAME is estimated.
    prior : NAME=MEAN±SD[unit] is estimated, with that belief, starting at the mean.
    start : NAME=VALUE[unit] is where its estimation starts.
    per_run : NAME has one value for each unbroken run.
    """

    fix: Sequence[str] = ()
    free: Sequence[str] = ()
    prior: Sequence[str] = ()
    start: Sequence[str] = ()
    per_run: Sequence[str] = ()

    @property
    def named(self) -> frozenset[str]:
        """The parameters that anything is said of."""
        stated = (*self.fix, *self.free, *self.prior, *self.start, *self.per_run)
        return frozenset(item.partition("=")[0].strip() for item in stated)


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
    for pair in choices.prior:
        name, text = named(pair, "NAME=MEAN±SD, as in ‹prior› B_f=6±3")
        parameter = current(name, "‹prior›")
        known = belief(text, parameter.unit, f"‹prior› {name}")
        if known.sd is None:
            raise BadInput(f"‹prior› {pair}: how well is it known? Write NAME=MEAN±SD (or +-), or ‹fix› {pair}.")
        moved = _at(parameter, known.value, "‹prior›")
        changed[name] = replace(moved, prior=Prior(known.sd, mean=known.value), fixed=False)
    for pair in choices.start:
        name, text = named(pair, "NAME=VALUE, as in ‹start› I_z=0.05")
        parameter = current(name, "‹start›")
        changed[name] = _at(parameter, number(text, parameter.unit, f"‹start› {name}"), "‹start›")
        if parameter.fixed:
            raise BadInput(f"‹start› {name}: {model.name} holds it; add ‹free› {name}, or hold it there: ‹fix› {pair}.")
    for pair in choices.fix:
        name = pair.partition("=")[0].strip()
        parameter = current(name, "‹fix›", "‹free›", "‹prior›", "‹start›")
        if "=" in pair:
            _, text = named(pair, "NAME or NAME=VALUE, as in ‹fix› m=3.5kg")
            parameter = _at(parameter, number(text, parameter.unit, f"‹fix› {name}"), "‹fix›")
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


def noise_of(written: Sequence[str], model: Model) -> dict[str, float]:
    """Standard deviations of outputs' readings, NAME=SD[unit]."""
    result = {}
    for pair in written:
        name, text = named(pair, "NAME=SD, as in ‹noise› yaw_rate=0.01")
        if name not in model.outputs:
            raise BadInput(f"‹noise› {name}: {model.name} has no output {name}.{near_or_all(name, model.outputs)}")
        result[name] = number(text, unit_of(name), f"‹noise› {name}")
        if not 0 < result[name] < float("inf"):
            raise BadInput(f"‹noise› {pair}: a standard deviation is a number above zero.")
    return result


def state_values(written: Sequence[str], model: Any) -> dict[str, float]:
    """States at the start of a simulation, NAME=VALUE[unit]."""
    units = {state.name: state.unit for state in model.states}
    result = {}
    for pair in written:
        name, text = named(pair, "NAME=VALUE, as in ‹start_state› v_x=10")
        if name not in units:
            raise BadInput(f"‹start_state› {name}: {model.name} has no state {name}.{near_or_all(name, units)}")
        result[name] = number(text, units[name], f"‹start_state› {name}")
        if not abs(result[name]) < float("inf"):
            raise BadInput(f"‹start_state› {pair}: a state is a finite number.")
    return result


def wanted_vehicle(name: str | None) -> Vehicle | None:
    """The vehicle of a file or of a shipped name; None where none is named."""
    return None if name is None else read_vehicle(name, vehicle_parameters(), EFFECTS)


def wanted_model(
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
