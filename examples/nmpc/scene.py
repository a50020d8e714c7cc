"""The vehicle, what is the matter with it, the models that are believed of it, and what a controller is asked to do."""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import redirect_stdout
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np
from wishes import Wishes

from greybox_id.cli.gap import gap
from greybox_id.models.motion_model import MotionModel
from greybox_id.models.registry import model_of, with_effects
from greybox_id.models.vehicle import vehicle
from greybox_lab.driving.racing.track import RaceTrack, Usage, track
from greybox_lab.exam.make import write_recording
from greybox_lab.virtual.virtual_vehicle import (
    EFFECTS,
    VirtualCar,
    drive,
    random_vehicle,
    toleranced,
    tolerances,
    vehicle_file_text,
)

PERIOD = 0.02
"""s, between commands."""
STAGES = 40
USAGE = 0.9
"""Share of the grip, of the drive and of the brakes that the speed on the track asks for."""
NARROWEST, HALF_WIDTH = 4.0, 1.0
"""Radius of the narrowest bend, and half width of the track, over the wheelbase."""
RECORDED, RATE = 60.0, 100.0
"""s and Hz of the recording that is diagnosed."""
SEED = 3

PAIRS: tuple[Mapping[str, int], ...] = (
    {"steering_delay": 1, "front_stiffness": -1},
    {"steering_lag": 1, "grip_scale": -1},
    {"mass_change": 1, "steering_ratio": -1},
    {"motor_lag": 1, "motor_gain": -1},
)
"""What is the matter, two effects at a time, and on which side of its null each lies."""


@dataclass(frozen=True)
class Scene:
    """A 1:10 racer with effects that its vehicle file does not state.

    Attributes
    ----------
    pair : one of `PAIRS`.
    forms : "nominal": the vehicle has the mathematical forms of the models, and is exactly what its file states;
        "other": it has others, and its parameters lie within the tolerances that the file states.
    """

    pair: Mapping[str, int]
    forms: str = "nominal"

    @cached_property
    def stated(self) -> VirtualCar:
        """The vehicle as its file states it."""
        return random_vehicle(SEED, "racer")

    @cached_property
    def car(self) -> VirtualCar:
        """The vehicle that drives."""
        return self.stated if self.forms == "nominal" else toleranced(self.stated, np.random.default_rng(SEED))

    @cached_property
    def effects(self) -> dict[str, float]:
        """What is the matter with it: the largest magnitudes that the virtual vehicle holds for plausible."""
        size, kind = self.stated.size, self.stated.kind
        return {name: EFFECTS[name].at(side * EFFECTS[name].sizes(size, kind)[1]) for name, side in self.pair.items()}

    @cached_property
    def track(self) -> RaceTrack:
        """The track, with speeds that the vehicle can drive as it really is: they are the same for every model."""
        size, wheelbase = self.stated.size, self.stated.size.length
        weaker = self.effects.get("grip_scale", 1.0) / self.effects.get("mass_change", 1.0)
        limits = (USAGE * weaker * own for own in (size.grip, size.drive, size.brake))
        return track(NARROWEST * wheelbase, HALF_WIDTH * wheelbase, Usage(*limits, size.top_speed))

    @cached_property
    def wishes(self) -> Wishes:
        """What controllers are asked to do, whatever they believe."""
        size, p = self.stated.size, self.stated.parameters
        per_acceleration = p["m"] / p["force_per_unit"]
        return Wishes(
            stages=STAGES,
            path=0.05 * size.length,
            course=0.2,
            speed=0.03 * size.top_speed,
            rates=np.array([1.0, 4.0 * size.brake * per_acceleration]),
            low=np.array([-self.stated.steer_max, -1.3 * size.brake * per_acceleration]),
            high=np.array([self.stated.steer_max, 1.3 * size.drive * per_acceleration]),
            fastest=np.array([2.5 / size.time, 20.0 * per_acceleration / size.time]),
            slip=0.95 * size.peak_slip,
        )

    def models(self, folder: Path) -> dict[str, MotionModel]:
        """Who believes what: the vehicle file; what `greybox gap` makes of it; the file and the true effects.

        Parameters
        ----------
        folder : where the vehicle file, the recording and the closed vehicle are written.
        """
        files = {name: str(folder / name) for name in ("car.toml", "drive.csv", "car_closed.toml")}
        folder.mkdir(parents=True, exist_ok=True)
        tolerated = None if self.forms == "nominal" else tolerances(self.stated)
        Path(files["car.toml"]).write_text(vehicle_file_text(self.stated, tolerated), encoding="utf-8")
        recording, _ = drive(self.car, "mixed", RECORDED, RATE, self.effects, self.forms, SEED)
        write_recording(recording, Path(files["drive.csv"]))
        command = [files["drive.csv"], "--vehicle", files["car.toml"], "--apply", files["car_closed.toml"]]
        with (folder / "gap.txt").open("w", encoding="utf-8") as said, redirect_stdout(said):
            gap.main(command, standalone_mode=False)
        nominal, closed = (model_of(vehicle(files[name])) for name in ("car.toml", "car_closed.toml"))
        true = with_effects(nominal, self.effects)
        assert all(isinstance(own, MotionModel) for own in (nominal, closed, true))
        return {"nominal": nominal, "closed": closed, "true": true}
