"""The arms: what a vehicle's rows say of it, as the model that a driver then learns on."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

from greybox_id.api.closed_vehicle import closed_vehicle, fitted_vehicle
from greybox_id.api.diagnosing import diagnose
from greybox_id.api.fitting import fit
from greybox_id.base.errors import BadInput, near_or_all
from greybox_id.base.json_data import attributes
from greybox_id.datasets.recording import Recording
from greybox_id.gap.gap import Gap
from greybox_id.models.effects import EFFECTS
from greybox_id.models.model import must_be
from greybox_id.models.motion_model import MotionModel
from greybox_id.models.registry import motion_model_of, with_effects
from greybox_id.models.vehicle import Vehicle

from ..learned.injection import injected
from ..learned.training import train_actuator_net
from ..racing.draws import Draws, by_hand, nothing_drawn, of_gap
from .protocol import ARMS

PERIOD = 0.02
"""s, of driving, in which networks step too."""
MEMBERS = 5
"""Networks that say what a model is off by: as many as are customary for an ensemble."""
UNNAMED = 0.5
"""Probability that something is unnamed beyond which networks are set beside what was named."""


@dataclass(frozen=True)
class Twin:
    """A vehicle as rows say it is.

    Attributes
    ----------
    vehicle : as a file can state it; where networks act, what they act in.
    model : that is learned on.
    draws : what of it differs from episode to episode.
    detected : whether the simulation of the vehicle file deviates from the rows at all, where that was asked.
    named : what is held for the cause: effect, magnitude, unit, interval, probability.
    applied : effect -> magnitude, of those in the model.
    unknown_probability : that something is unnamed; None where nothing was diagnosed.
    """

    vehicle: Vehicle
    model: MotionModel
    draws: Draws = field(default_factory=nothing_drawn)
    detected: bool = False
    named: tuple[Mapping[str, Any], ...] = ()
    applied: Mapping[str, float] = field(default_factory=dict)
    unknown_probability: float | None = None


def twin(arm: str, vehicle: Vehicle, recordings: Sequence[Recording], seed: int = 0) -> Twin:
    """What an arm makes of rows.

    Parameters
    ----------
    arm : one of `protocol.ARMS`.
    vehicle : what is stated of it.
    recordings : what it drove; networks but for `actuator_net` read v_y too.
    seed : of networks.

    Raises
    ------
    BadInput : there is no such arm, or rows do not hold what it needs.
    """
    if arm not in ARMS:
        raise BadInput(f"There is no arm {arm!r:.40}.{near_or_all(arm[:40], ARMS)}")
    stated = Twin(vehicle, motion_model_of(vehicle))
    given = list(recordings)
    match arm:
        case "nominal":
            return stated
        case "hand":
            return replace(stated, draws=by_hand())
        case "refit":
            fitted = fit(stated.model.name, given, vehicle=vehicle)
            values = {**vehicle.values, **fitted_vehicle(fitted, vehicle.name).values}
            known = replace(vehicle, name=f"{vehicle.name}, fitted", values=values, path=None)
            return Twin(known, must_be(MotionModel, fitted.model))
        case "actuator_net" | "abstract":
            variant = {"actuator_net": "paper"}.get(arm, arm)
            net = train_actuator_net(given, variant=variant, sample_time=PERIOD, seed=seed)
            return replace(stated, model=injected(stated.model, net))
        case "residual":
            return corrected(stated, given, seed)
    result = named(vehicle, given)
    if arm == "named_residual" and (result.unknown_probability or 0.0) > UNNAMED:
        return corrected(result, given, seed)
    return result


def oracle(vehicle: Vehicle, effects: Mapping[str, float]) -> Twin | None:
    """A vehicle with effects that it truly has; None where no model has one of them."""
    if any(name not in EFFECTS for name in effects):
        return None
    return Twin(vehicle, with_effects(motion_model_of(vehicle), dict(effects)), applied=dict(effects))


def corrected(twin: Twin, recordings: Sequence[Recording], seed: int) -> Twin:
    """With networks of what its model is off by."""
    net = train_actuator_net(
        recordings, variant="residual", model=twin.model, sample_time=PERIOD, members=MEMBERS, seed=seed
    )
    # networks add to the model at its values: drawn ones would be corrected for what they are not
    return replace(twin, model=injected(twin.model, net), draws=nothing_drawn())


def named(vehicle: Vehicle, recordings: Sequence[Recording]) -> Twin:
    """What `greybox gap` says of rows, and the model that closes the gap."""
    gap = diagnose(vehicle, list(recordings), vehicle=vehicle)
    result = Twin(
        vehicle, motion_model_of(vehicle), detected=gap.gap_detected, named=causes(gap),
        unknown_probability=gap.unknown_probability,
    )  # fmt: skip
    if not gap.applied or not isinstance(gap.closed, MotionModel):
        return result
    applied = {name: float(gap.closed[name].array) for name in gap.applied}
    result = replace(result, vehicle=closed_vehicle(vehicle, gap), model=gap.closed, applied=applied)
    return replace(result, draws=of_gap(gap, unseen=False))


def causes(gap: Gap) -> tuple[Mapping[str, Any], ...]:
    """What is held for the cause: applied effects, and others that are more likely there than not."""
    return tuple(
        attributes(item, "effect", "magnitude", "unit", "interval", "probability")
        for item in gap.ranking
        if item.effect in gap.applied or item.probability > 0.5
    )
