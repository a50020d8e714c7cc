"""The model that a user requests: name, vehicle, settings, effects; fixed and free parameters, priors, starts."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from math import isfinite
from typing import Any

from ..base.errors import BadInput, near_or_all
from ..base.numbers import the_recordings
from ..base.signals import unit_of
from ..base.units import Quantity, belief, number
from ..datasets.checks.consistency import GIVEN_WHEELBASE
from ..datasets.checks.pairs import agreement, pairs
from ..datasets.recording import Recording
from ..models.effect import AnyModel
from ..models.effects import EFFECTS
from ..models.memory_model import MemoryModel
from ..models.model import Model
from ..models.motion_model import MotionModel
from ..models.parameter import Parameter, Prior, Stated
from ..models.registry import MODELS, build, candidates, vehicle_parameters
from ..models.vehicle import Vehicle, shipped_vehicles
from ..models.vehicle import vehicle as read_vehicle
from ..models.vehicles import with_size

Magnitudes = dict[str, float | Stated | None]
"""Effect -> its magnitude, fixed; its stated value and deviation; None leaves it free."""


@dataclass(frozen=True)
class Choices:
    """A user's choices about a model's parameters.

    Attributes
    ----------
    fix : name -> value at which it is fixed; None fixes its present value.
    free : names of parameters to estimate.
    prior : name -> (mean, sd) or a text such as "6±3"; estimated with that prior, starting at the mean.
    start : name -> value at which its estimation starts.
    per_run : names of parameters with one value for each unbroken run.
    """

    fix: Mapping[str, Quantity | None] = field(default_factory=dict)
    free: Sequence[str] = ()
    prior: Mapping[str, Quantity | tuple[float, float]] = field(default_factory=dict)
    start: Mapping[str, Quantity] = field(default_factory=dict)
    per_run: Sequence[str] = ()

    @property
    def named(self) -> frozenset[str]:
        """All parameters named in the choices."""
        return frozenset((*self.fix, *self.free, *self.prior, *self.start, *self.per_run))


def with_choices(model: AnyModel, choices: Choices) -> AnyModel:
    """The model with a user's choices applied.

    Raises
    ------
    BadInput : it has no such parameter, a number cannot be used, or two choices contradict each other.
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
                f"‹start› {name}: {model.name} keeps this parameter fixed; free it with ‹free› {name}, or fix it at "
                f"this value: ‹fix› {name}={given}."
            )
    for name, value_at in choices.fix.items():
        parameter = current(name, "‹fix›", "‹free›", "‹prior›", "‹start›")
        if value_at is not None:
            parameter = _at(parameter, number(value_at, parameter.unit, f"‹fix› {name}"), "‹fix›")
        changed[name] = replace(parameter, fixed=True, prior=None)
    for name in choices.per_run:
        parameter = current(name, "‹per_run›", "‹fix›")
        if parameter.fixed:
            raise BadInput(f"‹per_run› {name}: {model.name} keeps this parameter fixed; free it with ‹free› {name}.")
        changed[name] = replace(parameter, scope="run")
    return _replaced(model, changed)


def magnitudes(written: Sequence[str]) -> Magnitudes:
    """Parse effects and their magnitudes: EFFECT, EFFECT=VALUE[unit] or EFFECT=MEAN±SD[unit]."""
    result: Magnitudes = {}
    for text in written:
        name, equals, value = (part.strip() for part in text.partition("="))
        if name not in EFFECTS:
            raise BadInput(
                f"There is no effect {name!r}.{near_or_all(name, EFFECTS)} greybox effects lists all of them."
            )
        if name in result:
            raise BadInput(f"‹effects› {name} is there twice; omit one of them.")
        if not equals:
            result[name] = None
            continue
        stated = belief(value, EFFECTS[name].parameter.unit, f"‹effects› {name}")
        result[name] = stated.value if stated.sd is None else Stated(stated.value, stated.sd, source="given")
    return result


def believed(effects: Magnitudes, vehicle: Vehicle | None) -> Magnitudes:
    """The effects, free ones with the vehicle's stated magnitudes, if any."""
    stated = vehicle.effects if vehicle is not None else {}
    return {name: stated.get(name) if effect is None else effect for name, effect in effects.items()}


def started(model: AnyModel, effects: Magnitudes) -> AnyModel:
    """The model with free effects at typical magnitudes: at their null many have a zero derivative."""
    new = {}
    for name, effect in effects.items():
        if isinstance(effect, Stated) and name in model and name in EFFECTS:
            parameter, null = model[name], EFFECTS[name].parameter.array
            if not parameter.fixed and parameter.array == null:
                typical = min(max(EFFECTS[name].typical, parameter.bounds[0]), parameter.bounds[1])
                new[name] = parameter.with_value(typical)
    return _replaced(model, new)


