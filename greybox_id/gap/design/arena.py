"""The area of a manoeuvre: a straight, a disc, or the outline of a free area."""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ...base.errors import BadInput
from ...base.guard import protect
from ...base.shorthands import Array

WORDS = "straight:LENGTHxWIDTH, disc:RADIUS (in m), or a .csv file with columns x and y, the outline of a free area"
SMALLEST, LARGEST = 0.1, 1e5
"""Least and greatest size of an arena, m."""
TURNS = 24
"""Headings that are tried for a path in an outline."""
_STRAIGHT = re.compile(r"straight:([0-9.eE+]+)x([0-9.eE+]+)")
_DISC = re.compile(r"disc:([0-9.eE+]+)")


@dataclass(frozen=True)
class Placement:
    """Placement in an arena of a path that begins at the origin along x.

    Attributes
    ----------
    x, y, yaw : of its beginning, m and rad, in the arena's own axes.
    outside : m by which the path leaves the arena; negative: the room left.
    """

    x: float
    y: float
    yaw: float
    outside: float

    def placed(self, x: Array, y: Array) -> tuple[Array, Array]:
        """Points of the path in the arena's axes."""
        c, s = np.cos(self.yaw), np.sin(self.yaw)
        return self.x + c * x - s * y, self.y + s * x + c * y


NOWHERE = Placement(0.0, 0.0, 0.0, np.inf)
"""Placement of a path that fits nowhere."""


@dataclass(frozen=True)
class Arena:
    """A free area.

    Attributes
    ----------
    words : as the user described it.
    outline : (n, 2) corners, m, of a convex or concave area.
    radius : of a disc, m; 0 of any other.
    """

    words: str
    outline: Array
    radius: float = 0.0

    @property
    def length(self) -> float:
        """Its longest extent, m."""
        if self.radius:
            return 2.0 * self.radius
        apart = self.outline[:, None] - self.outline[None]
        return float(np.max(np.hypot(apart[..., 0], apart[..., 1])))

    @property
    def breadth(self) -> float:
        """Diameter of about the largest circle within it, m."""
        if self.radius:
            return 2.0 * self.radius
        low, high = np.min(self.outline, axis=0), np.max(self.outline, axis=0)
        grid = np.stack(np.meshgrid(*np.linspace(low, high, 41).T), axis=-1).reshape(-1, 2)
        return 2.0 * max(float(np.max(-_outside(self.outline, grid))), 0.0)

    def outside(self, x: Array, y: Array) -> float:
        """By how much points in its own axes lie outside, m; negative: the room left."""
        if self.radius:
            return float(np.max(np.hypot(x, y)) - self.radius)
        return float(np.max(_outside(self.outline, np.column_stack([x, y]))))

    def place(self, x: Array, y: Array) -> Placement:
        """The placement of a path that leaves most room.

        Parameters
        ----------
        x, y : (n,) points of the path, m, which begins at the origin along x.
        """
        if self.radius:
            cx, cy, reach = _circle(x, y)
            return Placement(-cx, -cy, 0.0, reach - self.radius)
        low, high = np.min(self.outline, axis=0), np.max(self.outline, axis=0)
        headings, shifts = np.linspace(0.0, 2.0 * np.pi, TURNS, endpoint=False), np.linspace(-0.5, 0.5, 5)
        if len(self.outline) == 4 and all(len(set(ends)) == 2 for ends in self.outline.T):  # along the axes
            headings, shifts = np.radians([0.0, -2.0, 2.0, -5.0, 5.0]), np.zeros(1)
        shares = np.stack(np.meshgrid(shifts, shifts), axis=-1).reshape(-1, 2)
        best, few = NOWHERE, _hull(np.column_stack([x, y]))
        for yaw in headings:
            c, s = np.cos(yaw), np.sin(yaw)
            turned = few @ np.array([[c, s], [-s, c]])
            least, most = np.min(turned, axis=0), np.max(turned, axis=0)
            middle, room = 0.5 * (low + high) - 0.5 * (least + most), high - low - (most - least)
            for moved in middle + shares * np.maximum(room, 0.0):
                out = float(np.max(_outside(self.outline, turned + moved)))
                if out < best.outside:
                    best = Placement(float(moved[0]), float(moved[1]), float(yaw), out)
        return best


