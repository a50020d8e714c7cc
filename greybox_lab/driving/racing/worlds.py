"""The world of a vehicle: its model, its track, and what differs from episode to episode."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import Any

from greybox_id.base.errors import BadInput, near_or_all
from greybox_id.fitting.requested_model import RequestedModel, magnitudes
from greybox_id.models.model import Model, must_be
from greybox_id.models.motion_model import MotionModel
from greybox_id.models.vehicle import Vehicle
from greybox_id.models.vehicle import vehicle as vehicle_named

from .draws import Randomisation, draws
from .rules import Rules
from .stage import stage
from .track import read_track
from .world import World, limits_of

STEER_MAX = 0.4
"""Largest road-wheel angle, rad, of vehicles whose file states none: that of 1:10 cars; road cars have more."""


def drivable(model: Model) -> MotionModel:
    """The model, where it is one of motion. Raises `BadInput` for others."""
    no = f"{model.name} has no equations of motion: it cannot be driven. Name single_track."
    return must_be(MotionModel, model, no)


def world(
    lanes: int,
    vehicle: str | Path | Vehicle = "roboracer",
    *,
    model: str | MotionModel = "single_track",
    effects: str | Iterable[str] = (),
    track: str | Path | None = None,
    half_width: float | None = None,
    randomise: Randomisation = "none",
    like: World | None = None,
    **rules: Any,
) -> World:
    """The world of a vehicle.

    Parameters
    ----------
    lanes : vehicles side by side.
    vehicle : a shipped name, a vehicle file, or what was read of one.
    model : of motion; a name, or one at its values.
    effects : that it has besides, as the command line writes them: "steering_delay=30ms".
    track : a CSV file of a closed middle line (x, y, widths to both sides, m); None: that of the examples.
    half_width : m, of a track whose file states none.
    randomise : what differs from episode to episode: "none", "hand" (friction, mass, delay), draws, a fit or a gap.
    like : a world whose track and units are this one's as well: that in which a policy was learned.
    rules : see `Rules`.

    Raises
    ------
    BadInput : there is no such vehicle, model, effect, track, randomisation or rule.
    """
    unknown = [name for name in rules if name not in Rules.__dataclass_fields__]
    if unknown:
        known = near_or_all(unknown[0], Rules.__dataclass_fields__)
        raise BadInput(f"A track has no option {unknown[0]!r}.{known}")
    stated = vehicle if isinstance(vehicle, Vehicle) else vehicle_named(str(vehicle))
    names = (effects,) if isinstance(effects, str) else tuple(effects)
    result = model if not isinstance(model, str) else RequestedModel(model, stated, effects=magnitudes(names)).model()
    moving = drivable(result)
    how = Rules(**rules)
    line = None
    if track is not None:
        line = read_track(track, limits_of(stage(moving, how.period), moving)[0], half_width)
    steer_max = like.steer_max if like is not None else stated.steer_max or STEER_MAX
    return World(moving, lanes, how, line=line, draws=draws(randomise), sd=stated.noise, steer_max=steer_max, like=like)
