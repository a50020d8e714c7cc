"""Models and effects by name, and how to build them from plain data."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass
from difflib import get_close_matches
from typing import Any

from ..effect import Effect
from ..errors import BadInput
from ..model import Model
from ..recording import Recording
from . import effects as _effects
from .msnn_full import FullSettings, covering_full, msnn_full
from .msnn_full_plus import PlusSettings, alternatives_plus, covering_plus, msnn_full_plus
from .msnn_lat import LateralSettings, covering_lat, msnn_lat
from .msnn_long import LongitudinalSettings, covering_long, msnn_long
from .settings import from_mapping


def _only(settings: Mapping[str, Any]) -> Sequence[Mapping[str, Any]]:
    return (settings,)


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
    covering: Callable[[Any, Recording], Any]
    alternatives: Callable[[Mapping[str, Any]], Sequence[Mapping[str, Any]]] = _only


MODELS: dict[str, Entry] = {
    "msnn_lat": Entry(LateralSettings, msnn_lat, covering_lat),
    "msnn_long": Entry(LongitudinalSettings, msnn_long, covering_long),
    "msnn_full": Entry(FullSettings, msnn_full, covering_full),
    "msnn_full_plus": Entry(PlusSettings, msnn_full_plus, covering_plus, alternatives_plus),
}

EFFECTS: dict[str, Effect] = {
    effect.name: effect for effect in (_effects.steering_rate_limit, _effects.sensor_latency_imu)
}


def build(name: str, settings: Mapping[str, Any] | None = None, effects: Mapping[str, float] | None = None) -> Model:
    """A model from its name, its settings as plain data, and the magnitudes of effects added to it."""
    entry = _entry(name)
    return _with_effects(entry.make(from_mapping(entry.settings, settings or {})), effects or {})


def prepared(
    name: str,
    recording: Recording,
    settings: Mapping[str, Any] | None = None,
    effects: Mapping[str, float] | None = None,
) -> Model:
    """A model for a training recording: hyperparameters left open are set to cover the recording's range."""
    entry = _entry(name)
    covering = entry.covering(from_mapping(entry.settings, settings or {}), recording)
    model = build(name, asdict(covering))
    for effect in effects or {}:
        if effect in model.effects:
            raise BadInput(f"Model {name} has the effect {effect} by its own settings; change it there (--set).")
    return _with_effects(model, effects or {})


def candidates(
    name: str,
    recording: Recording,
    settings: Mapping[str, Any] | None = None,
    effects: Mapping[str, float] | None = None,
) -> list[Model]:
    """The models of that name that differ in what the settings leave open; one where they leave nothing open."""
    return [prepared(name, recording, chosen, effects) for chosen in _entry(name).alternatives(settings or {})]


def _entry(name: str) -> Entry:
    if name not in MODELS:
        raise BadInput(f"There is no model {name!r}; there are {', '.join(MODELS)}.{_near(name, MODELS)}")
    return MODELS[name]


def _with_effects(model: Model, effects: Mapping[str, float]) -> Model:
    for name, value in effects.items():
        if name in model.effects:
            continue
        if name not in EFFECTS:
            raise BadInput(f"There is no effect {name!r}; there are {', '.join(EFFECTS)}.{_near(name, EFFECTS)}")
        effect = EFFECTS[name]
        if isinstance(value, bool) or not isinstance(value, (int, float)):
            raise BadInput(f"Effect {name} needs a number, in {effect.parameter.unit}; {value!r} was given.")
        model = model + effect.at(value)
    return model


def _near(name: str, known: Mapping[str, object]) -> str:
    near = get_close_matches(name, list(known), 1)
    return f" Did you mean {near[0]}?" if near else ""
