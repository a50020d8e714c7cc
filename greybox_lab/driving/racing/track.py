"""A closed track: its middle line, how fast it can be driven, and where a vehicle is on it."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline

from greybox_id.base.errors import BadInput
from greybox_id.base.files import small_file

from ...virtual.speed_profile import speed_profile

Row = NDArray[np.float64]
Line = NDArray[np.complex128]

CORNERS = (
    (0, 0), (8, 0), (8, 4), (4, 4), (4, 8), (8.5, 8), (8.5, 12), (3, 12), (0, 9), (-3, 12), (-8, 12), (-8, 8.5),
    (-3, 7.5), (-3, 4.5), (-8, 4.5), (-8, 0),
)  # fmt: skip
"""Of the middle line, before they are rounded."""
ROUNDED = 1.0
"""Standard deviation of what rounds them, in the unit of the corners."""
POINTS = 3000
FEWEST = 8
"""Points that a track's middle line is stated by at least."""


@dataclass(frozen=True)
class Usage:
    """What of a vehicle a speed profile uses.

    Attributes
    ----------
    grip : lateral acceleration at most, m/s^2.
    drive, brake : accelerations at most, m/s^2.
    top_speed : m/s.
    """

    grip: float
    drive: float
    brake: float
    top_speed: float


@dataclass(frozen=True)
class RaceTrack:
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


def track(narrowest: float, half_width: float, limits: Usage) -> RaceTrack:
    """The track of `CORNERS`, with the speeds that a friction ellipse allows.

    Parameters
    ----------
    narrowest : radius of the narrowest bend, m.
    half_width : m.
    limits : what of the vehicle is to be used.
    """
    corners = np.array([*CORNERS, CORNERS[0]]) @ [1.0, 1j]
    sides = np.concatenate(([0.0], np.cumsum(np.abs(np.diff(corners)))))
    at = 0.5 * sides[1] + np.linspace(0.0, sides[-1], POINTS, endpoint=False)
    angular = np.interp(at, sides, corners, period=sides[-1])
    rounding = np.exp(-0.5 * (2 * np.pi * np.fft.fftfreq(POINTS, at[1] - at[0]) * ROUNDED) ** 2)
    line, curvature = _even(np.fft.ifft(np.fft.fft(angular) * rounding))
    scale = narrowest * float(np.max(np.abs(curvature)))
    return _along(scale * line, curvature / scale, half_width, limits)


def read_track(path: str | Path, limits: Usage, half_width: float | None = None) -> RaceTrack:
    """A closed track from a table of its middle line.

    Parameters
    ----------
    path : a CSV file whose first two columns are x and y, m, and whose next two, where they are there, the widths to
        the right and to the left, m, as race stacks of 1:10 cars write it; a line that names them may begin with #.
    limits : what of the vehicle is to be used.
    half_width : m; None: the narrowest place that the file states.

    Raises
    ------
    BadInput : it cannot be read, is no such table, crosses no area, or states no width.
    """
    text = small_file(path, "track file").decode("utf-8", "replace")
    rows = [line.replace(";", ",").split(",") for line in text.splitlines() if line.strip() and not _heads(line)]
    try:
        table = np.array([[float(entry) for entry in row] for row in rows])
    except ValueError as error:
        raise BadInput(f"{path}: rows of x, y [, widths right and left] in m are needed, with commas.") from error
    if table.ndim != 2 or not 2 <= table.shape[1] <= 8 or not FEWEST <= len(table) <= 100 * POINTS:
        raise BadInput(f"{path}: a closed line of {FEWEST} points or more is needed, x and y in its first two columns.")
    if not np.all(np.isfinite(table)):
        raise BadInput(f"{path}: a number is missing or not finite.")
    if half_width is None:
        if table.shape[1] < 4:
            raise BadInput(f"{path} has no columns of widths; state half the width of the track (half_width).")
        half_width = float(np.min(table[:, 2:4]))
    points = table[:, 0] + 1j * table[:, 1]
    points = points[np.abs(points - np.roll(points, 1)) > 0]
    if len(points) < FEWEST or abs(np.sum((np.conj(points) * np.roll(points, -1)).imag)) < 1e-9:
        raise BadInput(f"{path}: the line encloses no area; list the points of a closed track in their order.")
    line, curvature = _even(points)
    if not half_width > 0 or half_width * float(np.max(np.abs(curvature))) >= 1.0:
        raise BadInput(
            f"{path}: the half width of {half_width:g} m must be above zero and below the radius of the narrowest bend."
        )
    return _along(line, curvature, half_width, limits)


def _heads(line: str) -> bool:
    """Whether a line is a heading: a comment, or words."""
    return line.lstrip().startswith("#") or any(letter.isalpha() and letter not in "eE" for letter in line)


def _even(points: Line) -> tuple[Line, Row]:
    """A closed line through points, in equal steps, and its curvature."""
    ring = np.append(points, points[0])
    along = np.concatenate(([0.0], np.cumsum(np.abs(np.diff(ring)))))
    line = CubicSpline(along, ring, bc_type="periodic")(np.linspace(0.0, along[-1], POINTS, endpoint=False))
    ahead, bend = np.roll(line, -1) - np.roll(line, 1), np.roll(line, -1) - 2 * line + np.roll(line, 1)
    return line, 4 * (ahead.conj() * bend).imag / np.abs(ahead) ** 3


def _along(line: Line, curvature: Row, half_width: float, limits: Usage) -> RaceTrack:
    ahead = np.roll(line, -1) - np.roll(line, 1)
    line = (line - line[0]) * np.abs(ahead[0]) / ahead[0]
    s: Row = np.arange(POINTS, dtype=float) * float(np.mean(np.abs(np.diff(line))))
    yaw: Row = np.unwrap(np.angle(ahead / ahead[0])).astype(float)
    speed = speed_profile(curvature, float(s[1]), **vars(limits))
    return RaceTrack(s, line.real, line.imag, yaw, curvature, speed, half_width)
