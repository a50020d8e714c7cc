"""A lidar on a track: how far its walls are along beams, many vehicles side by side.

The walls stand half a width from the middle line. How far a place is from them is known on a grid, and a beam is
followed by steps as long as that, which cross no wall (sphere tracing; Hart, The Visual Computer 12, 1996).
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.spatial import cKDTree

from greybox_id.base.machine_code import begun
from greybox_id.base.shorthands import Array

from .track import RaceTrack

BEAMS, FIELD_OF_VIEW, RANGE = 108, 1.5 * np.pi, 10.0
"""Beams, angle from the first to the last one, rad, and m that are seen at most: as published for a 1:10 car."""
NOISE, LOST = 0.04, 0.02
"""Standard deviation, m, and share of beams that return nothing, where there is noise: as published."""
FINE = 20
"""Places of the grid in half a width."""
NEAR = 1e-3
"""m from a wall at which a beam has reached it."""


class Lidar:
    """A lidar in the vehicle's centre of gravity, looking along x.

    Parameters
    ----------
    track : with its walls.

    Attributes
    ----------
    beams, range : how many there are, and m that they see at most.
    """

    beams, range = BEAMS, RANGE

    def __init__(self, track: RaceTrack) -> None:
        self._track, self._angles = track, np.linspace(-0.5, 0.5, BEAMS) * FIELD_OF_VIEW
        self._spacing = track.half_width / FINE
        line, margin = np.stack([track.x, track.y], axis=1), track.half_width + 2 * self._spacing
        self._corner = np.min(line, axis=0) - margin
        size = np.ceil((np.max(line, axis=0) + margin - self._corner) / self._spacing).astype(int) + 1
        places = self._corner + self._spacing * np.moveaxis(np.indices(size), 0, -1)
        self._room = track.half_width - cKDTree(line).query(places)[0]

    def scan(self, place: Array) -> Array:
        """(L, beams) m to the walls, from right to left.

        Parameters
        ----------
        place : (L, 3) s, e_y, m, and e_psi, rad.
        """
        s, e_y, e_psi = place.T
        x, y, yaw = (self._track.line(name, s)[0] for name in ("x", "y", "yaw"))
        # where the last point of the line meets the first, yaw has turned once and places have not
        lap = np.floor(s / self._track.spacing).astype(int) % len(self._track.s) == len(self._track.s) - 1
        yaw = np.where(lap, self._track.yaw[-1], yaw)
        at = np.stack([x - e_y * np.sin(yaw), y + e_y * np.cos(yaw)], axis=1)
        result = np.empty((len(place), BEAMS))
        _follow((at - self._corner) / self._spacing, yaw + e_psi, self._angles, self._room, self._spacing, result)
        return result

    def noisy(self, ranges: Array, lanes: Sequence[np.random.Generator]) -> Array:
        """(L, beams) m as sensors read them, each of its generator; a beam of which nothing returns reads `range`."""
        off, lost = np.empty_like(ranges), np.empty_like(ranges)
        for k, generator in enumerate(lanes):
            generator.standard_normal(out=off[k])
            generator.random(out=lost[k])
        return np.where(lost < LOST, RANGE, np.clip(ranges + NOISE * off, 0.0, RANGE))


@begun
def _follow(at, yaw, angles, room, spacing, result):  # type: ignore[no-untyped-def]  # pragma: no cover
    """Lengths of beams; places are in steps of the grid, room and lengths in m."""
    for k in range(len(at)):
        for j in range(len(angles)):
            c, s = np.cos(yaw[k] + angles[j]), np.sin(yaw[k] + angles[j])
            gone = 0.0
            while gone < RANGE:
                x, y = at[k, 0] + gone * c / spacing, at[k, 1] + gone * s / spacing
                if not (0.0 <= x < room.shape[0] - 1 and 0.0 <= y < room.shape[1] - 1):
                    break
                i, m = int(x), int(y)
                u, v = x - i, y - m
                free = (1 - u) * ((1 - v) * room[i, m] + v * room[i, m + 1])
                free += u * ((1 - v) * room[i + 1, m] + v * room[i + 1, m + 1])
                if free < NEAR:
                    break
                gone += free
            result[k, j] = min(gone, RANGE)
