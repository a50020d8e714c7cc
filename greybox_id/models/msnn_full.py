"""MS-NN-full: the coupled lateral and longitudinal dynamics, MS-NN-lat and MS-NN-long in a closed loop.

In MS-NN-lat's window the predicted longitudinal acceleration replaces the measured one; in MS-NN-long's window the
predicted yaw rate times speed replaces the lateral acceleration.

Source: Mungiello et al., "Vehicle dynamics learning from physics priors with model-structured neural
networks", Fig. 1a and Sec. II-D.

MS-NN-full-plus has additions that recordings of a 1:10 car suggested; each can be switched off:

lat.n_delta            3 or 5 local models over steering
steering_rate_limit    the servo's limit before the window (an effect, held at its setting), or none
symmetric              whether the vehicle is mirror-symmetric, so that every recording is used mirrored too
long.speed_window      the window of speeds acts on the acceleration
long.eta = 5           half the neurons, since speeds carry most of the information
timing_offset          one latency of the inertial sensors per run, a nuisance parameter (an effect); off by default

Cross-validation on the training data chooses the first three unless they are set.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, replace
from typing import Any

from ..base.errors import BadInput
from ..datasets.recording import Recording
from .effects import sensor_latency_imu, steering_rate_limit
from .memory_model import MemoryModel, Past
from .model import Namespace, Symbol
from .msnn_lat import LateralSettings, covering_lat, msnn_lat
from .msnn_long import LongitudinalSettings, covering_long, msnn_long


@dataclass(frozen=True)
class FullSettings:
    """Hyperparameters of both parts.

    Attributes
    ----------
    lat, long : those of MS-NN-lat and MS-NN-long.
    refine_longitudinal : whether step 2 also changes the longitudinal part, as in the paper. If not, step 2 refines the
        lateral part on predicted accelerations and leaves the longitudinal part as fitted to its own output: in a
        common objective the yaw rate's residuals distort the acceleration that feeds them.
    """

    lat: LateralSettings = field(default_factory=LateralSettings)
    long: LongitudinalSettings = field(default_factory=LongitudinalSettings)
    refine_longitudinal: bool = False


def covering_full(settings: FullSettings, recording: Recording, symmetric: bool = False) -> FullSettings:
    """The settings with open centres set from a training recording."""
    return FullSettings(
        covering_lat(settings.lat, recording, symmetric),
        covering_long(settings.long, recording, symmetric),
        settings.refine_longitudinal,
    )


def msnn_full(settings: FullSettings | None = None) -> MemoryModel:
    """MS-NN-full; 544 parameters with the authors' hyperparameters."""
    s = settings or FullSettings()
    lat, long = msnn_lat(s.lat), msnn_long(s.long)
    if lat.sample_time != long.sample_time:
        raise BadInput(
            f"MS-NN-lat has a sample time of {lat.sample_time:g} s and MS-NN-long one of {long.sample_time:g} s; a "
            "closed loop needs the same sample time for both."
        )

    def equations(u: Namespace, p: Namespace, past: Past) -> dict[str, Symbol]:
        return {**lat.equations(u, p, past), **long.equations(u, p, past)}

    inputs = tuple(dict.fromkeys(lat.inputs + long.inputs))

    def feedback(y: Namespace, u: Namespace) -> dict[str, Symbol]:
        fed = {"a_x": y.a_x, "a_y": y.yaw_rate * u.v_x}
        return {name: item for name, item in fed.items() if name in inputs}

    return MemoryModel(
        name="msnn_full",
        about="model-structured network of the coupled dynamics, closed loop: yaw rate and acceleration",
        inputs=inputs,
        outputs=lat.outputs + long.outputs,
        parameters=lat.parameters + long.parameters,
        equations=equations,
        feedback=feedback if {"a_x", "a_y"} & set(inputs) else None,
        sample_time=lat.sample_time,
        defaults=long.defaults,
        parts=(lat, long),
        step_2_holds=() if s.refine_longitudinal else tuple(p.name for p in long.parameters),
        settings=asdict(s),
        together=lat.together + long.together,
    )


@dataclass(frozen=True)
class PlusSettings:
    """Hyperparameters and additions.

    Attributes
    ----------
    lat, long : those of MS-NN-lat and MS-NN-long.
    symmetric : whether every recording is used mirrored too.
    steering_rate_limit : rad/s, before the steering window; None for no limit.
    refine_longitudinal : as in MS-NN-full.
    timing_offset : whether one latency of the inertial sensors per run is estimated.
    """

    lat: LateralSettings = field(default_factory=lambda: LateralSettings(n_delta=3))
    long: LongitudinalSettings = field(default_factory=lambda: LongitudinalSettings(eta=5, speed_window=True))
    symmetric: bool = False
    steering_rate_limit: float | None = 2.5
    timing_offset: bool = False
    refine_longitudinal: bool = False


def msnn_full_plus(settings: PlusSettings | None = None) -> MemoryModel:
    """MS-NN-full with additions."""
    s = settings or PlusSettings()
    model = msnn_full(FullSettings(s.lat, s.long, s.refine_longitudinal))
    model = replace(
        model,
        name="msnn_full_plus",
        about="msnn_full with a steering rate limit, a window of past speeds, left-right symmetry and time offsets",
        symmetric=s.symmetric,
        parts=tuple(replace(part, symmetric=s.symmetric) for part in model.parts),
    )
    if s.steering_rate_limit is not None:
        model = model + steering_rate_limit.at(s.steering_rate_limit)
    if s.timing_offset:
        model = model + sensor_latency_imu
    return replace(model, settings=asdict(s))


def alternatives_plus(settings: Mapping[str, Any]) -> list[dict[str, Any]]:
    """Structures among which cross-validation on the training data chooses, if the settings leave them open."""
    lat = settings.get("lat", {})
    if not isinstance(lat, Mapping):
        return [dict(settings)]  # building the settings raises the error
    steer = lat.get("steer")
    known = len(steer) if isinstance(steer, (list, tuple)) else lat.get("n_delta")
    counts = [3, 5] if known is None else [known]
    limits = [settings["steering_rate_limit"]] if "steering_rate_limit" in settings else [None, 2.5, 3.5]
    mirrors = [settings["symmetric"]] if "symmetric" in settings else [False, True]
    return [
        {**settings, "lat": {**lat, "n_delta": count}, "steering_rate_limit": limit, "symmetric": mirror}
        for count in counts
        for limit in limits
        for mirror in mirrors
    ]


def covering_plus(settings: PlusSettings, recording: Recording) -> PlusSettings:
    """The settings with open centres covering the recording's range, symmetric about straight ahead if the model is."""
    both = covering_full(FullSettings(settings.lat, settings.long), recording, symmetric=settings.symmetric)
    return replace(settings, lat=both.lat, long=both.long)
