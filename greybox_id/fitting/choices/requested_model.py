"""The model a user wants: its name, vehicle, settings, effects, and what is said of its parameters."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

from ...base.errors import BadInput
from ...base.signals import unit_of
from ...datasets.checks.agreement import agreement
from ...datasets.checks.consistency import GIVEN_WHEELBASE
from ...datasets.checks.pairs import pairs
from ...datasets.recording import Recording
from ...models.model import Model
from ...models.motion_model import MotionModel
from ...models.registry import MODELS, build, candidates
from ...models.vehicle import Stated, Vehicle
from ...models.vehicle_file import shipped_vehicles
from ...models.vehicles import with_size
from .parameters import Choices, Magnitudes, completed, free_effects_suit, started, with_choices

VEHICLES_OF_MAPS = {"roboracer": "roboracer", "truck": "truck", "revs_250lm": "ferrari_250lm", "dart": "dart"}
"""Column map -> the shipped vehicle whose recordings it reads."""
FAR_OFF = 3.0
"""A force per unit that is off by more than this factor belongs to another signal."""


@dataclass(frozen=True)
class RequestedModel:
    """A model as asked for.

    Attributes
    ----------
    name : of the model; None takes the vehicle's own.
    vehicle : whose numbers it starts from; None leaves the model its own.
    settings : hyperparameters as plain data.
    effects : added to it, with what is said of their magnitudes.
    choices : what is said of its parameters.
    """

    name: str | None
    vehicle: Vehicle | None = None
    settings: Mapping[str, Any] = field(default_factory=dict)
    effects: Magnitudes = field(default_factory=dict)
    choices: Choices = field(default_factory=Choices)

    def models(self, training: Recording) -> list[Model]:
        """The models to fit: several where the settings leave open what cross-validation is to choose."""
        name, settings, effects = completed(self.name, self.settings, self.effects, self.vehicle)
        result = candidates(name, training, settings, effects, self.vehicle)
        return [self._chosen(model, effects) for model in result]

    def model(self) -> Model:
        """The model to simulate: an effect stated at its null stands there, which is no place to start a fit."""
        name, settings, effects = completed(self.name, self.settings, self.effects, self.vehicle)
        return self._chosen(build(name, settings, effects, self.vehicle), effects, at_stated=True)

    def or_single_track(self) -> RequestedModel:
        """The same; of a vehicle that names no model, a single track."""
        is_open = self.name is None and self.vehicle is not None and self.vehicle.model is None
        return replace(self, name="single_track") if is_open else self

    def _chosen(self, model: Model, effects: Magnitudes, at_stated: bool = False) -> Model:
        free_effects_suit(model, effects)
        stated = {name for name, effect in effects.items() if isinstance(effect, Stated) and effect.value is not None}
        moved = {name: effect for name, effect in effects.items() if not at_stated or name not in stated}
        chosen = with_choices(started(model, moved), self.choices)
        return chosen if self.vehicle is not None else with_size(chosen, self.choices.named)


def must_be_recorded(model: Model, recordings: Sequence[Recording]) -> None:
    """Raise `BadInput` where time does not run in a recording, or where it lacks an input of a motion model.

    The models that a recording would do for are named.
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
        others = [o for o in others if isinstance(o, MotionModel) and not _lacking(o, recording)]
        would_do = [o.name for o in others if any(name in recording for name in o.outputs)]
        target = " and ".join(" or ".join(model.aliases.get(name, (name,))) for name in lacking)
        instead = f" It would do for {' and '.join(would_do)} (‹model›)." if would_do else ""
        raise BadInput(
            f"{recording.name} lacks {target}, which {model.name} needs; it has {', '.join(recording.signals)}. "
            f"Map the columns that hold them in the column map (‹columns›).{instead}"
        )


def doubts(model: Model, vehicle: Vehicle | None, recordings: Sequence[Recording]) -> list[str]:
    """Sentences on a motion model whose nominal numbers may not be those of the vehicle that was recorded."""
    if not isinstance(model, MotionModel):
        return []
    result = []
    maps = {recording.source.columns for recording in recordings}
    shipped = [VEHICLES_OF_MAPS[name] for name in sorted(maps) if name in VEHICLES_OF_MAPS]
    suggested = next(
        (f" (the vehicle {name} comes with greybox)" for name in shipped if name in shipped_vehicles()), ""
    )
    if vehicle is None and (size := _size(model)):  # an actuator has no mass and no wheelbase: it is no vehicle
        start = f"{model.name} starts from numbers of its own ({size})"
        result.append(
            f"No vehicle is named: {start}. Name one{suggested}, or a file with your numbers: "
            f"greybox models {model.name} writes one to begin with."
        )
    if "l_f" in model and "l_r" in model:
        wheelbase = float(model["l_f"].array + model["l_r"].array)
        for recording in recordings:
            known = _wheelbase(recording)
            if known is not None and not GIVEN_WHEELBASE[0] < known / wheelbase < GIVEN_WHEELBASE[1]:
                result.append(
                    f"{recording.name} turns like a vehicle with a wheelbase of {known:.2g} m, but the model has "
                    f"l_f + l_r = {wheelbase:.3g} m: the wrong vehicle, or a wrong unit in the column map?{suggested}"
                )
                break
    return result + doubts_of_drive(model, recordings)


def doubts_of_drive(model: Model, recordings: Sequence[Recording]) -> list[str]:
    """A sentence where the force per unit of the drive signal cannot be meant for the signal that was recorded.

    One unit of a force is one newton, one unit of a commanded acceleration the vehicle's mass in newtons.
    """
    if not isinstance(model, MotionModel) or "force_per_unit" not in model or "m" not in model:
        return []
    stated = float(model["force_per_unit"].array)
    target = {"drive_force": 1.0, "ax_cmd": float(model["m"].array)}
    for recording in recordings:
        signal = next((item for item in model.aliases.get("drive", ()) if item in recording), "")
        if signal in target and not 1 / FAR_OFF < stated / target[signal] < FAR_OFF:
            unit = unit_of(signal)
            return [
                f"{recording.name} holds {signal} in {unit}, one unit of which is about {target[signal]:.4g} N, but "
                f"the model has force_per_unit = {stated:.4g} N: fix force_per_unit at {target[signal]:.4g}, or "
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
    """v_x steer / yaw_rate, m, where the recording tells it for certain."""
    for pair in pairs(recording):
        if pair.nodes == ("yaw_rate", "steer"):
            agreed = agreement(recording, pair.left_values, pair.right_values, pair.smoothing)
            if agreed.certain:
                return abs(1.0 / agreed.gain)
    return None
