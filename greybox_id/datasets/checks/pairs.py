"""Pairs of channels that measure one quantity in two ways, equal up to a gain: yaw_rate and d(yaw)/dt, a_x and dv_x/dt.

Also the agreement of two series: correlation, gain, and statistical significance.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ...base.shorthands import Array
from ...base.statistics import moving_mean
from ..recording import Recording

EARTH = 6.371e6
"""Mean radius of the earth, m."""

SHARPEST = 1.0
"""Largest angle in rad turned within one chord for which the course over ground follows the yaw rate."""


@dataclass(frozen=True)
class Pair:
    """One quantity measured in two ways.

    Attributes
    ----------
    left, right : names of the two sides in sentences.
    nodes : the two channels whose signs are compared.
    channels : all channels involved.
    left_values, right_values : (n,) in the same unit up to a gain; NaN where a side is undefined.
    kinematic : whether both sides are the same quantity (gain 1, no delay); otherwise the vehicle's response lies
        between.
    smoothing : width of the moving average for comparing gains, s.
    lag_smoothing : standard deviation of the smoothing for comparing delays, s; None if the pair is too coarse to
        estimate a delay.
    """

    left: str
    right: str
    nodes: tuple[str, str]
    channels: tuple[str, ...]
    left_values: Array
    right_values: Array
    kinematic: bool = True
    smoothing: float = 0.5
    lag_smoothing: float | None = 0.06


def pairs(recording: Recording) -> list[Pair]:
    """All pairs that the recording's channels allow."""
    r = recording
    pairs: list[Pair] = []

    if r.has("yaw_rate", "v_x", "steer"):
        pairs.append(
            Pair("yaw_rate", "v_x · steer", ("yaw_rate", "steer"), ("yaw_rate", "v_x", "steer"),
                 r["yaw_rate"], r["v_x"] * r["steer"], kinematic=False, lag_smoothing=0.03)
        )  # fmt: skip
    pairs += _of_curvature(r)
    if r.has("yaw_rate", "yaw"):
        both = ("yaw_rate", "yaw")
        pairs.append(Pair("yaw_rate", "d(yaw)/dt", both, both, r["yaw_rate"], rate(r, r["yaw"], True)))
    if r.has("a_x", "v_x"):
        right, values = acceleration_ahead(r)
        pairs.append(Pair("a_x", right, ("a_x", "v_x"), ("a_x", "v_x"), r["a_x"], values))
    if r.has("a_y", "v_x", "yaw_rate"):
        right, values = acceleration_aside(r)
        pairs.append(
            Pair("a_y", right, ("a_y", "yaw_rate"), ("a_y", "v_x", "yaw_rate"), r["a_y"], values,
                 lag_smoothing=0.06 if r.has("v_y") else None)
        )  # fmt: skip
    if r.has("sideslip", "v_x", "v_y"):
        slow = np.abs(r["v_x"]) < 1.0
        angle = np.where(slow, np.nan, np.arctan2(r["v_y"], np.abs(r["v_x"])))
        pairs.append(
            Pair("sideslip", "atan2(v_y, v_x)", ("sideslip", "v_y"), ("sideslip", "v_y"), r["sideslip"], angle)
        )
    return pairs + _over_ground(r)


def _of_curvature(r: Recording) -> list[Pair]:
    """Path curvature against yaw rate or, if that is missing, against steering and lateral acceleration."""
    if not r.has("curvature", "v_x"):
        return []
    turn, known, both = r["v_x"] * r["curvature"], "v_x · curvature", ("v_x", "curvature")
    if "yaw_rate" in r:
        return [Pair("yaw_rate", known, ("yaw_rate", "curvature"), ("yaw_rate", *both), r["yaw_rate"], turn,
                     lag_smoothing=None)]  # fmt: skip
    result = []
    if "steer" in r:
        result.append(Pair(known, "v_x · steer", ("curvature", "steer"), (*both, "steer"), turn, r["v_x"] * r["steer"],
                          kinematic=False, lag_smoothing=None))  # fmt: skip
    if "a_y" in r:
        result.append(Pair("a_y", "v_x² · curvature", ("a_y", "curvature"), ("a_y", *both), r["a_y"], r["v_x"] * turn,
                          lag_smoothing=None))  # fmt: skip
    return result


