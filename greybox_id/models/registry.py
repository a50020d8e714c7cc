"""Models and effects by name, and how to build them from plain data.

A user's models and effects are named by their file, FILE.py:NAME. Naming a file runs it: only a person may do so.
"""

from __future__ import annotations

import hashlib
import re
import sys
import warnings
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import asdict, dataclass, replace
from functools import cache
from importlib.metadata import entry_points
from importlib.util import module_from_spec, spec_from_file_location
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np

from ..base.errors import BadInput, near, near_or_all
from ..base.files import near_file
from ..base.signals import DRIVE_SIGNALS
from ..datasets.recording import Recording
from .baselines import (
    GeneralSettings,
    LateralBenchSettings,
    LongitudinalBenchSettings,
    covering_bench_lat,
    covering_gnn,
    gnn,
    msnn_bench_lat,
    msnn_bench_long,
)
from .effect import AnyModel, Effect
from .effects import EFFECTS
from .form import with_form_error
from .hybrid import HybridSettings, covering_hybrid, hybrid_force, hybrid_stiffness
from .lateral_networks import LateralNetworkSettings, bicycle_mlp, covering_networks, mlp_lateral
from .longitudinal import PARAMETERS, longitudinal
from .model import Model, NoSettings, from_mapping, must_be
from .motion_model import MotionModel
from .msnn_full import (
    FullSettings,
    PlusSettings,
    alternatives_plus,
    covering_full,
    covering_plus,
    msnn_full,
    msnn_full_plus,
)
from .msnn_lat import LateralSettings, covering_lat, msnn_lat
from .msnn_long import LongitudinalSettings, covering_long, msnn_long
from .parameter import Stated
from .single_track import (
    BODY,
    BRAKE,
    BRAKES,
    DRIVE,
    DRIVES,
    MOTOR,
    ROLLING,
    TURNING,
    KinematicSettings,
    kinematic,
    lateral,
    must_stand,
    single_track,
    with_roll,
)
from .steering import steering
from .tyres import TYRES, TyreSettings
from .vehicle import Vehicle
from .vehicles import stated_effect, with_vehicle

__all__ = [
    *("EFFECTS", "MODELS", "Magnitudes", "ModelEntry"),
    *(
        "build",
        "candidates",
        "install",
        "known",
        "model_of",
        "motion_model_of",
        "prepared",
        "register",
        "vehicle_parameters",
        "with_effects",
    ),
]

Magnitudes = Mapping[str, float | Stated | None]
"""Effect name -> magnitude to hold it at; None to estimate it from its typical value; or a `Stated`."""


def _as_they_are(settings: Any, recording: Recording) -> Any:
    del recording
    return settings


@dataclass(frozen=True)
class SingleTrackSettings(TyreSettings):
    """Hyperparameters of the single-track model.

    Attributes
    ----------
    drive : one of `DRIVES`.
    brake : one of `BRAKES`; "auto" chooses by the recording.
    """

    drive: str = "linear"
    brake: str = "auto"

    def __post_init__(self) -> None:
        super().__post_init__()
        _drives(self)


@dataclass(frozen=True)
class DriveSettings:
    """Hyperparameters of the longitudinal model; as in `SingleTrackSettings`."""

    drive: str = "linear"
    brake: str = "auto"

    def __post_init__(self) -> None:
        _drives(self)


def _drives(settings: SingleTrackSettings | DriveSettings) -> None:
    """Raise `BadInput` for an unknown drive or brake."""
    for what, value, known in (("drive", settings.drive, DRIVES), ("brake", settings.brake, ("auto", *BRAKES))):
        if value not in known:
            raise BadInput(f"There is no {what} {value!r}; choose one of {', '.join(known)}.{near(value, known)}")


NEGATIVE = 0.01
"""Share of rows with a negative throttle from which negative throttle is the brake."""


def _braked(settings: SingleTrackSettings | DriveSettings, recording: Recording) -> Any:
    """Settings with the recording's brake: a separate signal, or the negative part of a throttle."""
    if settings.brake != "auto":
        return settings
    brake, throttle = (recording.signals.get(name, np.zeros(1)) for name in ("brake", "throttle"))
    first = next((name for name in DRIVE_SIGNALS if name in recording), "")
    below = first == "throttle" and settings.drive == "linear" and np.mean(throttle < 0) > NEGATIVE
    return replace(settings, brake="separate" if np.nanmax(brake, initial=0) > 0 else "negative" if below else "drive")


