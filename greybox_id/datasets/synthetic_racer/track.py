"""Closed paths to drive on and the speeds to drive them at."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline

Array = NDArray[np.float64]

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
    # The spline's curvature has corners; 0.1 m of smoothing makes a line a driver can follow.
    xy = _smooth(curve(np.interp(s, arc, dense)), 0.1 / SPACING)
    ahead, behind = np.roll(xy, -1, axis=0), np.roll(xy, 1, axis=0)
    step = arc[-1] / n
    d1, d2 = (ahead - behind) / (2 * step), (ahead - 2 * xy + behind) / step**2
    curvature = (d1[:, 0] * d2[:, 1] - d1[:, 1] * d2[:, 0]) / np.hypot(*d1.T) ** 3
    return Circuit(s, float(arc[-1]), xy[:, 0], xy[:, 1], np.unwrap(np.arctan2(d1[:, 1], d1[:, 0])), curvature)


def raceline(rng: np.random.Generator, clockwise: bool = False) -> Circuit:
    """The synthetic track, its corners moved a few centimetres for this run.

    Parameters
    ----------
    rng : source of the run's own line.
    clockwise : drive it the other way round, so that right turns prevail.
    """
    points = _CORNERS + rng.normal(0.0, 0.035, _CORNERS.shape)
    if clockwise:
        points = np.roll(points[::-1], 1, axis=0)
    return closed_track(points)


def speed_profile(track: Circuit, v_max: float, a_y_max: float, a_x_max: float) -> Array:
    """Highest speeds along a path within acceleration limits, m/s.

    The lateral limit bounds the speed at each point; then the speed may rise forwards and fall backwards no faster than
    what the ellipse of both limits leaves.

    Parameters
    ----------
    track : the path.
    v_max : m/s.
    a_y_max, a_x_max : m/s^2.

    Returns
    -------
    (n,) m/s.
    """
    bend = np.abs(track.curvature)
    v = np.minimum(v_max, np.sqrt(a_y_max / np.maximum(bend, 1e-6)))
    step, n = track.length / len(v), len(v)
    for direction in (1, -1):
        # Two laps, so that the limit also holds across the start.
        for k in range(2 * n):
            here, there = direction * k % n, direction * (k + 1) % n
            left = max(0.0, 1.0 - (v[here] ** 2 * bend[here] / a_y_max) ** 2)
            v[there] = min(v[there], np.sqrt(v[here] ** 2 + 2.0 * step * a_x_max * np.sqrt(left)))
    return np.asarray(_smooth(v[:, None], 0.1 / SPACING)[:, 0], dtype=float)


def _smooth(values: Array, width: float) -> Array:
    """Gaussian smoothing around a closed line; `width` is the standard deviation in points."""
    n = len(values)
    frequency = np.fft.rfftfreq(n)
    gain = np.exp(-2.0 * (np.pi * frequency * width) ** 2)
    return np.asarray(np.fft.irfft(np.fft.rfft(values, axis=0) * gain[:, None], n, axis=0), dtype=float)
