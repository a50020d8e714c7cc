"""What a diagnosis was made with, and its file."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

from ...base.declared import of_plain
from ...base.saved import Kind
from ...fitting.provenance import DataRecord
from ...gap.gap import Gap
from ...models.effects import EFFECTS
from ...models.model import Model
from ...models.vehicle import Vehicle
from .plain_data import as_plain_data, from_plain_data

KIND = Kind("greybox-gap", 1, "a diagnosis", "greybox gap", "diagnose again")


@dataclass(frozen=True)
class Number:
    """One number as it was stated: `sd` None where it is exact, `value` None for a tolerance about no effect."""

    name: str
    value: float | None
    sd: float | None
    unit: str
    source: str


@dataclass(frozen=True)
class Made:
    """What a diagnosis was made with.

    Attributes
    ----------
    vehicle : its name.
    command : what reproduces it.
    seed, version : of everything random; greybox-id's own.
    data : recordings, those held out in the role "validate".
    settings : from which the model was built.
    effects : of that model, with their magnitudes.
    stated : numbers of the vehicle that the model has, and tolerances on effects.
    """

    vehicle: str
    command: str
    seed: int
    version: str
    data: tuple[DataRecord, ...] = ()
    settings: Mapping[str, Any] = field(default_factory=dict)
    effects: Mapping[str, float] = field(default_factory=dict)
    stated: tuple[Number, ...] = ()


def stated_numbers(vehicle: Vehicle, model: Model) -> tuple[Number, ...]:
    """What is stated of a vehicle that its model has, and tolerances on effects."""
    numbers = [
        Number(name, value.value, value.sd, model[name].unit, value.source)
        for name, value in vehicle.values.items()
        if name in model and model[name].shape == ()
    ]
    tolerances = [
        Number(name, effect.value, effect.sd, EFFECTS[name].parameter.unit, effect.source)
        for name, effect in vehicle.effects.items()
        if name in EFFECTS and effect.sd is not None
    ]
    return (*numbers, *tolerances)


def as_text(gap: Gap, made: Made) -> str:
    """The text of the file."""
    return KIND.text({**as_plain_data(gap), **asdict(made)})


def load_gap(path: str | Path) -> tuple[Gap, Made]:
    """Read a diagnosis back, without its closed model, which is a vehicle file of its own.

    Raises
    ------
    BadInput : the file is no diagnosis, is damaged, or was written by another version.
    """
    return KIND.load(path, _from_plain_data)


def _from_plain_data(body: Mapping[str, Any]) -> tuple[Gap, Made]:
    return from_plain_data(body), of_plain(Made, body, "diagnosis")