def _brake(settings: SingleTrackSettings | DriveSettings) -> str:
    return "drive" if settings.brake == "auto" else settings.brake


@dataclass(frozen=True)
class ModelEntry:
    """Constructor of a model.

    Attributes
    ----------
    settings : dataclass of its hyperparameters.
    make : settings -> model.
    alternatives : the user's settings as plain data -> settings among which cross-validation may choose.
    covering : settings, training recording -> settings with open values set to cover its range.
    own : a user's model, whose settings are fixed.
    """

    settings: type[Any]
    make: Callable[[Any], Model]
    covering: Callable[[Any, Recording], Any] = _as_they_are
    alternatives: Callable[[Mapping[str, Any]], Sequence[Mapping[str, Any]]] = lambda settings: (settings,)
    own: Model | None = None

    def made(self, settings: Mapping[str, Any]) -> Model:
        """The model with hyperparameters as plain data."""
        if self.own is not None and dict(settings) in ({}, dict(self.own.settings)):
            return self.own
        return self.make(from_mapping(self.settings, settings))


def _formed(model: MotionModel, settings: TyreSettings) -> MotionModel:
    model = with_form_error(model) if settings.form == "uncertain" else model
    return with_roll(model) if settings.body == "rolling" else model


MODELS: dict[str, ModelEntry] = {
    "single_track": ModelEntry(
        SingleTrackSettings, lambda item: _formed(single_track(item.model, item.drive, _brake(item)), item), _braked
    ),
    "lateral": ModelEntry(TyreSettings, lambda item: _formed(lateral(item.model), item)),
    "longitudinal": ModelEntry(DriveSettings, lambda item: longitudinal(item.drive, _brake(item)), _braked),
    "kinematic": ModelEntry(KinematicSettings, kinematic),
    "steering": ModelEntry(NoSettings, lambda settings: steering()),
    "msnn_lat": ModelEntry(LateralSettings, msnn_lat, covering_lat),
    "msnn_long": ModelEntry(LongitudinalSettings, msnn_long, covering_long),
    "msnn_full": ModelEntry(FullSettings, msnn_full, covering_full),
    "gnn": ModelEntry(GeneralSettings, gnn, covering_gnn),
    "msnn_bench_lat": ModelEntry(LateralBenchSettings, msnn_bench_lat, covering_bench_lat),
    "msnn_bench_long": ModelEntry(LongitudinalBenchSettings, msnn_bench_long),
    "hybrid_stiffness": ModelEntry(HybridSettings, hybrid_stiffness, covering_hybrid),
    "hybrid_force": ModelEntry(HybridSettings, hybrid_force, covering_hybrid),
    "mlp_lateral": ModelEntry(LateralNetworkSettings, mlp_lateral, covering_networks),
    "bicycle_mlp": ModelEntry(LateralNetworkSettings, bicycle_mlp, covering_networks),
    "msnn_full_plus": ModelEntry(PlusSettings, msnn_full_plus, covering_plus, alternatives_plus),
}


def build(
    name: str,
    settings: Mapping[str, Any] | None = None,
    effects: Magnitudes | None = None,
    vehicle: Vehicle | None = None,
) -> Model:
    """A model by name and settings as plain data, with a vehicle's values and with effects added.

    Raises
    ------
    BadInput : there is no such model, setting or effect, or a number is not valid.
    """
    return _completed(_entry(name).made(settings or {}), effects, vehicle)


def prepared(
    name: str,
    recording: Recording,
    settings: Mapping[str, Any] | None = None,
    effects: Magnitudes | None = None,
    vehicle: Vehicle | None = None,
) -> Model:
    """A model for a training recording: open hyperparameters are set to cover the recording's range."""
    entry = _entry(name)
    if entry.own is not None:
        return build(name, settings, effects, vehicle)
    covering = entry.covering(from_mapping(entry.settings, settings or {}), recording)
    model = build(name, asdict(covering))
    for effect in effects or {}:
        if effect in model.effects:
            raise BadInput(f"Model {name} has the effect {effect} from its settings; change it there (‹settings›).")
    return _completed(model, effects, vehicle)


def candidates(
    name: str,
    recording: Recording,
    settings: Mapping[str, Any] | None = None,
    effects: Magnitudes | None = None,
    vehicle: Vehicle | None = None,
) -> list[Model]:
    """The models of that name that differ in what the settings leave open; a single one if nothing is open."""
    open_to = _entry(name).alternatives(settings or {})
    return [prepared(name, recording, chosen, effects, vehicle) for chosen in open_to]