def free_effects_suit(model: Model, effects: Mapping[str, object]) -> None:
    """Raise `BadInput` if effects without a fixed magnitude are requested of a model with memory."""
    free = [name for name, effect in effects.items() if effect is None or isinstance(effect, Stated)]
    if free and isinstance(model, MemoryModel):
        unit = EFFECTS[free[0]].parameter.unit
        raise BadInput(
            f"‹effects› {free[0]}: {model.name} is a model with memory, in which effects are kept fixed; state the "
            f"magnitude, in {unit}: ‹effects› {free[0]}=VALUE."
        )


def state_values(given: Mapping[str, Quantity], model: Model) -> dict[str, float]:
    """Initial states of a simulation, in SI.

    Raises
    ------
    BadInput : the model has no such state, or its value is not finite.
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
    """The vehicle from a file or of a shipped name; None without a name."""
    return None if name is None else read_vehicle(name, vehicle_parameters(), EFFECTS)


def completed(
    name: str | None, settings: Mapping[str, Any], effects: Magnitudes, vehicle: Vehicle | None
) -> tuple[str, dict[str, Any], Magnitudes]:
    """Name, settings and effects of the requested model; the vehicle's model if none is named.

    Raises
    ------
    BadInput : neither is given.
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
        f"{option} {name}: {model.name} has no parameter {name}.{near_or_all(name, names)} See greybox models "
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
            f"{option} {parameter.name}: {value:g}{unit} is outside the range that models accept, {limits}. Check "
            f"its unit."
        )
    return parameter.with_value(value)


def _replaced(model: AnyModel, changed: Mapping[str, Parameter]) -> AnyModel:
    """The model, and its parts, with parameters replaced."""
    changed_model = model.with_parameters(*(p for name, p in changed.items() if name in model))
    return replace(changed_model, parts=tuple(_replaced(part, changed) for part in changed_model.parts))


VEHICLES_OF_MAPS = {"roboracer": "roboracer", "truck": "truck", "revs_250lm": "ferrari_250lm", "dart": "dart"}
"""Column map -> shipped vehicle of its recordings."""
FAR_OFF = 3.0
"""Factor between stated and expected force per unit beyond which the force belongs to another signal."""


@dataclass(frozen=True)
class RequestedModel:
    """A user's request for a model.

    Attributes
    ----------
    name : model's name; None takes the vehicle's model.
    vehicle : source of the starting values; None keeps the model's own.
    settings : hyperparameters as plain data.
    effects : effects to add, with their magnitudes.
    choices : choices about its parameters.
    """

    name: str | None
    vehicle: Vehicle | None = None
    settings: Mapping[str, Any] = field(default_factory=dict)
    effects: Magnitudes = field(default_factory=dict)
    choices: Choices = field(default_factory=Choices)

    def models(self, training: Recording) -> list[Model]:
        """The models to fit: several if the settings leave a choice to cross-validation."""
        name, settings, effects = completed(self.name, self.settings, self.effects, self.vehicle)
        result = candidates(name, training, settings, effects, self.vehicle)
        return [self._chosen(model, effects) for model in result]

    def model(self) -> Model:
        """The model to simulate: an effect stated at its null stays there, though a fit would start elsewhere."""
        name, settings, effects = completed(self.name, self.settings, self.effects, self.vehicle)
        return self._chosen(build(name, settings, effects, self.vehicle), effects, at_stated=True)

    def or_single_track(self) -> RequestedModel:
        """The request, with a single track if neither a model nor a vehicle's model is named."""
        is_open = self.name is None and self.vehicle is not None and self.vehicle.model is None
        return replace(self, name="single_track") if is_open else self

    def _chosen(self, model: Model, effects: Magnitudes, at_stated: bool = False) -> Model:
        free_effects_suit(model, effects)
        stated = {name for name, effect in effects.items() if isinstance(effect, Stated) and effect.value is not None}
        moved = {name: effect for name, effect in effects.items() if not at_stated or name not in stated}
        chosen = with_choices(started(model, moved), self.choices)
        return chosen if self.vehicle is not None else with_size(chosen, self.choices.named)


