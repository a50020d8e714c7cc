"""What tracking finds: states, tyres and forces over time with standard deviations; the vehicle with what was tuned."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
import pandas as pd

from ..base.shorthands import Array
from ..datasets.recording import Recording
from ..models.effect import Effect
from ..models.motion_model import MotionModel
from ..models.vehicle import ChosenModel, Stated, TrackingPlan, Vehicle
from .findings import Consistency


@dataclass(frozen=True)
class Track:
    """Estimates over a recording.

    Attributes
    ----------
    model : with what is tracked among its parameters.
    recording : as the filter saw it, glitches of inputs bridged.
    kind : "ekf" or "ukf".
    smoothed : whether later readings count as well.
    rows : (n,) of the recording that the estimates are of.
    run : (n,) number of the unbroken run of each row, from 0.
    values, sds : name -> (n,) estimate and its standard deviation, in SI units.
    units : name -> SI unit.
    tracked : names of what walks.
    parameters, disturbances : what walks for good, and what comes and goes, as named; inputs that were not recorded
        are among the parameters.
    noise : name -> size, as used.
    noise_from, noise_units : name -> where its size is from (stated, tuned, guessed), and its SI unit; of what walks,
        that per root second.
    innovations, expected : channel -> (n,) innovations of readings, and their standard deviations as expected.
    consistency : channel -> what these say.
    widened : by how much standard deviations were widened for innovations that scatter further than expected.
    log_likelihood : of all readings, constants left out.
    sentences : what a reader must know: glitches, gaps, what this recording does not tell and where.
    told : tracked name -> share of rows in which the recording tells more of it than was known before.
    calibrated : parameter -> its value and standard deviation, where parameters were tuned along with the noise.
    seconds : processor time of the filter itself.
    """

    model: MotionModel
    recording: Recording
    kind: str
    smoothed: bool
    rows: Array
    run: Array
    values: Mapping[str, Array]
    sds: Mapping[str, Array]
    units: Mapping[str, str]
    tracked: tuple[str, ...]
    parameters: tuple[str, ...]
    disturbances: tuple[str, ...]
    noise: Mapping[str, float]
    noise_from: Mapping[str, str]
    noise_units: Mapping[str, str]
    innovations: Mapping[str, Array]
    expected: Mapping[str, Array]
    consistency: Mapping[str, Consistency]
    widened: float
    log_likelihood: float
    sentences: tuple[str, ...]
    told: Mapping[str, float]
    calibrated: Mapping[str, tuple[float, float]]
    seconds: float

    @property
    def time(self) -> Array:
        """(n,) s."""
        return np.asarray(self.recording.time[self.rows.astype(int)])

    def table(self) -> pd.DataFrame:
        """One row per sample: time, run, and every estimate with its standard deviation as NAME and NAME_sd."""
        columns: dict[str, Array] = {"time": self.time, "run": self.run}
        for name, values in self.values.items():
            columns[name] = values
            columns[f"{name}_sd"] = self.sds[name]
        return pd.DataFrame(columns)


SOURCE = "tuned on the innovations of {recording}"


def tracked_vehicle(
    vehicle: Vehicle,
    track: Track,
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
    source = SOURCE.format(recording=track.recording.name)
    before = vehicle.model.effects if vehicle.model is not None else {}
    model = track.model
    there = [name for name in model.effects if name not in (*parameters, *disturbances)]
    of_effects = {name: before.get(name, Stated(float(model[name].array))) for name in there}
    values = dict(vehicle.values)
    for name, (value, sd) in track.calibrated.items():
        stated = Stated(value, sd if np.isfinite(sd) and sd > 0 else None, source=source)
        (of_effects if name in effects else values)[name] = stated
    plan = TrackingPlan(tuple(parameters), tuple(disturbances), _rounded(track.noise, track))
    chosen = ChosenModel(model.name, dict(model.settings), of_effects)
    return replace(vehicle, values=values, model=chosen, tracking=plan)


def _rounded(noise: Mapping[str, float], track: Track) -> dict[str, float]:
    """The noises that readings told, to three digits."""
    unread = {f"noise_{name}" for name in track.model.outputs if name not in track.consistency}
    return {name: float(f"{size:.3g}") for name, size in noise.items() if name not in unread}
