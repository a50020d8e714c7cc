"""A closed track: its middle line, how fast it can be driven, and where a vehicle is on it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline

Row = NDArray[np.float64]

CORNERS = (
    (0, 0), (8, 0), (8, 4), (4, 4), (4, 8), (8.5, 8), (8.5, 12), (3, 12), (0, 9), (-3, 12), (-8, 12), (-8, 8.5),
    (-3, 7.5), (-3, 4.5), (-8, 4.5), (-8, 0),
)  # fmt: skip
"""Of the middle line, before they are rounded."""
ROUNDED = 1.0
"""Standard deviation of what rounds them, in the unit of the corners."""
POINTS = 3000


@dataclass(frozen=True)
class Track:
    """The middle line in equal steps, and what is wanted on it.

    Attributes
    ----------
    s : (n,) distance along the line, m.
    x, y, yaw : (n,) of the line, m and rad; it begins at the origin, heading along x.
    curvature : (n,) 1/m, positive to the left.
    speed : (n,) m/s.
    half_width : from the middle line to where the vehicle's centre must not go, m.
    """

    s: Row
    x: Row
    y: Row
    yaw: Row
    curvature: Row
    speed: Row
    half_width: float

    @property
    def length(self) -> float:
        """m, of a lap."""
        return float(self.s[-1] + self.s[1])

    @property
    def spacing(self) -> float:
        """m, between points."""
        return float(self.s[1])

    def line(self, what: str, s: Row) -> tuple[Row, Row]:
        """A column, by name, at any distances, those of further laps included, and its change along s."""
        column, at = getattr(self, what), s / self.spacing
        k = np.floor(at).astype(int)
        here, ahead = column[k % len(column)], column[(k + 1) % len(column)]
        return here + (at - k) * (ahead - here), (ahead - here) / self.spacing

    def project(self, x: float, y: float, yaw: float, near: float) -> tuple[float, float, float]:
        """Distance along the line [m], lateral [m] and heading error [rad] of a pose that is not far from s = near."""
        spacing = self.s[1]
        k = (int(near / spacing) + np.arange(-60, 61)) % len(self.s)
        k = k[np.argmin((self.x[k] - x) ** 2 + (self.y[k] - y) ** 2)]
        c, d = np.cos(self.yaw[k]), np.sin(self.yaw[k])
        along, across = c * (x - self.x[k]) + d * (y - self.y[k]), c * (y - self.y[k]) - d * (x - self.x[k])
        along /= 1.0 - self.curvature[k] * across
        s = self.s[k] + along
        ahead = (s - near + 0.5 * self.length) % self.length - 0.5 * self.length
        heading = yaw - self.yaw[k] - self.curvature[k] * along
        return near + ahead, across, (heading + np.pi) % (2 * np.pi) - np.pi


def track(narrowest: float, half_width: float, grip: float, drive: float, brake: float, top_speed: float) -> Track:
    """The track of `CORNERS`, with the speeds that a friction ellipse allows.

    Parameters
    ----------
    narrowest : radius of the narrowest bend, m.
    half_width : m.
    grip : lateral acceleration to be used at most, m/s^2.
    drive, brake : accelerations to be used at most, m/s^2.
    top_speed : m/s.
    """
    corners = np.array([*CORNERS, CORNERS[0]]) @ [1.0, 1j]
    sides = np.concatenate(([0.0], np.cumsum(np.abs(np.diff(corners)))))
    at = 0.5 * sides[1] + np.linspace(0.0, sides[-1], POINTS, endpoint=False)
    angular = np.interp(at, sides, corners, period=sides[-1])
    rounding = np.exp(-0.5 * (2 * np.pi * np.fft.fftfreq(POINTS, at[1] - at[0]) * ROUNDED) ** 2)
    rounded = np.fft.ifft(np.fft.fft(angular) * rounding)
    ring = np.append(rounded, rounded[0])
    along = np.concatenate(([0.0], np.cumsum(np.abs(np.diff(ring)))))
    line = CubicSpline(along, ring, bc_type="periodic")(np.linspace(0.0, along[-1], POINTS, endpoint=False))

    ahead, bend = np.roll(line, -1) - np.roll(line, 1), np.roll(line, -1) - 2 * line + np.roll(line, 1)
    curvature = 4 * (ahead.conj() * bend).imag / np.abs(ahead) ** 3
    scale = narrowest * float(np.max(np.abs(curvature)))
    line, curvature = scale * (line - line[0]) * np.abs(ahead[0]) / ahead[0], curvature / scale
    s = np.arange(POINTS) * float(np.mean(np.abs(np.diff(line))))
    yaw = np.unwrap(np.angle(ahead / ahead[0]))
    speed = speeds(curvature, s[1], grip, drive, brake, top_speed)
    return Track(s, line.real, line.imag, yaw, curvature, speed, half_width)


def speeds(curvature: Row, spacing: float, grip: float, drive: float, brake: float, top_speed: float) -> Row:
    """Largest speeds, m/s, on a closed line: forwards as the drive allows, backwards as the brakes do."""
    v = np.minimum(top_speed, np.sqrt(grip / np.maximum(np.abs(curvature), 1e-9)))
    n = len(v)
    for direction, a_x in ((1, drive), (-1, brake)):
        for k in range(2 * n):  # twice around, so that it holds across the start
            here, there = direction * k % n, direction * (k + 1) % n
            left = max(0.0, 1.0 - (v[here] ** 2 * curvature[here] / grip) ** 2) ** 0.5
            v[there] = min(v[there], (v[here] ** 2 + 2.0 * spacing * a_x * left) ** 0.5)
    return v
