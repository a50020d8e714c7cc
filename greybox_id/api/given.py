"""Conversion of arguments to recordings, vehicles, models and names, with error messages."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any, TypeAlias

from ..base.errors import BadInput, must_be_one_of
from ..base.units import pairs
from ..datasets.recording import Recording
from ..fitting.fit import Fit
from ..fitting.requested_model import Choices, RequestedModel, magnitudes, named_vehicle
from ..models.effect import Effect
from ..models.effects import EFFECTS
from ..models.model import Model
from ..models.registry import MODELS, install, is_place, own_effect, own_model
from ..models.vehicle import Vehicle
from .reading import Columns, Recordings, files, of_type, one_recording, recordings

__all__ = ["Columns", "Recordings", "files", "one_recording", "recordings"]

VehicleLike: TypeAlias = Vehicle | str | Path | None
"""A vehicle, the name of a shipped one, or a file."""
ModelLike: TypeAlias = Model | str | RequestedModel
"""A model, its name, or FILE.py:NAME for your own; or a name with vehicle, effects and choices, as in a command."""
NAME_VALUE = "NAME or NAME=VALUE, as in m=3.5kg"
Effects: TypeAlias = str | Effect | Iterable[str | Effect]
"""Effects, or their names as on the command line: "steering_delay", "steering_delay=30ms"."""
Numbers: TypeAlias = Mapping[str, Any]
"""Parameter -> number in the SI unit, or text with a unit: {"m": 3.5} or {"m": "3500 g"}."""


def seen_by(fit: Fit, given: Recordings | None, columns: Columns) -> list[Recording]:
    """The given recordings; if there are none, the training recordings of a fit, if it has them."""
    if given is not None:
        return recordings(given, columns)
    seen = getattr(fit, "seen", None)
    if seen is None:
        raise BadInput("recordings: pass the recordings that the fit was made with.")
    return list(seen("train"))


def vehicle(given: VehicleLike) -> Vehicle | None:
    """The given vehicle; None if there is none."""
    if given is None or isinstance(given, Vehicle):
        return given
    if isinstance(given, str | Path):
        return named_vehicle(str(given))
    raise BadInput(f"vehicle: a Vehicle, a shipped name or a path is needed, not {of_type(given)}.")


def listed(given: str | Iterable[str], argument: str) -> tuple[str, ...]:
    """Names, as a single one or several."""
    several = (given,) if isinstance(given, str) else tuple(given)
    for item in several:
        if not isinstance(item, str):
            raise BadInput(f"{argument}: names are needed, as in {argument}=['I_z'], not {of_type(item)}.")
    return several


def must_be_share(value: object, argument: str) -> None:
    """Raise `BadInput` unless a value is a number between 0 and 1, such as a confidence level."""
    if isinstance(value, bool) or not isinstance(value, int | float) or not 0 < value < 1:
        raise BadInput(f"{argument}: a number between 0 and 1 is needed, such as 0.95, not {value!r:.40}.")


def choices(
    fix: str | Iterable[str] | Numbers = (),
    free: str | Iterable[str] = (),
    prior: Numbers | None = None,
    start: Numbers | None = None,
    per_run: str | Iterable[str] = (),
) -> Choices:
    """Choices on parameters."""
    return Choices(
        fix=fix if isinstance(fix, Mapping) else pairs(listed(fix, "fix"), NAME_VALUE, alone=True),
        free=listed(free, "free"),
        prior=prior or {},
        start=start or {},
        per_run=listed(per_run, "per_run"),
    )


def requested(
    name: str | None,
    vehicle_given: VehicleLike = None,
    settings: Mapping[str, Any] | None = None,
    effects: Effects = (),
    chosen: Choices | None = None,
) -> RequestedModel:
    """The model requested by name, vehicle, effects and choices; None is the vehicle's own model."""
    install()
    if name is not None and is_place(name):
        name = own_model(name).name
    if name is not None:
        must_be_one_of(MODELS, name, "‹model›: there is no model")
    objects, written = named_effects(effects)
    if objects:
        names = ", ".join(item.name for item in objects)
        raise BadInput(f"effects: add {names} to a model, as in gb.models.{name}(...) + gb.effects.{objects[0].name}.")
    chosen = chosen if chosen is not None else Choices()
    return RequestedModel(name, vehicle(vehicle_given), dict(settings or {}), magnitudes(written), chosen)


def model(given: ModelLike | Fit, vehicle_given: VehicleLike = None, effects: Effects = ()) -> Model:
    """The model to simulate."""
    if isinstance(given, Fit):
        return given.model
    if isinstance(given, RequestedModel):
        return given.model()
    if isinstance(given, str):
        objects, written = named_effects(effects)
        return added(requested(given, vehicle_given, None, written).model(), objects)
    if isinstance(given, Model):
        objects, written = named_effects(effects)
        return added(given, objects)
    raise BadInput(f"model: a Model, its name or a Fit is needed, not {of_type(given)}.")


def added(model: Model, effects: Iterable[Effect]) -> Model:
    """A model with added effects."""
    for effect in effects:
        model = model + effect
    return model


def named_effects(given: Effects) -> tuple[list[Effect], list[str]]:
    """Effects given as objects, and effects given by name."""
    several = [given] if isinstance(given, str | Effect) else list(given)
    objects, names = [], []
    for item in several:
        if isinstance(item, Effect):
            objects.append(item)
        elif isinstance(item, str):
            names.append(own_effect(item).name if is_place(item) else item)
        else:
            raise BadInput(f"effects: an Effect or its name is needed, not {of_type(item)}.")
    return objects, names


def effect(name: str) -> Effect:
    """The effect with a name, or of FILE.py:NAME."""
    if not isinstance(name, str):
        raise BadInput(f"effects: an Effect or its name is needed, not {of_type(name)}.")
    if is_place(name):
        return own_effect(name)
    install()
    must_be_one_of(EFFECTS, name, "effects: there is no effect")
    return EFFECTS[name]
