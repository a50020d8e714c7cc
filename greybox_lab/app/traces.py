"""Recordings as curves for a browser: read once, thinned to what a screen shows, thinned again where one zooms in."""

from __future__ import annotations

from functools import cached_property
from pathlib import Path
from threading import Lock
from typing import Any

import numpy as np
from numpy.typing import NDArray
from tsdownsample import NaNMinMaxLTTBDownsampler

import greybox_id as gb

Array = NDArray[np.float64]
Points = list[list[float] | None]

THIN: Any = NaNMinMaxLTTBDownsampler()  # type: ignore[no-untyped-call]
OVERVIEW, DETAIL, ASIDE = 1000, 1000, 200
"""Points of a trace over everything; within the part that is looked at, and then over each part beside it."""
DIGITS = 5
"""Significant digits of a value that is drawn: finer than a pixel."""


class Shown:
    """A recording as it is drawn: its runs one behind the other where clocks begin anew.

    Parameters
    ----------
    recording : as `gb.read` gave it.
    """

    def __init__(self, recording: gb.Recording) -> None:
        self.recording = recording

    @cached_property
    def laid(self) -> bool:
        """Whether runs had to be laid one behind the other, so that the axis is not the recording's clock."""
        time = self.recording.time
        return bool(np.any(np.diff(time) < 0))

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

    def points(self, values: Array, window: tuple[float, float] | None = None) -> Points:
        """A curve of (n,) values: everything coarsely, the window finely, nothing between runs."""
        curve: Points = []
        inside = (0, len(self.time)) if window is None else tuple(map(int, np.searchsorted(self.time, window)))
        for start, stop in self.recording.runs:
            curve += [None] if curve else []
            a, b = (min(max(edge, start), stop) for edge in inside)
            budget = OVERVIEW if window is None else DETAIL
            share = max(3, budget * (b - a) // max(1, inside[1] - inside[0]))
            beside = [max(3, ASIDE * (part) // len(self.time)) for part in (a - start, stop - b)]
            for first, last, count in ((start, a, beside[0]), (a, b, share), (b, stop, beside[1])):
                if last > first:
                    curve += thinned(self.time[first:last], values[first:last], count)
        return curve

    def along(self, across: Array, up: Array, most: int = 3000) -> Points:
        """Points of one signal over another, every so many rows: a map, speed against a_y."""
        step = max(1, len(across) // most)
        curve: Points = []
        for start, stop in self.recording.runs:
            rows = start + np.flatnonzero(np.isfinite(across[start:stop]) & np.isfinite(up[start:stop]))[::step]
            curve += [None] if curve else []
            curve += map(list, zip(_short(across[rows]), _short(up[rows]), strict=True))
        return curve


def thinned(time: Array, values: Array, count: int) -> Points:
    """At most so many points of a curve, its extremes among them; None where there is no value."""
    if len(time) > count and count >= 3:
        order = np.sort(THIN.downsample(time, np.ascontiguousarray(values), n_out=count))
        time, values = time[order], values[order]
    known = np.isfinite(values) & (np.abs(values) < 1e30)
    pairs: Points = list(map(list, zip(np.round(time, 4).tolist(), _short(np.where(known, values, 0.0)), strict=True)))
    if known.all():
        return pairs
    kept = np.flatnonzero(known | np.concatenate(([False], known[:-1])))  # one break where readings are missing
    return [pairs[k] if known[k] else None for k in kept]


def _short(values: Array) -> list[float]:
    """Values of so many digits as a screen shows."""
    size = np.floor(np.log10(np.where(values == 0.0, 1.0, np.abs(values))))
    scale = 10.0 ** np.clip(DIGITS - 1 - size, -22, 22)
    return list((np.round(values * scale) / scale).tolist())


class Library:
    """Recordings of a session, each read once; the last few are kept."""

    MOST = 6

    def __init__(self) -> None:
        self._kept: dict[tuple[str, str, str, float, float], gb.Recording] = {}
        self._reading = Lock()

    def read(self, path: Path, columns: str | Path, between: str = "") -> gb.Recording:
        """A recording, read again only where the file, the map or the part has changed. Raises `BadInput`."""
        with self._reading:  # who asks for what is being read waits for it
            return self._read(path, columns, between)

    def _read(self, path: Path, columns: str | Path, between: str) -> gb.Recording:
        stamp = path.stat().st_mtime if path.exists() else 0.0
        mapped = Path(columns)
        key = (str(path), str(columns), between, stamp, mapped.stat().st_mtime if mapped.is_file() else 0.0)
        if key not in self._kept:
            recording = gb.read(str(path), columns=columns)
            if isinstance(recording, list):
                raise gb.BadInput(f"{path.name}: its name is read as a pattern; rename the file.")
            if between:
                ends = [float(end) if end else None for end in between.split(":")]
                recording = recording.between(*ends)
            while len(self._kept) >= self.MOST:
                self._kept.pop(next(iter(self._kept)))
            self._kept[key] = recording
        return self._kept[key]