def arena(words: str) -> Arena:
    """The arena that a description or a file defines. Raises `BadInput` where it defines none."""
    if result := _STRAIGHT.fullmatch(words):
        length, width = (_size(words, part) for part in result.groups())
        half = 0.5 * width
        return Arena(words, np.array([[0.0, -half], [length, -half], [length, half], [0.0, half]]))
    if result := _DISC.fullmatch(words):
        radius = _size(words, result.group(1))
        around = np.linspace(0.0, 2.0 * np.pi, 72, endpoint=False)
        return Arena(words, radius * np.column_stack([np.cos(around), np.sin(around)]), radius)
    if words.lower().endswith(".csv"):
        return Arena(words, _outline(Path(words)))
    raise BadInput(f"‹arena› {words!r:.60} is not an arena; an arena is {WORDS}.")


def _size(words: str, part: str) -> float:
    try:
        size = float(part)
    except ValueError:
        size = np.nan
    if not SMALLEST <= size <= LARGEST:
        raise BadInput(f"‹arena› {words!r:.60}: {part} is no size in m between {SMALLEST:g} and {LARGEST:g}.")
    return size


def _outline(path: Path) -> Array:
    import pandas as pd

    try:
        protect(path)
        table = pd.read_csv(path)
        corners = table[["x", "y"]].to_numpy(dtype=float)
    except OSError as error:
        raise BadInput(f"‹arena› {path} cannot be read: {error.strerror or error}.") from error
    except (ValueError, KeyError, UnicodeDecodeError) as error:
        raise BadInput(f"‹arena› {path} is not an outline: it must have columns x and y with numbers, in m.") from error
    if len(corners) > 1 and np.array_equal(corners[0], corners[-1]):
        corners = corners[:-1]
    if len(corners) < 3 or len(corners) > 5000 or not np.all(np.isfinite(corners)):
        raise BadInput(
            f"‹arena› {path}: an outline has 3 to 5000 corners, all of them numbers; this one has {len(corners)}."
        )
    return corners


def _outside(outline: Array, points: Array) -> Array:
    """(n,) m by which points lie outside an outline; negative inside."""
    a, b = outline, np.roll(outline, -1, axis=0)
    along = b - a
    to = points[:, None] - a[None]
    share = np.clip(np.sum(to * along, axis=-1) / np.maximum(np.sum(along**2, axis=-1), 1e-12), 0.0, 1.0)
    apart = to - share[..., None] * along
    distance = np.min(np.hypot(apart[..., 0], apart[..., 1]), axis=1)
    x, y = points[:, 0, None], points[:, 1, None]
    crosses = (a[:, 1] > y) != (b[:, 1] > y)
    with np.errstate(divide="ignore", invalid="ignore"):
        left = x < (b[:, 0] - a[:, 0]) * (y - a[:, 1]) / (b[:, 1] - a[:, 1]) + a[:, 0]
    inside = np.sum(crosses & left, axis=1) % 2 == 1
    return np.asarray(np.where(inside, -distance, distance))


def _hull(points: Array) -> Array:
    """The points' convex hull, for convex outlines, and a few points of the path, for others."""
    from scipy.spatial import ConvexHull, QhullError

    some = points[:: max(1, len(points) // 200)]
    try:
        return np.vstack([points[ConvexHull(points).vertices], some])
    except QhullError:  # a straight line
        return np.vstack([some, points[-1:]])


def _circle(x: Array, y: Array) -> tuple[float, float, float]:
    """Middle and radius of about the smallest circle around points (Badoiu & Clarkson's steps)."""
    points = np.column_stack([x, y])
    middle, best = 0.5 * (np.min(points, axis=0) + np.max(points, axis=0)), (0.0, 0.0, np.inf)
    for k in range(1, 60):
        apart = np.hypot(*(points - middle).T)
        far = int(np.argmax(apart))
        if apart[far] < best[2]:
            best = (float(middle[0]), float(middle[1]), float(apart[far]))
        middle = middle + (points[far] - middle) / (k + 2.0)
    return best