def must_be_recorded(model: Model, recordings: Sequence[Recording]) -> None:
    """Raise `BadInput` if a recording's time does not increase, or if it lacks an input of a motion model.

    The message names models for which the recording suffices.
    """
    for recording in recordings:
        recording.must_run()
    if not isinstance(model, MotionModel):
        return
    for recording in recordings:
        lacking = _lacking(model, recording)
        if not lacking:
            continue
        others = [build(name) for name in MODELS]
        others = [other for other in others if isinstance(other, MotionModel) and not _lacking(other, recording)]
        would_do = [other.name for other in others if any(name in recording for name in other.outputs)]
        signal_names = " and ".join(" or ".join(model.aliases.get(name, (name,))) for name in lacking)
        instead = (
            f" Or choose another model: the signals suffice for {' and '.join(would_do)} (‹model›)." if would_do else ""
        )
        raise BadInput(
            f"{recording.name} lacks {signal_names}, which {model.name} needs; it has {', '.join(recording.signals)}. "
            f"Name the column of {signal_names} in the column map (‹columns›).{instead}"
        )


def doubts(model: Model, vehicle: Vehicle | None, recordings: Sequence[Recording]) -> list[str]:
    """Sentences on a motion model whose nominal parameters may not be those of the recorded vehicle."""
    if not isinstance(model, MotionModel):
        return []
    result = []
    maps = {recording.source.columns for recording in recordings}
    shipped = [VEHICLES_OF_MAPS[name] for name in sorted(maps) if name in VEHICLES_OF_MAPS]
    suggested = next(
        (f" (the vehicle {name} comes with greybox)" for name in shipped if name in shipped_vehicles()), ""
    )
    if vehicle is None and (size := _size(model)):  # a model without mass and wheelbase, an actuator, is no vehicle
        start = f"{model.name} starts from its default values ({size})"
        result.append(
            f"No vehicle is named: {start}. Name one{suggested}, or a file with the values of your vehicle; greybox "
            f"models {model.name} writes a file to start from."
        )
    if "l_f" in model and "l_r" in model:
        wheelbase = float(model["l_f"].array + model["l_r"].array)
        for recording in recordings:
            seen = _wheelbase(recording)
            if seen is not None and not GIVEN_WHEELBASE[0] < seen / wheelbase < GIVEN_WHEELBASE[1]:
                result.append(
                    f"According to {the_recordings([recording.name])}, the vehicle has a wheelbase of {seen:.2g} m; "
                    f"the model has {wheelbase:.3g} m (l_f + l_r). Is it the wrong vehicle, or is a unit in the column "
                    "map wrong?"
                    f"{suggested}"
                )
                break
    return result + doubts_of_drive(model, recordings)


def doubts_of_drive(model: Model, recordings: Sequence[Recording]) -> list[str]:
    """A sentence if the force per unit of the drive signal cannot belong to the recorded signal.

    One unit of a force is one newton, one unit of a commanded acceleration the vehicle's mass in newtons.
    """
    if not isinstance(model, MotionModel) or "force_per_unit" not in model or "m" not in model:
        return []
    stated = float(model["force_per_unit"].array)
    force_of = {"drive_force": 1.0, "ax_cmd": float(model["m"].array)}
    for recording in recordings:
        signal = next((item for item in model.aliases.get("drive", ()) if item in recording), "")
        if signal in force_of and not 1 / FAR_OFF < stated / force_of[signal] < FAR_OFF:
            unit = unit_of(signal)
            return [
                f"{recording.name} holds {signal} in {unit}, one unit of which is about {force_of[signal]:.4g} N, but "
                f"the model has force_per_unit = {stated:.4g} N: fix force_per_unit at {force_of[signal]:.4g}, or "
                "name another signal in the column map."
            ]
    return []


def _lacking(model: MotionModel, recording: Recording) -> list[str]:
    return [
        name
        for name in model.inputs
        if name not in model.defaults and not any(item in recording for item in model.aliases.get(name, (name,)))
    ]


def _size(model: MotionModel) -> str:
    """A vehicle's mass and wheelbase in words; empty where a model has neither."""
    known = []
    if "m" in model:
        known.append(f"m = {float(model['m'].array):g} kg")
    if "l_f" in model and "l_r" in model:
        known.append(f"l_f + l_r = {float(model['l_f'].array + model['l_r'].array):.3g} m")
    return ", ".join(known)


def _wheelbase(recording: Recording) -> float | None:
    """v_x steer / yaw_rate, m, if the recording determines it reliably."""
    for pair in pairs(recording):
        if pair.nodes == ("yaw_rate", "steer"):
            agreed = agreement(recording, pair.left_values, pair.right_values, pair.smoothing)
            if agreed.certain:
                return abs(1.0 / agreed.gain)
    return None
