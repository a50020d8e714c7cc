"""Closed paths, speeds along them, and the driver of the synthetic racer with three lateral controllers."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from math import atan, atan2, cos, hypot, pi, sin

import numpy as np
from scipy.interpolate import CubicSpline

from greybox_id.base.shorthands import Array

from ..speed_profile import speed_profile
from .car import CarMotion

SPACING = 0.02
"""Distance between points of a path, m (rounded so that a whole number of them closes the path)."""

_CORNERS = np.array(
    [
        (0.0, 0.0),
        (1.5, 0.12),
        (2.9, -0.3),
        (4.0, 0.0),
        (4.5, 1.1),
        (4.25, 2.6),
        (3.3, 3.9),
        (1.9, 4.5),
        (0.3, 4.35),
        (-1.1, 3.7),
        (-2.2, 2.8),
        (-2.75, 1.5),
        (-2.65, 0.3),
        (-1.9, -0.05),
    ]
)
"""Points the track passes, m, anticlockwise: mostly left turns, right turns on two of its sides."""


@dataclass(frozen=True)
class Circuit:
    """A smooth closed path.

    Attributes
    ----------
    s : (n,) distance along the path, m, from 0, equally spaced.
    length : m; the point after the last is the first again.
    x, y : (n,) m.
    yaw : (n,) direction of the path, rad, unwrapped.
    curvature : (n,) 1/m, positive to the left.
    """

    s: Array
    length: float
    x: Array
    y: Array
    yaw: Array
    curvature: Array

    def mirrored(self) -> Circuit:
        """The path seen in a mirror along the x axis: left turns become right turns."""
        return Circuit(self.s, self.length, self.x, -self.y, -self.yaw, -self.curvature)


def closed_track(points: Array) -> Circuit:
    """Smooth closed path through points.

    Parameters
    ----------
    points : (k, 2) m, in driving order, the first not repeated.
    """
    ring = np.vstack([points, points[:1]])
    chord = np.concatenate(([0.0], np.cumsum(np.hypot(*np.diff(ring, axis=0).T))))
    curve = CubicSpline(chord, ring, bc_type="periodic")
    dense = np.linspace(0.0, chord[-1], 20_001)
    speed = np.hypot(*curve(dense, 1).T)
    arc = np.concatenate(([0.0], np.cumsum(0.5 * (speed[1:] + speed[:-1]) * np.diff(dense))))
    n = round(arc[-1] / SPACING)
    s = np.arange(n) * (arc[-1] / n)
    # The spline's curvature has kinks; smoothing over 0.1 m makes a line that a driver can follow.
    xy = _smooth(curve(np.interp(s, arc, dense)), 0.1 / SPACING)
    ahead, behind = np.roll(xy, -1, axis=0), np.roll(xy, 1, axis=0)
    step = arc[-1] / n
    d1, d2 = (ahead - behind) / (2 * step), (ahead - 2 * xy + behind) / step**2
    curvature = (d1[:, 0] * d2[:, 1] - d1[:, 1] * d2[:, 0]) / np.hypot(*d1.T) ** 3
    return Circuit(s, float(arc[-1]), xy[:, 0], xy[:, 1], np.unwrap(np.arctan2(d1[:, 1], d1[:, 0])), curvature)


def raceline(rng: np.random.Generator, clockwise: bool = False) -> Circuit:
    """The synthetic track, with corners displaced by a few centimetres for this run.

    Parameters
    ----------
    rng : random generator of the run's line.
    clockwise : whether to reverse the direction, so that right turns prevail.
    """
    points = _CORNERS + rng.normal(0.0, 0.035, _CORNERS.shape)
    if clockwise:
        points = np.roll(points[::-1], 1, axis=0)
    return closed_track(points)


def smooth_speeds(track: Circuit, v_max: float, a_y_max: float, a_x_max: float) -> Array:
    """Speeds along a path within acceleration limits, m/s, (n,), smoothed as by a driver.

    Parameters
    ----------
    track : the path.
    v_max : m/s.
    a_y_max, a_x_max : m/s^2.
    """
    limits = {"grip": a_y_max, "drive": a_x_max, "brake": a_x_max, "top_speed": v_max}
    v = speed_profile(track.curvature, track.length / len(track.s), **limits)
    return np.asarray(_smooth(v[:, None], 0.1 / SPACING)[:, 0], dtype=float)


def _smooth(values: Array, width: float) -> Array:
    """Gaussian smoothing around a closed line; `width` is the standard deviation in points."""
    n = len(values)
    frequency = np.fft.rfftfreq(n)
    gain = np.exp(-2.0 * (np.pi * frequency * width) ** 2)
    return np.asarray(np.fft.irfft(np.fft.rfft(values, axis=0) * gain[:, None], n, axis=0), dtype=float)


PERIOD = 0.025
"""Time between two decisions of the driver, s."""


@dataclass(frozen=True)
class Place:
    """The car's position relative to the path, as known to the driver.

    Attributes
    ----------
    x, y, yaw : estimated pose of the rear axle, m and rad.
    v : speed, m/s, from the motor.
    nearest : index of the path's point next to the car.
    offset : lateral displacement of the line to follow, m, positive to the left of the path.
    """

    x: float
    y: float
    yaw: float
    v: float
    nearest: int
    offset: float


Steering = Callable[[Circuit, Place, float], float]
"""(track, place, wheelbase) -> commanded road-wheel angle, rad."""


def _error(track: Circuit, place: Place, ahead: float) -> tuple[float, float, float]:
    """Lateral error (m, positive: the line is to the left), heading error and curvature `ahead` m of the rear axle."""
    step = track.length / len(track.s)
    k = (place.nearest + round(ahead / step)) % len(track.s)
    x, y = place.x + ahead * cos(place.yaw), place.y + ahead * sin(place.yaw)
    direction = float(track.yaw[k])
    lateral = cos(direction) * (float(track.y[k]) - y) - sin(direction) * (float(track.x[k]) - x)
    return lateral + place.offset, wrapped(direction - place.yaw), float(track.curvature[k])


@dataclass
class Stanley:
    """Heading error plus arctangent of the front axle's error (Hoffmann et al., ACC 2007)."""

    k: float = 2.2
    softening: float = 0.6

    def __call__(self, track: Circuit, place: Place, wheelbase: float) -> float:
        """Commanded angle, rad."""
        lateral, heading, _ = _error(track, place, wheelbase)
        return heading + atan(self.k * lateral / (self.softening + max(place.v, 0.0)))