def acceleration_ahead(r: Recording) -> tuple[str, Array]:
    """Longitudinal acceleration from the motion, in words and values (n,)."""
    if r.has("yaw_rate", "v_y"):
        return "dv_x/dt - yaw_rate · v_y", rate(r, r["v_x"]) - r["yaw_rate"] * r["v_y"]
    return "dv_x/dt", rate(r, r["v_x"])


def acceleration_aside(r: Recording) -> tuple[str, Array]:
    """Lateral acceleration from the motion, in words and values (n,)."""
    if r.has("v_y"):
        return "v_x · yaw_rate + dv_y/dt", r["v_x"] * r["yaw_rate"] + rate(r, r["v_y"])
    return "v_x · yaw_rate", r["v_x"] * r["yaw_rate"]


@dataclass(frozen=True)
class Ground:
    """Positions from which course and speed over ground are computed.

    Attributes
    ----------
    words : the channels, for sentences.
    channels : their names.
    east, north : (n,) m, or x and y of a map.
    seconds : duration of the chords, s.
    shortest : length of a chord, m, below which its direction is unreliable.
    """

    words: str
    channels: tuple[str, str]
    east: Array
    north: Array
    seconds: float
    shortest: float

    def twice_smoothed(self, r: Recording, values: Array) -> Array:
        """A series smoothed like a difference of two chords."""
        return smooth(r, smooth(r, values, self.seconds), self.seconds)

    def turning(self, r: Recording) -> Array:
        """The yaw rate smoothed like that of the course; NaN where the course turns too far within a chord."""
        gentle = self.twice_smoothed(r, np.abs(r["yaw_rate"])) * self.seconds < SHARPEST
        return np.where(gentle, self.twice_smoothed(r, r["yaw_rate"]), np.nan)

    def steered(self, r: Recording) -> Array:
        """v_x · steer, smoothed in the same way."""
        return self.twice_smoothed(r, r["v_x"] * r["steer"])


def grounds(r: Recording) -> list[Ground]:
    """All position sources of a recording."""
    result = []
    if r.has("latitude", "longitude"):
        north = np.radians(r["latitude"]) * EARTH
        east = np.radians(r["longitude"]) * EARTH * np.cos(np.radians(np.nanmedian(r["latitude"])))
        # Receivers are accurate to about a metre: the course needs a chord of several metres.
        result.append(Ground("latitude, longitude", ("latitude", "longitude"), east, north, 2.0, 5.0))
    if r.has("x", "y"):
        result.append(Ground("x, y", ("x", "y"), r["x"], r["y"], 0.5, 0.0))
    return result


def _over_ground(r: Recording) -> list[Pair]:
    """Course and speed over ground against yaw rate, steering and v_x: positions do not depend on sign conventions."""
    result = []
    for place in grounds(r):
        turn, speed = course_and_speed(r, place)
        words, channels = place.words, place.channels
        node, along = f"course over ground ({words})", f"the course over ground ({words})"
        if "yaw_rate" in r:
            sides = place.turning(r), turn
            result.append(_coarse("yaw_rate", along, ("yaw_rate", node), ("yaw_rate", *channels), *sides))
        else:
            result += _without_gyro(r, place, turn, along, node)
        if "v_x" in r:
            pace, ground = smooth(r, np.abs(r["v_x"]), place.seconds), f"the speed over ground ({words})"
            result.append(
                _coarse("|v_x|", ground, ("v_x", f"speed over ground ({words})"), ("v_x", *channels), pace, speed)
            )
    return result


