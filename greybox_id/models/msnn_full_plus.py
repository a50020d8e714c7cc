"""MS-NN-full with what recordings of a 1:10 car suggested beyond the paper; each addition can be switched off.

lat.n_delta            3 or 5 local models over steering
steering_rate_limit    the servo's limit before the window (an effect, held at its setting), or none
symmetric              left and right are the same vehicle, so every recording is seen mirrored too, or not
long.speed_window      the window of speeds acts on the acceleration
long.eta = 5           half the neurons, now that the speeds tell most
timing_offset          one latency of the inertial sensors per run, a nuisance parameter (an effect); off by default

Cross-validation on the training data chooses the first three unless they are set.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, replace
from typing import Any

from ..memory_model import MemoryModel
from ..recording import Recording
from .effects import sensor_latency_imu, steering_rate_limit
from .msnn_full import FullSettings, covering_full, msnn_full
from .msnn_lat import LateralSettings
from .msnn_long import LongitudinalSettings


@dataclass(frozen=True)
class PlusSettings:
    """Hyperparameters and additions.

    Attributes
    ----------
    lat, long : those of MS-NN-lat and MS-NN-long.
    symmetric : see every recording mirrored too.
    steering_rate_limit : rad/s, before the steering window; None for no limit.
    refine_longitudinal : as in MS-NN-full.
    timing_offset : estimate one latency of the inertial sensors per run.
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
        about="MS-NN-full with a steering rate limit, a speed window, mirroring and timing offsets",
        symmetric=s.symmetric,
        parts=tuple(replace(part, symmetric=s.symmetric) for part in model.parts),
    )
    if s.steering_rate_limit is not None:
        model = model + steering_rate_limit.at(s.steering_rate_limit)
    if s.timing_offset:
        model = model + sensor_latency_imu
    return replace(model, settings=asdict(s))


def alternatives_plus(settings: Mapping[str, Any]) -> list[dict[str, Any]]:
    """Structures that cross-validation on the training data chooses between, where the settings leave them open."""
    lat = settings.get("lat", {})
    if not isinstance(lat, Mapping):
        return [dict(settings)]  # making settings of it will say what is wrong
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
    """Centres left open cover the recording's range, symmetric about straight ahead where the model is."""
    both = covering_full(FullSettings(settings.lat, settings.long), recording, symmetric=settings.symmetric)
    return replace(settings, lat=both.lat, long=both.long)
