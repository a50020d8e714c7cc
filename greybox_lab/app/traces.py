"""Recordings as curves for a browser: read once, thinned to what a screen shows, thinned again where one zooms in."""

from __future__ import annotations

from functools import cached_property, lru_cache
from pathlib import Path
from threading import Lock
from typing import Any

import numpy as np
from numpy.typing import NDArray
from tsdownsample import NaNMinMaxLTTBDownsampler

import greybox_id as gb

Array = NDArray[np.float64]

THIN: Any = NaNMinMaxLTTBDownsampler()  # type: ignore[no-untyped-call]
OVERVIEW, DETAIL, ASIDE = 1000, 1000, 200
"""Points of a trace over everything; within the part that is looked at, and of everything beside that part."""
DIGITS = 5
"""Significant digits of a value that is drawn: finer than a pixel."""


class Shown:
    """A recording as it is drawn: its runs one behind the other where clocks begin anew."""

    def __init__(self, recording: gb.Recording) -> None:
        self.recording = recording

    @cached_property
    def laid(self) -> bool:
        """Whether runs had to be laid one behind the other, so that the axis is not the recording's clock."""
        return bool(np.any(np.diff(self.recording.time) < 0))

    @cached_property
    def time(self) -> Array:
        """(n,) s on the axis, from zero where runs are laid one behind the other."""
        time = np.array(self.recording.time, dtype=float)
        if not self.laid:
            return time
        end = 0.0
        step = self.recording.sample_time
        for start, stop in self.recording.runs:
            time[start:stop] += end - time[start]
            end = time[stop - 1] + 10 * step
        return time

    @property
    def span(self) -> tuple[float, float]:
        """First and last instant on the axis."""
        return float(self.time[0]), float(self.time[-1])

    def row(self, instant: float) -> int:
        """The row nearest to an instant."""
        return int(np.clip(np.searchsorted(self.time, instant), 0, len(self.time) - 1))

    def points(self, values: Array, most: int = OVERVIEW, window: tuple[float, float] | None = None) -> Array:
        """(k, 2) instant and value of some `most` points of a curve of (n,) values, in a window; NaN between runs."""
        curve: list[Array] = []
        inside = (0, len(self.time)) if window is None else tuple(map(int, np.searchsorted(self.time, window)))
        for start, stop in self.recording.runs:
            a, b = (min(max(edge, start), stop) for edge in inside)
            if b > a:
                share = max(3, most * (b - a) // (inside[1] - inside[0]))
                curve += [np.array([[curve[-1][-1, 0], np.nan]])] if curve else []
                curve.append(thinned(self.time[a:b], values[a:b], share))
        return np.concatenate(curve) if curve else np.empty((0, 2))

    def closer(self, values: Array, window: tuple[float, float], coarse: Array) -> Array:
        """A curve whose window is drawn finely; what is beside it is taken of its coarse points, (k, 2)."""
        low, high = np.searchsorted(coarse[:, 0], window)
        return np.concatenate((coarse[:low], self.points(values, DETAIL, window), coarse[high:]))

    def along(self, across: Array, up: Array, most: int = 3000) -> Array:
        """(k, 2) points of one signal over another, every so many rows: a map, speed against a_y."""
        step = max(1, len(across) // most)
        curve = [np.empty((0, 2))]
        for start, stop in self.recording.runs:
            rows = start + np.flatnonzero(np.isfinite(across[start:stop]) & np.isfinite(up[start:stop]))[::step]
            curve += [np.column_stack((_short(across[rows]), _short(up[rows]))), np.full((1, 2), np.nan)]
        return np.concatenate(curve[:-1])


def thinned(time: Array, values: Array, count: int) -> Array:
    """(k, 2) points of a curve, at most so many, its extremes among them; NaN where there is no value."""
    if len(time) > count and count >= 3:
        order = np.sort(THIN.downsample(time, np.ascontiguousarray(values), n_out=count))
        time, values = time[order], values[order]
    known = np.isfinite(values) & (np.abs(values) < 1e30)
    kept = known | np.concatenate(([False], known[:-1]))  # one break where readings are missing
    return np.column_stack((np.round(time, 4), np.where(known, _short(np.where(known, values, 0.0)), np.nan)))[kept]


def _short(values: Array) -> Array:
    """Values of so many digits as a screen shows."""
    size = np.floor(np.log10(np.where(values == 0.0, 1.0, np.abs(values))))
    scale = 10.0 ** np.clip(DIGITS - 1 - size, -22, 22)
    return np.asarray(np.round(values * scale) / scale)


READING = Lock()


def read(path: Path, columns: str | Path, between: str = "") -> gb.Recording:
    """A recording, read again only where the file, the map or the part has changed. Raises `BadInput`."""
    stamps = [place.stat().st_mtime if place.is_file() else 0.0 for place in (path, Path(columns))]
    with READING:  # who asks for what is being read waits for it
        return _read(path, columns, between, *stamps)


@lru_cache(maxsize=6)
def _read(path: Path, columns: str | Path, between: str, *stamps: float) -> gb.Recording:
    del stamps
    recording = gb.read(str(path), columns=columns)
    if isinstance(recording, list):
        raise gb.BadInput(
            f"{path}: *, ? and [ in a path are read as wildcards; rename the file or folder without them."
        )
    return recording.between(*(float(end) if end else None for end in between.split(":"))) if between else recording