def _without_gyro(r: Recording, place: Ground, turn: Array, along: str, node: str) -> list[Pair]:
    """The course against heading, lateral acceleration and steering, if no yaw rate is recorded."""
    result, channels = [], place.channels
    if "yaw" in r:
        heading = place.twice_smoothed(r, rate(r, r["yaw"], True))
        result.append(_coarse("d(yaw)/dt", along, ("yaw", node), ("yaw", *channels), heading, turn))
    if "a_y" in r and "v_x" in r:
        aside = place.twice_smoothed(r, r["a_y"]), turn * place.twice_smoothed(r, r["v_x"])
        result.append(_coarse("a_y", f"v_x · {along}", ("a_y", node), ("a_y", "v_x", *channels), *aside))
    if "steer" in r and "v_x" in r:
        sides = turn, place.steered(r)  # like yaw_rate against v_x · steer: the gain is one over a length
        coarse = _coarse(along, "v_x · steer", ("steer", node), ("v_x", "steer", *channels), *sides)
        result.append(replace(coarse, kinematic=False))
    return result


def _coarse(
    left: str, right: str, nodes: tuple[str, str], channels: tuple[str, ...], left_values: Array, right_values: Array
) -> Pair:
    """A pair computed from chords of seconds: already smooth, and too coarse to estimate a delay."""
    return Pair(left, right, nodes, channels, left_values, right_values, smoothing=0.0, lag_smoothing=None)


def course_and_speed(r: Recording, place: Ground) -> tuple[Array, Array]:
    """Turn rate of the course, rad/s, and speed, m/s, from chords."""
    east, north = place.east, place.north
    half = max(1, int(round(place.seconds / 2 / r.sample_time)))
    course, chord = np.full(len(r), np.nan), np.full(len(r), np.nan)
    turn = np.full(len(r), np.nan)
    spans = []
    for start, stop in r.runs:
        if stop - start > 4 * half + 1:
            dx = east[start + 2 * half : stop] - east[start : stop - 2 * half]
            dy = north[start + 2 * half : stop] - north[start : stop - 2 * half]
            course[start + half : stop - half] = np.arctan2(dy, dx)
            chord[start + half : stop - half] = np.hypot(dx, dy)
            spans.append((start, stop))
    if not spans or not np.isfinite(chord).any():
        return turn, chord
    usual = float(np.nanquantile(chord, 0.95))
    sound = chord > max(place.shortest, 0.2 * usual)
    course = np.where(sound, course, np.nan)
    duration = 2 * half * r.sample_time
    for start, stop in spans:
        change = course[start + 2 * half : stop] - course[start : stop - 2 * half]
        turn[start + half : stop - half] = (np.mod(change + np.pi, 2 * np.pi) - np.pi) / duration
    return turn, np.where(sound, chord / duration, np.nan)


def rate(recording: Recording, values: Array, angle: bool = False) -> Array:
    """Time derivative within runs, (n,) for (n,); NaN in runs of fewer than 3 rows."""
    out = np.full(len(values), np.nan)
    for start, stop in recording.runs:
        if stop - start >= 3:
            run = values[start:stop]
            if angle and np.isfinite(run).all():
                run = np.unwrap(run)
            out[start:stop] = np.gradient(run, recording.time[start:stop])
    return out


def smooth(recording: Recording, values: Array, seconds: float) -> Array:
    """Centred moving average within runs, (n,) for (n,); NaN where the window would leave the run or meets a NaN."""
    half = int(round(seconds / 2 / recording.sample_time))
    if half < 1:
        return values
    out = np.full(len(values), np.nan)
    width = 2 * half + 1
    for start, stop in recording.runs:
        if stop - start >= width:
            run = values[start:stop]
            holes = ~np.isfinite(run)
            mean = moving_mean(np.where(holes, 0.0, run), width)
            if holes.any():
                mean[moving_mean(holes.astype(float), width) > 0.5 / width] = np.nan
            out[start + half : stop - half] = mean[half : len(run) - half]
    return out


CERTAIN = 4.0
"""Fisher's z of the correlation, in standard deviations under independence, from which a sign is certain."""
STRONG = 0.7
"""Correlation below which the gain is too inaccurate to judge units: the ratio of spreads errs by up to 1/0.7."""
TINY = 1e-100
"""Series smaller than this, or larger than its inverse, are not measurements."""
ENOUGH = 12.0
"""Fewest independent samples: with fewer, the correlation of two drifts could be mistaken for agreement."""


