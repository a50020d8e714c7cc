"""Relations that hold between channels of any vehicle, from rigid-body kinematics and little more, and how well.

`pairs` compare two measurements of one quantity to estimate gains and delays. Relations judge the consistency of a
recording as a whole, so that it can be tested again with a channel negated, exchanged or scaled.
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass

import numpy as np

from ...base.shorthands import Array
from ...base.signals import ANGLES_AROUND
from ..recording import Recording
from .pairs import (
    TINY,
    acceleration_ahead,
    acceleration_aside,
    course_and_speed,
    grounds,
    independent_samples,
    rate,
    smooth,
)

RATE, MOST_ROWS, SLOWEST = 20.0, 30_000, 5.0
"""Rate in Hz to which a recording is thinned (a vehicle's motion is slower than 10 Hz), the number of rows above which
it is thinned further, and the lowest rate then."""
SMOOTHING = 0.5
"""Width of the moving average before comparison, s."""
TURNS, PUSHES, STEERS = 0.05, 0.6, 0.02
"""Largest constant that may be an offset and is ignored: of a yaw rate in rad/s, of an acceleration in m/s^2 (with
slope) and of a steering angle in rad; a larger one is information, so that a steady circle can be judged as well."""
SAME, TIGHT, PLACES = (0.6, 1.6), (0.75, 1.33), (0.7, 1.4)
"""Allowed gains between accelerations (slope, roll and pitch add to one side), speeds, and yaw rates."""
LENGTHS = (0.06, 15.0)
"""Range of v_x · steer / yaw_rate in m, as in `consistency`."""
RADII = (0.012, 1.0)
"""Range of wheel radii, m."""
MASSES = (0.3, 6e4)
"""Range of vehicle masses, kg."""
COMMANDS = (0.2, 4.0)
"""Range of acceleration over commanded acceleration: an uncalibrated drive, and losses."""
SLACK = 0.1
"""Distance of the logarithm of a gain from its range at which agreement falls to 1/e."""
SPEEDS = 0.1
"""Least share of v_x² · yaw_rate that yaw_rate must not explain: speeds then differ by some 10 %."""
MOVING = 0.2
"""Share of the usual speed below which ratios of speeds are not used."""
DRIVES = ("drive_force", "ax_cmd", "motor_current")
WHEELS = ("wheel_speed_fl", "wheel_speed_fr", "wheel_speed_rl", "wheel_speed_rr")


@dataclass(frozen=True)
class Relation:
    """A relation between channels, and how well it holds.

    Attributes
    ----------
    left, right : the two sides in words.
    channels : all channels involved.
    correlation : of the two sides, from -1 to 1; constants larger than an offset are included.
    gain : ratio of sizes, left over right.
    gains : range of gains in which the relation holds.
    independent : number of independent samples.
    known : whether the gain is known, up to tolerances.
    right_size : root mean square of the right side.
    """

    left: str
    right: str
    channels: tuple[str, ...]
    correlation: float
    gain: float
    gains: tuple[float, float]
    independent: float
    known: bool = True
    right_size: float = 0.0

    @property
    def agreement(self) -> float:
        """1 if the relation holds, 0 if the sides are uncorrelated or the gain is far off, negative for opposite signs.

        Noise on either side biases the ratio of sizes by up to the correlation: the gain is judged with this tolerance.
        """
        if abs(self.correlation) < 0.05 or not 0 < self.gain < np.inf:
            return 0.0
        least, most = self.gain * abs(self.correlation), self.gain / abs(self.correlation)
        low, high = max(self.gains[0], TINY), self.gains[1]
        outside = max(np.log(low) - np.log(most), np.log(least) - np.log(high), 0.0)
        return float(self.correlation * np.exp(-((outside / SLACK) ** 2)))


def thinned(recording: Recording) -> Recording:
    """Means over blocks of rows, at about `RATE` Hz; blocks do not cross runs."""
    dt = recording.sample_time
    target = max(min(RATE, MOST_ROWS / max(recording.duration, dt)), SLOWEST)
    by = max(1, int(round(1 / (target * dt))))
    if by == 1:
        return recording
    spans = [(start, (stop - start) // by) for start, stop in recording.runs if stop - start >= 2 * by]

    def means(values: Array) -> Array:
        parts = [values[a : a + n * by].reshape(n, by).mean(axis=1) for a, n in spans]
        return np.concatenate(parts) if parts else np.empty(0)

    def middles(values: Array) -> Array:
        parts = [values[a + by // 2 : a + n * by : by] for a, n in spans]
        return np.concatenate(parts) if parts else np.empty(0)

    edges = np.concatenate(([0], np.cumsum([n for _, n in spans])))
    return Recording(
        recording.name,
        means(recording.time),
        {name: middles(v) if name in ANGLES_AROUND else means(v) for name, v in recording.signals.items()},
        tuple((int(a), int(b)) for a, b in zip(edges[:-1], edges[1:], strict=True)),
        extra_units=recording.extra_units,
    )


def relations(r: Recording, touching: Collection[str] = ()) -> list[Relation]:
    """All relations that can be formed from the channels.

    Parameters
    ----------
    r : a contiguous recording, as returned by `thinned`.
    touching : only relations that involve one of these channels; all if empty.
    """
    selection = _Selection(r, frozenset(touching))
    result = (
        *_turning(selection),
        *_pushing(selection),
        *_over_ground(selection),
        *_rolling(selection),
        *_driven(selection),
    )
    return [item for item in result if item is not None]


@dataclass(frozen=True)
class _Selection:
    """A recording and the channels whose relations are selected."""

    recording: Recording
    touching: frozenset[str]

    def wants(self, *channels: str) -> bool:
        """Whether a relation between these channels can be formed, and is selected."""
        return self.recording.has(*channels) and (not self.touching or not self.touching.isdisjoint(channels))


def _turning(selection: _Selection) -> list[Relation | None]:
    r, result = selection.recording, list[Relation | None]()
    if selection.wants("yaw_rate", "v_x", "steer"):
        result.append(_relation(r, ("yaw_rate", "v_x · steer"), ("yaw_rate", "v_x", "steer"), r["yaw_rate"],
                               r["v_x"] * r["steer"], (TURNS, STEERS * _usual(r["v_x"])),
                               (1 / LENGTHS[1], 1 / LENGTHS[0]), known=False))  # fmt: skip
    if selection.wants("yaw_rate", "yaw"):
        result.append(_relation(r, ("yaw_rate", "d(yaw)/dt"), ("yaw_rate", "yaw"), r["yaw_rate"],
                               rate(r, r["yaw"], True), (TURNS, 0.0), PLACES))  # fmt: skip
    if selection.wants("a_y", "v_x", "steer"):
        result.append(_relation(r, ("a_y", "v_x² · steer"), ("a_y", "v_x", "steer"), r["a_y"],
                               r["v_x"] * np.abs(r["v_x"]) * r["steer"], (PUSHES, STEERS * _usual(r["v_x"]) ** 2),
                               (0.2 / LENGTHS[1], 1 / LENGTHS[0]), known=False))  # fmt: skip
    if selection.wants("v_y", "v_x", "yaw_rate"):
        result.append(_rear_axle(r))
    return result


def _rear_axle(r: Recording) -> Relation | None:
    """Side slip of the rear axle: v_y = b · yaw_rate - k · v_x² · yaw_rate with k > 0, wherever (b) the sensor is
    mounted.

    Both sides are less the part that yaw_rate explains: the two terms can only be separated at several speeds.
    """
    v_y, rolls, slips = (
        smooth(r, item, SMOOTHING) for item in (r["v_y"], r["yaw_rate"], -r["v_x"] * np.abs(r["v_x"]) * r["yaw_rate"])
    )
    rows = np.isfinite(v_y) & np.isfinite(rolls) & np.isfinite(slips)
    power = float(np.sum(rolls[rows] ** 2))
    if not TINY < power < 1 / TINY:
        return None
    left, right = (item - rolls * float(np.sum(item[rows] * rolls[rows]) / power) for item in (v_y, slips))
    known = float(np.sum(right[rows] ** 2)) > SPEEDS**2 * float(np.sum(slips[rows] ** 2))
    if not known:
        return None
    words = ("v_y", "v_x² · yaw_rate without the part that yaw_rate explains")
    offsets, any_gain = (np.inf, np.inf), (0.0, np.inf)
    return _relation(r, words, ("v_y", "v_x", "yaw_rate"), left, right, offsets, any_gain, False, 0.0)


def _pushing(selection: _Selection) -> list[Relation | None]:
    r, result = selection.recording, list[Relation | None]()
    involved = ("a_x", "v_x", *(("yaw_rate", "v_y") if r.has("yaw_rate", "v_y") else ()))
    if selection.wants(*involved):
        words, right = acceleration_ahead(r)
        result.append(_relation(r, ("a_x", words), involved, r["a_x"], right, (PUSHES, 0.0), SAME))
    involved = ("a_y", "v_x", "yaw_rate", *(("v_y",) if r.has("v_y") else ()))
    if selection.wants(*involved):
        words, right = acceleration_aside(r)
        offsets = (PUSHES, TURNS * _usual(r["v_x"]))
        result.append(_relation(r, ("a_y", words), involved, r["a_y"], right, offsets, SAME))
    if selection.wants("a_y", "v_x", "curvature") and not r.has("yaw_rate"):
        right = r["v_x"] * np.abs(r["v_x"]) * r["curvature"]
        result.append(_relation(r, ("a_y", "v_x² · curvature"), ("a_y", "v_x", "curvature"), r["a_y"], right,
                               (PUSHES, 0.0), SAME))  # fmt: skip
    if selection.wants("sideslip", "v_x", "v_y"):
        slow = np.abs(r["v_x"]) < MOVING * _usual(r["v_x"])
        angle = np.where(slow, np.nan, np.arctan2(r["v_y"], np.abs(r["v_x"])))
        result.append(_relation(r, ("sideslip", "atan2(v_y, v_x)"), ("sideslip", "v_y", "v_x"), r["sideslip"], angle,
                               (STEERS, STEERS), PLACES))  # fmt: skip
    return result


def _over_ground(selection: _Selection) -> list[Relation | None]:
    r, result = selection.recording, list[Relation | None]()
    for place in grounds(r):
        beside = [name for name in ("yaw_rate", "v_x", "steer", "yaw") if r.has(name)]
        if not selection.wants(*place.channels, *beside):
            continue
        turn, speed = course_and_speed(r, place)
        if not np.isfinite(speed).any():
            continue
        words = f"the course over ground ({place.words})"
        if selection.wants("yaw_rate", *place.channels):
            result.append(_relation(r, ("yaw_rate", words), ("yaw_rate", *place.channels), place.turning(r), turn,
                                    (TURNS, 0.0), PLACES, smoothing=0.0))  # fmt: skip
        if selection.wants("v_x", "steer", *place.channels):
            offsets = (STEERS * _usual(r["v_x"]), 0.0)
            result.append(_relation(r, ("v_x · steer", words), ("v_x", "steer", *place.channels), place.steered(r),
                                    turn, offsets, LENGTHS, False, 0.0))  # fmt: skip
        if "yaw_rate" not in r and selection.wants("yaw", *place.channels):
            heading = place.twice_smoothed(r, rate(r, r["yaw"], True))
            result.append(_relation(r, ("d(yaw)/dt", words), ("yaw", *place.channels), heading, turn, (TURNS, 0.0),
                                    PLACES, smoothing=0.0))  # fmt: skip
        if "yaw_rate" not in r and selection.wants("a_y", "v_x", *place.channels):
            pushed, pace = (place.twice_smoothed(r, r[name]) for name in ("a_y", "v_x"))
            result.append(_relation(r, ("a_y", f"v_x · {words}"), ("a_y", "v_x", *place.channels), pushed, turn * pace,
                                    (PUSHES, 0.0), SAME, smoothing=0.0))  # fmt: skip
        if selection.wants("v_x", *place.channels):
            sides = ("|v_x|", f"the speed over ground ({place.words})")
            pace = smooth(r, np.abs(r["v_x"]), place.seconds)
            result.append(_ratio(r, sides, ("v_x", *place.channels), pace, speed, TIGHT, True))
        aside = ("v_y",) if r.has("v_y") else ()
        if place.words == "x, y" and selection.wants("x", "y", "yaw", "v_x", *aside):
            result += _heading(r)
    return result


def _heading(r: Recording) -> list[Relation | None]:
    """Velocity over ground rotated by yaw equals v_x ahead and v_y to the left, for any origin of yaw."""
    ground = rate(r, r["x"]) + 1j * rate(r, r["y"])
    ahead = np.exp(-1j * r["yaw"]) * ground
    body = r["v_x"] + 1j * (r["v_y"] if r.has("v_y") else 0.0)
    both = np.isfinite(ahead) & np.isfinite(body)
    if not both.any():
        return []
    origin = np.angle(np.sum(ahead[both] * np.conj(body[both])))
    seen = ahead * np.exp(-1j * origin)
    result = [_ratio(r, ("v_x", "the velocity from x and y along yaw"), ("v_x", "x", "y", "yaw"),
                    smooth(r, r["v_x"], SMOOTHING), smooth(r, seen.real, SMOOTHING), TIGHT, True)]  # fmt: skip
    if r.has("v_y"):
        result.append(_relation(r, ("v_y", "the velocity from x and y across yaw"), ("v_y", "x", "y", "yaw"),
                               r["v_y"], seen.imag, (0.02 * _usual(r["v_x"]),) * 2, SAME))  # fmt: skip
    return result


def _rolling(selection: _Selection) -> list[Relation | None]:
    r, result = selection.recording, list[Relation | None]()
    wheels = [name for name in WHEELS if r.has(name)]
    if not (selection.wants(*wheels) or selection.wants("v_x", *wheels)):
        return result
    speeds = {name: smooth(r, np.abs(r[name]), SMOOTHING) for name in wheels}
    for name in wheels if len(wheels) > 1 and selection.wants(*wheels) else []:
        others = np.median([speed for other, speed in speeds.items() if other != name], axis=0)
        result.append(_ratio(r, (name, "the other wheel speeds"), tuple(wheels), speeds[name], others, TIGHT, True))
    if wheels and selection.wants("v_x", *wheels):
        usual = np.median(list(speeds.values()), axis=0)
        pace = smooth(r, np.abs(r["v_x"]), SMOOTHING)
        result.append(_ratio(r, ("|v_x|", "the wheel speeds"), ("v_x", *wheels), pace, usual, RADII, False))
    return result


def _driven(selection: _Selection) -> list[Relation | None]:
    r, result = selection.recording, list[Relation | None]()
    for name in DRIVES:
        if selection.wants(name, "v_x") and np.ptp(r[name][np.isfinite(r[name])]) > 0:
            gains = {"ax_cmd": COMMANDS, "drive_force": (1 / MASSES[1], 1 / MASSES[0])}.get(name, (0.0, np.inf))
            result.append(_relation(r, ("dv_x/dt", name), (name, "v_x"), rate(r, r["v_x"]), r[name], (np.inf, np.inf),
                                   gains, known=name == "ax_cmd"))  # fmt: skip
    return result


def _relation(
    r: Recording, words: tuple[str, str], channels: tuple[str, ...], left: Array, right: Array,
    offsets: tuple[float, float], gains: tuple[float, float], known: bool = True, smoothing: float = SMOOTHING,
) -> Relation | None:  # fmt: skip
    """A relation between two series; a constant of up to `offsets` on each side is ignored."""
    stride = max(1, int(round(0.25 / r.sample_time)))
    sides, centred = [], []
    smoothed = [smooth(r, item, smoothing) for item in (left, right)]
    for start, stop in r.runs:
        u, v = (item[start:stop:stride] for item in smoothed)
        both = np.isfinite(u) & np.isfinite(v)
        sides.append((u[both], v[both]))
        centred += [(u[both] - u[both].mean(), v[both] - v[both].mean())] if both.any() else []
    (x, constant_x), (y, constant_y) = (
        _about_zero(np.concatenate([side[k] for side in sides]), offsets[k]) for k in (0, 1)
    )
    if (compared := _compared(x, y)) is None:
        return None
    moves = [np.concatenate([item[k] for item in centred]) for k in (0, 1)]  # runs of one-sided turns differ in mean
    moves = [move / max(float(np.std(move)), TINY) for move in moves]
    count = independent_samples(moves[0], moves[1], np.cumsum([len(item) for item, _ in centred]))
    if constant_x and constant_y:
        count += STEADY
    correlation, size_x, size_y = compared
    return Relation(*words, channels, correlation, size_x / size_y, gains, count, known, size_y)


def _compared(x: Array, y: Array) -> tuple[float, float, float] | None:
    """Correlation about zero and root mean squares of two series; None with too few rows or without variation."""
    size_x, size_y = (float(np.sqrt(np.mean(item**2))) if item.size else 0.0 for item in (x, y))
    if len(x) < 5 or not (TINY < size_x < 1 / TINY and TINY < size_y < 1 / TINY):
        return None
    return float(np.mean((x / size_x) * (y / size_y))), size_x, size_y


STEADY = 12.0
"""Number of independent samples credited to constants larger than twice an offset on both sides."""


def _about_zero(values: Array, offset: float) -> tuple[Array, bool]:
    """A series less its mean, but at most `offset` of it; and whether the mean exceeds twice the offset."""
    if not values.size:
        return values, False
    low, high = np.quantile(values, [0.005, 0.995])
    tame = np.clip(values, low, high)
    mean = float(tame.mean())
    return tame - np.clip(mean, -offset, offset), abs(mean) > 2 * offset


def _ratio(
    r: Recording, words: tuple[str, str], channels: tuple[str, ...], left: Array, right: Array,
    gains: tuple[float, float], known: bool,
) -> Relation | None:  # fmt: skip
    """A relation between two speeds, which have no offset: constant speed is informative as well."""
    pace = np.maximum(np.abs(left), np.abs(right))
    rows = np.isfinite(left) & np.isfinite(right)
    if not rows.any():
        return None
    rows &= pace > MOVING * _usual(pace)
    if (compared := _compared(left[rows], right[rows])) is None:
        return None
    correlation, size_x, size_y = compared
    seconds = np.count_nonzero(rows) * r.sample_time
    return Relation(*words, channels, correlation, size_x / size_y, gains, 2 * seconds, known, size_y)


def _usual(values: Array) -> float:
    """Usual size of a series when not at rest: 90th percentile of its magnitude."""
    good = np.abs(values[np.isfinite(values)])
    return float(np.quantile(good, 0.9)) if good.size else 0.0
