"""What is usual for a vehicle: its numbers, which of them differ between runs, and how much, estimated from runs."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import fields, replace
from math import log
from typing import Any

import numpy as np

from ...base.numbers import number, the_recordings
from ...base.shorthands import Array
from ...datasets.recording import Recording
from ...engine.motion.schedule import AT_ONCE
from ...models.effect import Effect
from ...models.motion_model import MotionModel
from ...models.vehicle import Vehicle
from ..estimation.calibration import CAL
from .between_runs import Common, VaryingNumber, Weigher, common, values_of
from .innovations import FollowedRun, Follower, noise_of, plain_noise

USUAL: dict[str, float] = {
    field.name.removeprefix("scatter_"): getattr(CAL, field.name)
    for field in fields(CAL)
    if field.name.startswith("scatter_")
} | {"steering_lag": CAL.scatter_steering_delay, "sensor_latency_imu": CAL.scatter_sensor_latency_yaw}
"""Effect -> usual standard deviation of its magnitude between runs of a vehicle to which nothing was done; of a lever
arm, over the wheelbase. Only these effects may be named as changed."""
GAINS = ("yaw_rate_scale",)
"""Of these, gains of sensors, which filters reduce as well."""
LEVER_ARM = "velocity_lever_arm"
"""Of these, the place where speed is measured: files seldom state it."""
LATENCIES = ("sensor_latency_yaw", "sensor_latency_imu")
"""Of these, latencies of sensors."""
SENSORS = (*GAINS, *LATENCIES, "yaw_rate_bias", "accel_bias_y", "imu_mount_yaw", LEVER_ARM)
"""Of these, those of sensors: they act on readings alone."""
TIMED = ("steering_delay",)
"""Of these, delays: they include that between the clocks of commands and readings, and may be negative."""


def acts(effect: Effect, model: MotionModel, read: Sequence[str]) -> bool:
    """Whether an effect acts on outputs that are read: one of a sensor needs all that the sensor reads.

    A number of the model's equations that bears an effect's name is that effect.
    """
    name, whole = effect.parameter.name, {*effect.touches} <= {*read}
    return (effect.concerns(model) or name in model) and (name not in SENSORS or whole)


def numbers_of(
    model: MotionModel, value: Mapping[str, Effect], vehicle: Vehicle
) -> tuple[MotionModel, tuple[VaryingNumber, ...]]:
    """The model with all effects that may change, and the numbers that are searched."""
    result = list[VaryingNumber]()
    for name, stated in vehicle.values.items():
        if stated.sd is not None and name in model and model[name].shape == ():
            at = float(model[name].array)
            result.append(_number(name, at, stated.sd, model[name].bounds, at > 0, stated.sd))
    tyres = any(item.name.endswith(("_f", "_r")) for item in result)
    wheelbase = sum(float(model[name].array) for name in ("l_f", "l_r") if name in model) or 1.0
    full = model
    for name, effect in value.items():
        parameter, stated_effect = effect.parameter, vehicle.effects.get(name)
        null = float(parameter.array)
        mean = null if stated_effect is None or stated_effect.value is None else stated_effect.value
        if parameter.name in model:
            mean = float(model[parameter.name].array)
        else:
            full = full + effect.at(mean)
        between = USUAL[name] * (wheelbase if name == LEVER_ARM else 1.0)
        of = USUAL[TIMED[0]] if name in LATENCIES else between  # clocks shift delays and latencies alike
        wide, change = CAL.filters / 2 if name in GAINS else CAL.nominal * of, CAL.widened * of
        if name == LEVER_ARM:  # a sensor stays where it is, but may be remounted anywhere
            change = CAL.remounted * wheelbase
            wide = change if mean == null else wide
        if effect.group == "tyres" and tyres:  # the tyres' parameters already hold its mean
            wide = CAL.indifference * between
        sd = stated_effect.sd if stated_effect is not None and stated_effect.sd is not None else wide
        one = _number(parameter.name, mean, sd, parameter.bounds, null == 1.0, between)
        if name in (*TIMED, *LATENCIES):
            low = one.low - CAL.clocks if name in TIMED else 2 * AT_ONCE  # readings at one instant keep their order
            one = replace(one, step=max(one.step, CAL.delay_step), low=low, mean=max(one.mean, low))
        result.append(replace(one, usual=between, change=change))
    return full, tuple(result)


def driven_alike(rides: Sequence[FollowedRun], since: Sequence[FollowedRun]) -> float:
    """Share of seconds whose steering angle and speed occur in the other part, too; the smaller one of both parts.

    What is usual is learned where recordings from before were driven: elsewhere model errors differ.
    """
    driven, known = (np.concatenate([_seconds(ride) for ride in part]) for part in (rides, since))
    if not len(driven) or not len(known):
        return 0.0
    reach = np.stack([np.full(len(driven), CAL.steered_alike), CAL.fast_alike * np.abs(driven[:, 1])], axis=1)
    near = np.all(np.abs(driven[:, None] - known[None]) <= reach[:, None], axis=2)
    return float(min(np.mean(np.any(near, axis=1)), np.mean(np.any(near, axis=0))))


FAST = 95.0
"""Percentile of speed and of lateral acceleration by which a sentence describes how hard recordings are driven."""


def driven_elsewhere(rides: Sequence[FollowedRun], since: Sequence[FollowedRun]) -> str:
    """How hard recordings are driven compared with those from before, in a sentence."""
    (v, a), (w, b) = ([_percentile(part, of) for of in (_speed, _turning)] for part in (rides, since))
    return (
        f"The recordings to be examined reach a speed of {number(v, 2)} m/s and a lateral acceleration of "
        f"{number(a, 2)} m/s²; those from before reach {number(w, 2)} m/s and {number(b, 2)} m/s² ({FAST:g}th "
        "percentiles). Model errors beyond the earlier range "
        "look like a change, so a change needs more evidence to be named."
    )


def _percentile(rides: Sequence[FollowedRun], of: Callable[[Recording], Array]) -> float:
    values = np.concatenate([of(ride.recording) for ride in rides])
    return float(np.nanpercentile(values, FAST)) if np.any(np.isfinite(values)) else 0.0


def _speed(recording: Recording) -> Array:
    return np.abs(_signal(recording, "v_x"))


def _turning(recording: Recording) -> Array:
    return np.abs(recording["a_y"] if "a_y" in recording else _speed(recording) * _signal(recording, "yaw_rate"))


def _signal(recording: Recording, name: str) -> Array:
    """A signal; zero where a recording does not hold it."""
    return recording[name] if name in recording else np.zeros(len(recording))


def _seconds(ride: FollowedRun) -> Array:
    """(seconds, 2) mean steering angle and speed; zero where a recording holds none."""
    recording = ride.recording
    columns = np.stack([_signal(recording, name) for name in ("steer", "v_x")], axis=1)
    rows = max(1, round(CAL.block / recording.sample_time))
    parts = [columns[at : at + rows] for start, stop in recording.runs for at in range(start, stop - rows + 1, rows)]
    read = [part for part in parts if np.all(np.any(np.isfinite(part), axis=0))]  # readings are `CAL.apart` apart
    return np.array([np.nanmean(part, axis=0) for part in read]).reshape(-1, 2)


def _number(
    name: str, mean: float, sd: float, bounds: tuple[Any, Any], logarithmic: bool, scale: float
) -> VaryingNumber:
    """A number, searched as its logarithm or with steps in proportion to a scale."""
    low, high = (float(np.asarray(end)) for end in bounds)
    if logarithmic:
        relative = sd / mean
        ends = log(max(low, 1e-9)), log(high) if np.isfinite(high) else 50.0
        step = CAL.between_beside * min(relative, CAL.most_relative)
        return VaryingNumber(name, True, log(mean), relative, step, *ends)
    return VaryingNumber(name, False, mean, sd, CAL.between_beside * scale, low, high)


def usual(
    follower: Follower,
    numbers: Sequence[VaryingNumber],
    rides: Sequence[FollowedRun],
    tell: Callable[..., None],
    filtered: Sequence[str] = (),
) -> Common:
    """Learn from recordings what is usual for a vehicle.

    Parameters
    ----------
    rides : from before.
    filtered : numbers that runs to be compared differ in because they have passed different filters.
    """
    known = tuple(numbers)
    tell(f"estimating the usual values of effects from {the_recordings([one.recording.name for one in rides])}")
    nominal = values_of(known, np.array([item.mean for item in known]))
    scatter = {one.name: one.usual for one in known if one.usual} | dict.fromkeys(filtered, CAL.filters)
    follower.tune(rides, nominal)
    weigher = Weigher(follower, known, plain_noise(follower.size, len(follower.read)))
    result = common(weigher, rides, scatter, settled=CAL.enough)  # only for sizes of noise
    follower.tune(rides, values_of(known, result.x))
    at = zip(rides, result.x + result.deviations, strict=True)
    innovations = [innovation for ride, x in at for innovation in weigher.innovations(ride, x)]
    noise = noise_of([innovation for innovation in innovations if innovation is not None], len(follower.read))
    result = common(replace(weigher, noise=noise), rides, scatter, result)
    tempered = replace(weigher, noise=replace(noise, temper=_temper(result, rides)))
    tell("estimating the scatter between runs")
    return common(tempered, rides, scatter, result)


def _temper(known: Common, rides: Sequence[FollowedRun]) -> float:
    """How many independent blocks one counts as: variance of their gradients over that of sums of neighbours."""
    together = round(CAL.together)
    single, sums = np.zeros(len(known.x)), np.zeros(len(known.x))
    for ride, deviation in zip(rides, known.deviations, strict=True):
        scores = known.weigher.curve(ride, known.x + deviation).scores
        parts = scores[: len(scores) // together * together].reshape(-1, together, len(known.x))
        single += np.sum(parts**2, axis=(0, 1))
        sums += np.sum(np.sum(parts, axis=1) ** 2, axis=0)
    ratios = [single[k] / sums[k] for k in known.varying if sums[k] > 0]
    return float(np.clip(np.median(ratios), 1 / together, 1.0)) if ratios else 1.0
