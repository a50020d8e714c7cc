"""What tracking tuned, written back to the vehicle: its next recordings start from it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from ..effect import Effect
from ..vehicle import ChosenModel, Stated, TrackingPlan, Vehicle
from .track import Track

SOURCE = "tuned on the innovations of {recording}"


def tracked_vehicle(
    vehicle: Vehicle,
    found: Track,
    parameters: Sequence[str],
    disturbances: Sequence[str],
    effects: Mapping[str, Effect],
) -> Vehicle:
    """The vehicle with the model's numbers as calibrated, their uncertainty, and the noise.

    Parameters
    ----------
    parameters, disturbances : what was tracked, as named.
    effects : all there are, by name; those of the model stand under [model] effects.
    """
    source = SOURCE.format(recording=found.recording.name)
    before = vehicle.model.effects if vehicle.model is not None else {}
    model = found.model
    there = [name for name in model.effects if name not in (*parameters, *disturbances)]
    of_effects = {name: before.get(name, Stated(float(model[name].array))) for name in there}
    values = dict(vehicle.values)
    for name, (value, sd) in found.calibrated.items():
        stated = Stated(value, sd if np.isfinite(sd) and sd > 0 else None, source=source)
        (of_effects if name in effects else values)[name] = stated
    plan = TrackingPlan(tuple(parameters), tuple(disturbances), _rounded(found.noise, found))
    chosen = ChosenModel(model.name, dict(model.settings), of_effects)
    return replace(vehicle, values=values, model=chosen, tracking=plan)


def _rounded(noise: Mapping[str, float], found: Track) -> dict[str, float]:
    """The noises that readings told, to three digits."""
    unread = {f"noise_{name}" for name in found.model.outputs if name not in found.consistency}
    return {name: float(f"{size:.3g}") for name, size in noise.items() if name not in unread}