def model_of(vehicle: Vehicle, otherwise: str = "single_track") -> Model:
    """The model in a vehicle's file, including effects; `otherwise` if the file has none."""
    chosen = vehicle.model
    if chosen is None:
        return build(otherwise, vehicle=vehicle)
    return build(chosen.name, chosen.settings, chosen.effects, vehicle)


def motion_model_of(vehicle: Vehicle) -> MotionModel:
    """The motion model of a vehicle. Raises `BadInput` if it is of another kind."""
    model = model_of(vehicle)
    return must_be(
        MotionModel, model, f"{vehicle.name}: its model {model.name} has no equations of motion; name single_track."
    )


def vehicle_parameters() -> tuple[str, ...]:
    """Parameters of motion models with any tyre, and second parameters of effects: those that a vehicle may state."""
    tyres = (parameter for tyre in TYRES.values() for axle in "fr" for parameter in tyre.parameters(axle))
    known = (*BODY, *DRIVE, *tyres, *MOTOR, *BRAKE, *ROLLING, *PARAMETERS, *TURNING)
    return tuple(dict.fromkeys((*(parameter.name for parameter in known), *_seconds())))


SHIPPED = frozenset((*MODELS, *EFFECTS))
"""Names reserved for models and effects that greybox-id ships."""
POINTS = ("greybox_id.models", "greybox_id.effects")
"""Groups of entry points by which installed packages provide models and effects."""


def register(model: Model | Effect) -> str:
    """Register a user's model or effect under its name; returns the name.

    Raises
    ------
    BadInput : the name is reserved.
    """
    if not isinstance(model, Model | Effect):
        raise BadInput(f"A model or an effect is needed, not {model!r:.60}.")
    kind = "model" if isinstance(model, Model) else "effect"
    if model.name in SHIPPED:
        raise BadInput(f"Your {kind} is called {model.name}, like one that greybox-id ships; give it another name.")
    if isinstance(model, Model):
        MODELS[model.name] = ModelEntry(NoSettings, lambda settings: model, own=model)
    else:
        EFFECTS[model.name] = model
    return model.name


@contextmanager
def known(*value: Model | Effect) -> Iterator[None]:
    """Register models and effects temporarily: those of a fit that is loaded, reported or exported.

    Shipped names are never replaced: under the name of a model with effects, the registry keeps the equations alone.
    """
    install()  # first, since its registrations are permanent
    models, effects = dict(MODELS), dict(EFFECTS)
    try:
        for one in value:
            if one.name not in SHIPPED:
                register(one)
        yield
    finally:
        for table in (MODELS, EFFECTS):
            table.clear()
        MODELS.update(models)
        EFFECTS.update(effects)


@cache
def install() -> None:
    """Register models and effects of installed packages by entry points; those that fail raise a warning."""
    for group in POINTS:
        for point in entry_points(group=group):
            try:
                register(point.load())
            except Exception as error:  # an error in one package must not affect the others
                warnings.warn(f"{group} {point.name} ({point.value}) cannot be used: {error}", stacklevel=2)


def _entry(name: str) -> ModelEntry:
    if name not in MODELS:
        install()
    if name not in MODELS:
        raise BadInput(f"There is no model {name!r}; choose one of {', '.join(MODELS)}.{near(name, MODELS)}")
    return MODELS[name]


def with_effects(model: AnyModel, effects: Magnitudes) -> AnyModel:
    """The model with those of the effects that it does not have yet.

    Raises `BadInput` for an unknown effect, or a magnitude that is not valid.
    """
    for name, magnitude in effects.items():
        if name not in model.effects:
            model = model + _effect(name, magnitude)
    return model


def _completed(model: Model, effects: Magnitudes | None, vehicle: Vehicle | None) -> Model:
    if vehicle is None:
        return with_effects(model, effects or {})
    completed = with_effects(with_vehicle(model, vehicle), effects or {})
    must_stand(completed)
    seconds = {name: value.value for name, value in vehicle.values.items() if name in _seconds() and name in completed}
    return completed.with_parameters(
        *(completed[name].with_value(value) for name, value in seconds.items() if value is not None)
    )


def _seconds() -> tuple[str, ...]:
    """Second parameters of effects."""
    return tuple(other.name for effect in EFFECTS.values() for other in effect.others)