@dataclass(frozen=True)
class Agreement:
    """Agreement of two series.

    Attributes
    ----------
    correlation : of the smoothed series.
    gain : ratio of their spreads, left over right, with the correlation's sign.
    independent : number of independent samples, corrected for autocorrelation.
    """

    correlation: float
    gain: float
    independent: float

    @property
    def beyond_chance(self) -> bool:
        """Whether the correlation is strong and significant."""
        if self.independent < 4 or abs(self.correlation) < STRONG:
            return False
        return bool(np.arctanh(min(abs(self.correlation), 1 - 1e-12)) * np.sqrt(self.independent - 3) > CERTAIN)

    @property
    def certain(self) -> bool:
        """Whether the agreement is certain enough to report a fault."""
        return self.independent >= ENOUGH and self.beyond_chance


def agreement(recording: Recording, left: Array, right: Array, seconds: float) -> Agreement:
    """Agreement of two series over all runs, smoothed over `seconds`."""
    return _agreement(_thinned(recording, left, right, seconds))


def run_agreements(recording: Recording, left: Array, right: Array, seconds: float) -> dict[int, Agreement]:
    """Agreement of two series in each run: run number, counted from 1 -> agreement."""
    return {n: _agreement([part]) for n, part in enumerate(_thinned(recording, left, right, seconds), 1)}


def _thinned(recording: Recording, left: Array, right: Array, seconds: float) -> list[tuple[Array, Array]]:
    a, b = smooth(recording, left, seconds), smooth(recording, right, seconds)
    stride = max(1, int(round(max(seconds, 0.2) / 2 / recording.sample_time)))  # closer rows are redundant
    parts = []
    for start, stop in recording.runs:
        u, v = a[start:stop:stride], b[start:stop:stride]
        both = np.isfinite(u) & np.isfinite(v)
        parts.append((u[both], v[both]))
    return parts


def _agreement(parts: list[tuple[Array, Array]]) -> Agreement:
    x, y = (_tame(np.concatenate([part[k] for part in parts])) for k in (0, 1))
    x, x_scale = standard(x)
    y, y_scale = standard(y)
    if len(x) < 5 or x_scale == 0.0 or y_scale == 0.0:
        return Agreement(0.0, float("nan"), float(len(x)))
    correlation = float(np.mean(x * y))
    gain = x_scale / y_scale * (1.0 if correlation >= 0 else -1.0)
    return Agreement(correlation, gain, independent_samples(x, y, np.cumsum([len(part[0]) for part in parts])))


def standard(values: Array) -> tuple[Array, float]:
    """The series with mean 0 and standard deviation 1, and its original standard deviation; 0 if it is constant."""
    size = float(np.max(np.abs(values), initial=0.0))
    if not TINY < size < 1 / TINY:
        return values, 0.0
    unit = values / size  # first, so that no square over- or underflows
    unit = unit - unit.mean()
    spread = float(np.std(unit))
    return (unit / spread, spread * size) if spread > 1e-12 else (values, 0.0)


def _tame(values: Array) -> Array:
    """Clip extreme values: a single outlier must not decide on a unit."""
    if not values.size:
        return values
    low, high = np.quantile(values, [0.005, 0.995])
    return np.clip(values, low, high)


def independent_samples(x: Array, y: Array, ends: NDArray[np.int_]) -> float:
    """Bartlett's number of independent samples for the correlation of two autocorrelated standard series."""
    total = 1.0
    for lag in range(1, max(2, len(x) // 3)):
        keep = np.ones(len(x) - lag, dtype=bool)
        for end in ends[:-1]:
            keep[max(0, end - lag) : end] = False  # no product across runs
        if np.count_nonzero(keep) < 5:
            break
        u = float(np.mean((x[lag:] * x[:-lag])[keep]))
        v = float(np.mean((y[lag:] * y[:-lag])[keep]))
        if u * v < 0.02 or min(u, v) < 0:
            break
        total += 2 * u * v
    return len(x) / total
