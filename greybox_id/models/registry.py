"""Models and effects by name, and how to build them from plain data."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any

from ..effect import Effect
from ..errors import BadInput, near
from ..model import Model
from ..recording import Recording
from ..vehicle import Stated, Vehicle
from .effects import EFFECTS
from .hybrid import HybridSettings, covering_hybrid, hybrid_force, hybrid_stiffness
from .kinematic import KinematicSettings, kinematic
from .lateral import lateral
from .longitudinal import longitudinal
from .msnn_full import FullSettings, covering_full, msnn_full
from .msnn_full_plus import PlusSettings, alternatives_plus, covering_plus, msnn_full_plus
from .msnn_lat import LateralSettings, covering_lat, msnn_lat
from .msnn_long import LongitudinalSettings, covering_long, msnn_long
from .settings import NoSettings, from_mapping
from .single_track import single_track
from .tyres import TYRES
from .tyres.settings import TyreSettings
from .vehicles import stated_effect, with_vehicle

__all__ = [
    *("EFFECTS", "MODELS", "Entry", "Magnitudes"),
    *("build", "candidates", "model_of", "prepared", "vehicle_parameters", "with_effects"),
]

Magnitudes = Mapping[str, float | Stated | None]
"""Effect name -> its magnitude, held; None leaves it free, starting at its typical value; what is stated of it."""


def _only(settings: Mapping[str, Any]) -> Sequence[Mapping[str, Any]]:
    return (settings,)


def _as_they_are(settings: Any, recording: Recording) -> Any:
    del recording
    return settings


@dataclass(frozen=True)
class Entry:
    """How a model is made.

    Attributes
    ----------
    settings : dataclass of its hyperparameters.
    make : settings -> model.
    alternatives : settings as plain data as a user gave them -> settings that cross-validation may choose between.
    covering : settings, training recording -> settings that cover its range, where they were left open.
    """

    settings: type[Any]
    make: Callable[[Any], Model]
    covering: Callable[[Any, Recording], Any] = _as_they_are
    alternatives: Callable[[Mapping[str, Any]], Sequence[Mapping[str, Any]]] = _only


MODELS: dict[str, Entry] = {
    "single_track": Entry(TyreSettings, lambda settings: single_track(settings.model)),
    "lateral": Entry(TyreSettings, lambda settings: lateral(settings.model)),
    "longitudinal": Entry(NoSettings, lambda settings: longitudinal()),
    "kinematic": Entry(KinematicSettings, kinematic),
    "msnn_lat": Entry(LateralSettings, msnn_lat, covering_lat),
    "msnn_long": Entry(LongitudinalSettings, msnn_long, covering_long),
    "msnn_full": Entry(FullSettings, msnn_full, covering_full),
    "hybrid_stiffness": Entry(HybridSettings, hybrid_stiffness, covering_hybrid),
    "hybrid_force": Entry(HybridSettings, hybrid_force, covering_hybrid),
    "msnn_full_plus": Entry(PlusSettings, msnn_full_plus, covering_plus, alternatives_plus),
}


def build(
    name: str,
    settings: Mapping[str, Any] | None = None,
    effects: Magnitudes | None = None,
    vehicle: Vehicle | None = None,
) -> Model:
    """A model from its name and its settings as plain data, with a vehicle's numbers and with effects added to it.

    Raises
    ------
    BadInput : there is no such model, setting or effect, or a number cannot be used.
    """
    entry = _entry(name)
    return _completed(entry.make(from_mapping(entry.settings, settings or {})), effects, vehicle)


def prepared(
    name: str,
    recording: Recording,
    settings: Mapping[str, Any] | None = None,
    effects: Magnitudes | None = None,
    vehicle: Vehicle | None = None,
) -> Model:
    """A model for a training recording: hyperparameters left open are set to cover the recording's range."""
    entry = _entry(name)
    covering = entry.covering(from_mapping(entry.settings, settings or {}), recording)
    model = build(name, asdict(covering))
    for effect in effects or {}:
        if effect in model.effects:
            raise BadInput(f"Model {name} has the effect {effect} by its own settings; change it there (--set).")
    return _completed(model, effects, vehicle)


def candidates(
    name: str,
    recording: Recording,
    settings: Mapping[str, Any] | None = None,
    effects: Magnitudes | None = None,
    vehicle: Vehicle | None = None,
) -> list[Model]:
    """The models of that name that differ in what the settings leave open; one where they leave nothing open."""
    open_to = _entry(name).alternatives(settings or {})
    return [prepared(name, recording, chosen, effects, vehicle) for chosen in open_to]


def model_of(vehicle: Vehicle, otherwise: str = "single_track") -> Model:
    """The model that a vehicle's file says describes it best, effects included; `otherwise` where that is open."""
    chosen = vehicle.model
    if chosen is None:
        return build(otherwise, vehicle=vehicle)
    return build(chosen.name, chosen.settings, chosen.effects, vehicle)


def vehicle_parameters() -> tuple[str, ...]:
    """Parameters that equations of motion know, on any tyre: what a vehicle may state."""
    tyres = [{"tyre": tyre} for tyre in TYRES]
    known = [build(name, chosen) for name in ("single_track", "lateral") for chosen in tyres]
    known += [build(name) for name in ("longitudinal", "kinematic")]
    return tuple(dict.fromkeys(parameter.name for model in known for parameter in model.parameters))


def _entry(name: str) -> Entry:
    if name not in MODELS:
        raise BadInput(f"There is no model {name!r}; there are {', '.join(MODELS)}.{near(name, MODELS)}")
    return MODELS[name]


def with_effects(model: Model, effects: Magnitudes) -> Model:
    """The model with those effects added that it has not yet.

    Raises `BadInput` for an effect there is not, or a magnitude that cannot be used.
    """
    for name, magnitude in effects.items():
        if name not in model.effects:
            model = model + _effect(name, magnitude)
    return model


def _completed(model: Model, effects: Magnitudes | None, vehicle: Vehicle | None) -> Model:
    return with_effects(model if vehicle is None else with_vehicle(model, vehicle), effects or {})


def _effect(name: str, magnitude: float | Stated | None) -> Effect:
    if name not in EFFECTS:
        raise BadInput(f"There is no effect {name!r}; there are {', '.join(EFFECTS)}.{near(name, EFFECTS)}")
    effect = EFFECTS[name]
    if magnitude is None:
        return effect.starting_at(effect.typical)
    if isinstance(magnitude, Stated):
        return stated_effect(effect, magnitude)
    if isinstance(magnitude, bool) or not isinstance(magnitude, (int, float)):
        raise BadInput(f"Effect {name} needs a number, in {effect.parameter.unit}; {magnitude!r} was given.")
    return effect.at(magnitude)
