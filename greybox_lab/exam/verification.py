"""Verified closure of a gap: simulation of the closed model on the held-out recording."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from math import inf, nan
from pathlib import Path
from typing import Any

import numpy as np

from greybox_id.base.errors import GreyboxError
from greybox_id.datasets.read import read
from greybox_id.gap.closing import closure
from greybox_id.models.effects import EFFECTS
from greybox_id.models.model import must_be
from greybox_id.models.motion_model import MotionModel
from greybox_id.models.parameter import Stated
from greybox_id.models.registry import build, motion_model_of
from greybox_id.models.vehicle import vehicle

from .answers import Answer
from .folder import CLOSED, COLUMNS

Verify = Callable[[Path, Path, Mapping[str, Any]], float]
"""Folder of a case, held-out recording, diagnosis -> closed share of the gap; -inf if the simulation fails."""


def plain_model(model: MotionModel) -> dict[str, Any]:
    """A model as plain data, including other parameters of effects, which vehicle files cannot contain."""
    return {
        "name": model.name,
        "settings": dict(model.settings),
        "effects": list(model.effects),
        "values": {parameter.name: np.asarray(parameter.array).tolist() for parameter in model.parameters},
    }


def model_from(plain: Mapping[str, Any]) -> MotionModel:
    """The model stored by `plain_model`."""
    model = must_be(MotionModel, build(plain["name"], plain["settings"], dict.fromkeys(plain["effects"])))
    values = plain["values"]
    return model.with_parameters(
        *(replace(parameter, value=np.asarray(values[parameter.name])) for parameter in model.parameters)
    )


def held_out_closure(case: Path, held_out: Path, diagnosis: Mapping[str, Any]) -> float:
    """Share of the gap that closes on a held-out recording.

    Parameters
    ----------
    case : folder with vehicle.toml and closed.toml.
    held_out : recording of the same true vehicle.
    diagnosis : its "closed_model" is the closed model from `plain_model`; without it, closed.toml is used.
    """
    plain = diagnosis.get("closed_model")
    try:
        after = model_from(plain) if plain else motion_model_of(vehicle(case / CLOSED))
        return _closed(case, held_out, after)
    except GreyboxError:
        return -inf


def true_closure(case: Path, held_out: Path, answer: Answer) -> float:
    """Likewise for the present effects at their true magnitudes; NaN if they cannot be simulated."""
    there = {name: Stated(value) for name, value in answer.effects.items() if name in EFFECTS}
    second = {name: value for name, value in answer.about.get("drawn", {}).items() if name not in answer.effects}
    try:
        after = must_be(MotionModel, build("single_track", effects=there, vehicle=vehicle(case / "vehicle.toml")))
        after = after.with_parameters(*(after[name].with_value(item) for name, item in second.items() if name in after))
        return _closed(case, held_out, after)
    except GreyboxError:
        return nan


def _closed(case: Path, held_out: Path, after: MotionModel) -> float:
    """Share of the gap that a model closes on a held-out recording."""
    stated, mapping = vehicle(case / "vehicle.toml"), case / COLUMNS
    recording = read(held_out, mapping) if mapping.is_file() else read(held_out)
    result = closure(motion_model_of(stated), after, [recording], stated, EFFECTS)
    return float(result.closed)
