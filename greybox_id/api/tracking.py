"""Tracking of a vehicle along a recording, and what is tracked by default."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import TextIO

import numpy as np

from ..base.declared import understood
from ..base.errors import BadInput
from ..base.shorthands import Array
from ..base.version import __version__
from ..datasets.column_map import column_map
from ..datasets.recording import Recording
from ..filters.how import TrackOptions
from ..filters.verb import track as track_recording
from ..fitting.fit import Fit, Verdict
from ..fitting.holding import as_fitted
from ..fitting.requested_model import RequestedModel
from ..models.effect import Effect
from ..models.effects import EFFECTS
from ..models.model import Model, must_be
from ..models.motion_model import MotionModel
from ..models.registry import install, model_of
from ..models.vehicle import TrackingPlan, Vehicle
from ..reports.track.digest import TrackMade
from . import given
from .fitting import Progress
from .given import Columns, ModelLike, VehicleLike
from .track_result import TrackResult


@understood
def track(
    model: ModelLike | Fit | Vehicle,
    recording: Recording | str | Path,
    parameters: str | Iterable[str] = (),
    *,
    disturbances: str | Iterable[str] = (),
    vehicle: VehicleLike = None,
    effects: Iterable[Effect] = (),
    columns: Columns = "canonical",
    options: TrackOptions | None = None,
    progress: Progress | None = None,
) -> TrackResult:
    """Estimate states, tyres and forces along a recording with an EKF or UKF.

    Parameters
    ----------
    model : a fit (its covariance widens the bands), a model, a model's name, or a vehicle, whose model is used.
    recording : in SI units. Glitches and short gaps of inputs are bridged and reported.
    parameters : tracked as random walks: parameters, C_alpha_f, effects, quantities such as F_yf, or inputs. By default
        those in the vehicle's file, or the cornering stiffnesses.
    disturbances : tracked as processes that return to their initial value, such as road_bank.
    vehicle : with the initial values of a model given by name.
    effects : your own that may be tracked by name.
    columns : column map for a file.
    options : filter, readings, noise.
    progress : called with each line of progress.

    Returns
    -------
    Track
        Estimates (n,) with standard deviations, in SI units: `to_pandas()`, `plot()`.

    Raises
    ------
    BadInput : if a name is unknown, the recording lacks an input, or the filter diverges.

    Examples
    --------
    >>> import greybox_id as gb
    >>> lap = gb.read(gb.datasets.shipped("racer_train"), columns="roboracer").rows(0, 300)
    >>> track = gb.track("lateral", lap, ["C_alpha_f"], vehicle="roboracer", options=gb.TrackOptions(tune=0.0))
    >>> "C_alpha_f_sd" in track.to_pandas()
    True
    """
    if options is not None and not isinstance(options, TrackOptions):
        raise BadInput(f"options: gb.TrackOptions(...) is needed, not {options!r:.60}.")
    install()
    meant = track_setup(model, vehicle)
    walking, others = meant.names(given.listed(parameters, "parameters"), given.listed(disturbances, "disturbances"))
    named = {**EFFECTS, **{effect.name: effect for effect in effects}}
    how = options or TrackOptions(known=meant.plan.noise)
    read = given.one_recording(recording, columns)
    read = as_fitted(model, read) if isinstance(model, Fit) else read
    result = track_recording(
        meant.model, read, walking, disturbances=others, effects=named, how=how, uncertain=meant.uncertain,
        say=progress or (lambda line: None),
    )  # fmt: skip
    made = TrackMade(meant.model.name, "", __version__, how.tune, how.calibrate)
    return TrackResult.of(result, as_read=read, how=how, made=made, named=(walking, others))


def follow(
    model: ModelLike | Fit | Vehicle, lines: TextIO, out: TextIO, parameters: Iterable[str] = (),
    disturbances: Iterable[str] = (), columns: str = "canonical", options: TrackOptions | None = None,
) -> Verdict:  # fmt: skip
    """Estimate line by line from a stream of comma-separated text; returns the verdict at its end.

    Parameters
    ----------
    lines, out : stream of input lines, and stream of estimates, flushed after each line.
    model, parameters, disturbances, columns, options : as in `track`; noise is as stated, nothing is tuned.

    Raises
    ------
    BadInput : if a column is missing, a line cannot be read, or the noise of a reading is not stated.
    """
    from ..filters.live import follow as follow_lines

    meant = track_setup(model)
    walking, others = meant.names(tuple(parameters), tuple(disturbances))
    how = options or TrackOptions(known=meant.plan.noise)
    mapping = column_map(columns)
    return follow_lines(meant.model, walking, others, EFFECTS, how, mapping, lines, out, meant.uncertain)


def stiffnesses(model: Model) -> tuple[str, ...]:
    """The cornering stiffnesses of a model, which are tracked by default."""
    known = {
        *(combination.name for combination in model.combinations),
        *(parameter.name for parameter in model.parameters),
    }
    return tuple(name for name in ("C_alpha_f", "C_alpha_r") if name in known)


def principal(covariance: Array | None) -> Array | None:
    """(k, parameters) principal standard deviations of a covariance (parameters, parameters)."""
    if covariance is None:
        return None
    values, vectors = np.linalg.eigh(np.nan_to_num(covariance))
    kept = values > 1e-12 * max(values[-1], 1e-300)
    return np.asarray((vectors[:, kept] * np.sqrt(values[kept])).T)


@dataclass(frozen=True)
class TrackSetup:
    """A model and what to track.

    Attributes
    ----------
    model : the model.
    plan : what is tracked by default.
    uncertain : (k, parameters) principal standard deviations of the parameters of a fit, which widen the bands.
    """

    model: MotionModel
    plan: TrackingPlan
    uncertain: Array | None = None

    @classmethod
    def of_fit(cls, fit: Fit) -> TrackSetup:
        """From a fit, whose covariance widens the bands. Raises `BadInput` if its model is not one of motion."""
        motion_model = must_be_motion(fit.model)
        return cls(motion_model, TrackingPlan(parameters=stiffnesses(motion_model)), principal(fit.covariance))

    @classmethod
    def of_model(cls, model: Model, vehicle: Vehicle | None) -> TrackSetup:
        """From a model and the vehicle's file. Raises `BadInput` if it is not a model of motion."""
        motion_model = must_be_motion(model)
        plan = vehicle.tracking if vehicle is not None else None
        return cls(motion_model, plan or TrackingPlan(parameters=stiffnesses(motion_model)))

    def names(
        self, parameters: tuple[str, ...], disturbances: tuple[str, ...]
    ) -> tuple[tuple[str, ...], tuple[str, ...]]:
        """Parameters and disturbances as requested, or those of the plan."""
        walking = parameters or self.plan.parameters
        return walking, disturbances or tuple(name for name in self.plan.disturbances if name not in walking)


def must_be_motion(model: Model) -> MotionModel:
    """The model, if it is one of motion. Raises `BadInput` for others."""
    no = f"{model.name} is {model.called}; filters track equations of motion, such as single_track or lateral."
    return must_be(MotionModel, model, no)


def track_setup(model: ModelLike | Fit | Vehicle, vehicle: VehicleLike = None) -> TrackSetup:
    """What to track. Parameters and errors are those of `track`."""
    if isinstance(model, Fit):
        return TrackSetup.of_fit(model)
    if isinstance(model, RequestedModel):
        return TrackSetup.of_model(model.model(), model.vehicle)
    stated = model if isinstance(model, Vehicle) else given.vehicle(vehicle)
    return TrackSetup.of_model(model_of(model) if isinstance(model, Vehicle) else given.model(model, stated), stated)