def _effect(name: str, magnitude: float | Stated | None) -> Effect:
    if name not in EFFECTS:
        install()
    if name not in EFFECTS:
        raise BadInput(f"There is no effect {name!r}; choose one of {', '.join(EFFECTS)}.{near(name, EFFECTS)}")
    effect = EFFECTS[name]
    if magnitude is None:
        return effect.starting_at(effect.typical)
    if isinstance(magnitude, Stated):
        return stated_effect(effect, magnitude)
    if isinstance(magnitude, bool) or not isinstance(magnitude, (int, float)):
        raise BadInput(f"Effect {name} needs a number, in {effect.parameter.unit}; {magnitude!r} was given.")
    return effect.at(magnitude)


_PLACE = re.compile(r"(.+\.py):([^\W\d]\w*)")


def is_place(text: str) -> bool:
    """Whether a text names an object in a user's file: my_car.py:my_model."""
    return _PLACE.fullmatch(text) is not None


def own_model(place: str) -> Model:
    """The model of that name in a file, registered under its own name.

    Parameters
    ----------
    place : FILE.py:NAME, where NAME is a model or a function without arguments that makes one.

    Raises
    ------
    BadInput : the file does not exist or fails to run, or it has no model of that name.
    """
    result = _named(place)
    made = result if isinstance(result, Model) or not callable(result) else _called(result, place)
    if not isinstance(made, Model):
        raise BadInput(
            f"{place} must give a model, but gives {made!r:.60}; name a MotionModel, or a function that makes one."
        )
    register(made)
    return made


def own_effect(place: str) -> Effect:
    """The effect of that name in a file, registered under its own name. Raises `BadInput` as `own_model` does."""
    result = _named(place)
    if not isinstance(result, Effect):
        raise BadInput(
            f"{place} must give an effect, but gives {result!r:.60}; make one with gb.effects.alteration or "
            "gb.effects.Effect."
        )
    register(result)
    return result


def own(place: str) -> Model | Effect:
    """The model or effect of that name in a file, registered. Raises `BadInput` as `own_model` does."""
    return own_effect(place) if isinstance(_named(place), Effect) else own_model(place)


def _named(place: str) -> object:
    match = _PLACE.fullmatch(place)
    if match is None:
        raise BadInput(f"{place!r} is not FILE.py:NAME, as in my_car.py:my_model.")
    file, name = Path(match[1]), match[2]
    module = _loaded(file)
    if not hasattr(module, name):
        there = [name for name, thing in vars(module).items() if isinstance(thing, Model | Effect)]
        raise BadInput(
            f"{file} has no {name}.{near_or_all(name, there) if there else ' It has no model and no effect.'}"
        )
    return getattr(module, name)


def _loaded(file: Path) -> ModuleType:
    """The file executed as a module, once per content."""
    try:
        content = file.read_bytes()
    except OSError as error:
        raise BadInput(f"{file} cannot be read ({error.strerror}).{near_file(file)}") from error
    called = f"own_{hashlib.sha256(str(file.resolve()).encode() + content).hexdigest()[:16]}"
    if called in sys.modules:
        return sys.modules[called]
    spec = spec_from_file_location(called, file)
    assert spec is not None
    assert spec.loader is not None
    module = sys.modules[called] = module_from_spec(spec)
    try:
        spec.loader.exec_module(module)
    except (Exception, SystemExit) as error:
        del sys.modules[called]
        raise _failed(file, error) from error
    return module


def _failed(file: Path, error: BaseException) -> BadInput:
    return BadInput(f"{file}{_line_of(error, file)}: {type(error).__name__}: {error}")


def _called(function: object, place: str) -> object:
    assert callable(function)
    try:
        return function()
    except TypeError as error:
        raise BadInput(f"{place} cannot be called without arguments: {error}") from error
    except (Exception, SystemExit) as error:
        raise _failed(Path(place.rpartition(":")[0]), error) from error


def _line_of(error: BaseException, file: Path) -> str:
    """The line of the file at which the error occurred, in words."""
    if isinstance(error, SyntaxError):
        return f", line {error.lineno}"
    line, trace = None, error.__traceback__
    while trace is not None:
        if trace.tb_frame.f_code.co_filename == str(file.absolute()):
            line = trace.tb_lineno
        trace = trace.tb_next
    return f", line {line}" if line else ""