@dataclass
class Pid:
    """PID on the lateral error of a point ahead, around the path's curvature."""

    k_p: float = 0.8
    k_i: float = 0.5
    k_d: float = 0.025
    preview: float = 0.3
    _sum: float = 0.0
    _last: float | None = None

    def __call__(self, track: Circuit, place: Place, wheelbase: float) -> float:
        """Commanded angle, rad."""
        lateral, _, curvature = _error(track, place, wheelbase + self.preview * max(place.v, 0.3))
        rate = 0.0 if self._last is None else (lateral - self._last) / PERIOD
        self._last = lateral
        self._sum = max(-0.2, min(0.2, self._sum + PERIOD * lateral))
        return atan(wheelbase * curvature) + self.k_p * lateral + self.k_i * self._sum + self.k_d * rate


@dataclass
class PurePursuit:
    """Circle through the rear axle and a point ahead on the path (Coulter, CMU-RI-TR-92-01)."""

    reach: float = 0.35
    reach_per_speed: float = 0.2

    def __call__(self, track: Circuit, place: Place, wheelbase: float) -> float:
        """Commanded angle, rad."""
        reach = self.reach + self.reach_per_speed * max(place.v, 0.0)
        k = (place.nearest + round(reach / (track.length / len(track.s)))) % len(track.s)
        direction = float(track.yaw[k])
        dx = float(track.x[k]) - place.offset * sin(direction) - place.x
        dy = float(track.y[k]) + place.offset * cos(direction) - place.y
        alpha = wrapped(atan2(dy, dx) - place.yaw)
        return atan(2.0 * wheelbase * sin(alpha) / max(hypot(dx, dy), 0.1))


@dataclass
class SpeedControl:
    """PI control of speed within limits of the current, with anti-windup.

    Attributes
    ----------
    k_p, k_i : A s/m, A/m.
    limits : lowest and highest current, A.
    ramp : fastest change of the current, A/s.
    """

    k_p: float = 5.0
    k_i: float = 3.0
    limits: tuple[float, float] = (-2.0, 9.0)
    ramp: float = 80.0
    _sum: float = 0.0
    _last: float = 0.0

    def __call__(self, target: float, v: float) -> float:
        """Commanded current, A."""
        error = target - v
        current = self.k_p * error + self._sum
        low, high = self.limits
        if low < current < high:
            self._sum += self.k_i * PERIOD * error
        step = self.ramp * PERIOD
        self._last = max(low, self._last - step, min(high, self._last + step, current))
        return self._last

    def release(self) -> None:
        """Set current and integral to zero."""
        self._sum = self._last = 0.0


@dataclass
class Driver:
    """Decides on steering and current every `PERIOD`.

    Attributes
    ----------
    track, speeds : path and speed at its points, m/s.
    steering : lateral controller.
    pauses : time intervals, s, in which the car should stand.
    wheelbase, l_r : m.
    offsets : (n,) lateral displacement of the line at the path's points, m; zero unless the run is a slalom.
    rng : random generator of localisation noise; none if None.
    """

    track: Circuit
    speeds: Array
    steering: Steering
    pauses: tuple[tuple[float, float], ...]
    wheelbase: float
    l_r: float
    offsets: Array
    rng: np.random.Generator | None = None
    speed_control: SpeedControl = field(default_factory=SpeedControl)
    _nearest: int = 0

    def __call__(self, time: float, car: CarMotion, v: float) -> tuple[float, float]:
        """Commanded steering angle, rad, and motor current, A, from the car's state and its measured speed v, m/s."""
        noise = self.rng.normal(0.0, (0.006, 0.006, 0.02)) if self.rng is not None else np.zeros(3)
        yaw = car.yaw + float(noise[2])
        x = car.x - self.l_r * cos(car.yaw) + float(noise[0])
        y = car.y - self.l_r * sin(car.yaw) + float(noise[1])
        window = np.arange(self._nearest - 15, self._nearest + 25) % len(self.track.s)
        distance = (self.track.x[window] - x) ** 2 + (self.track.y[window] - y) ** 2
        self._nearest = int(window[int(np.argmin(distance))])
        standing = any(start <= time < stop for start, stop in self.pauses)
        if standing and abs(v) < 0.15:
            self.speed_control.release()
            return 0.0, 0.0
        ahead = (self._nearest + round(0.12 * max(v, 0.0) / (self.track.length / len(self.track.s)))) % len(self.speeds)
        current = self.speed_control(0.0 if standing else float(self.speeds[ahead]), v)
        if standing:
            return 0.0, min(current, 0.0)
        place = Place(x, y, yaw, v, self._nearest, float(self.offsets[self._nearest]))
        return self.steering(self.track, place, self.wheelbase), current


def wrapped(angle: float) -> float:
    """Angle in [-pi, pi), rad."""
    return (angle + pi) % (2.0 * pi) - pi
