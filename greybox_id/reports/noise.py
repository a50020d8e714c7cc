"""The sensors' noise, heard where the vehicle gives no signal: straight at constant speed, else at rest."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..base.shorthands import Array
from ..base.statistics import detrended
from ..datasets.recording import Recording

REST_SHARE = 0.003
"""At rest: slower than this share of the top speed (the 99 % quantile of speed)."""
MOVING_SHARE, STEADY_SHARE = 0.2, 0.05
"""Straight at constant speed: faster than the first share of the top speed, smoothed yaw rate and change of speed
below the second share of their own 99 % quantile, or below what counts as none anyway."""
NO_TURN, NO_CHANGE = 0.01, 0.02
"""Yaw rate, rad/s, and change of speed, share of the top speed per second, that count as none."""
SMOOTHING = 0.5
"""s over which yaw rate and speed are smoothed before the stretch is judged."""
STRAIGHT_SECONDS, REST_SECONDS = 2.0, 1.0
"""Least length of a stretch."""


@dataclass(frozen=True)
class Noise:
    """Stretches without a signal.

    Attributes
    ----------
    where : "straight at constant speed" or "at rest".
    stretches : recording, first row, end row of each.
    """

    where: str
    stretches: tuple[tuple[Recording, int, int], ...]

    @property
    def seconds(self) -> float:
        """Their length together."""
        return float(sum((stop - start) * recording.sample_time for recording, start, stop in self.stretches))

    def of(self, name: str) -> list[Array]:
        """One signal on every stretch that has it whole, its trend removed."""
        result = [recording[name][start:stop] for recording, start, stop in self.stretches if name in recording]
        return [detrended(values) for values in result if np.all(np.isfinite(values))]

    def sd(self, name: str) -> float:
        """Standard deviation of one signal; nan where it was not recorded."""
        parts = self.of(name)
        return float(np.sqrt(np.mean(np.concatenate(parts) ** 2))) if parts else float("nan")


def noise(recordings: Sequence[Recording]) -> Noise | None:
    """Where noise can be heard alone in some recordings: straight at constant speed, else at rest, else None."""
    for where, stretches in (("straight at constant speed", _straight), ("at rest", _at_rest)):
        result = tuple((r, a, b) for r in recordings if "v_x" in r for a, b in stretches(r))
        if result:
            return Noise(where, result)
    return None


def _at_rest(recording: Recording) -> list[tuple[int, int]]:
    speed = np.abs(recording["v_x"])
    return _stretches(speed < REST_SHARE * _top(speed), recording, REST_SECONDS)


def _straight(recording: Recording) -> list[tuple[int, int]]:
    if "yaw_rate" not in recording:
        return []
    speed = recording["v_x"]
    turning, slope = np.abs(_smooth(recording, "yaw_rate")), np.zeros(len(recording))
    smooth = _smooth(recording, "v_x")
    for start, stop in recording.runs:
        if stop - start > 1:
            slope[start:stop] = np.abs(np.gradient(smooth[start:stop], recording.sample_time))
    top = _top(np.abs(speed))
    quiet = (speed > MOVING_SHARE * top) & (turning < max(STEADY_SHARE * _top(turning), NO_TURN))
    steady = slope < max(STEADY_SHARE * _top(slope), NO_CHANGE * top)
    return _stretches(quiet & steady, recording, STRAIGHT_SECONDS)


def _smooth(recording: Recording, name: str) -> Array:
    """Smoothed within runs; a missing value makes its neighbours missing."""
    length = max(1, round(SMOOTHING / recording.sample_time)) | 1
    result = recording[name].copy()
    for start, stop in recording.runs:
        mirrored = np.pad(recording[name][start:stop], length // 2, "symmetric")
        result[start:stop] = np.convolve(mirrored, np.full(length, 1.0 / length), "valid")
    return result


def _top(values: Array) -> float:
    known = values[np.isfinite(values)]
    return float(np.quantile(known, 0.99)) if known.size else 0.0


def _stretches(quiet: NDArray[np.bool_], recording: Recording, seconds: float) -> list[tuple[int, int]]:
    """Row ranges inside runs in which `quiet` holds for long enough."""
    least, result = round(seconds / recording.sample_time), []
    for start, stop in recording.runs:
        edges = np.flatnonzero(np.diff(np.concatenate(([0], quiet[start:stop].astype(np.int8), [0]))))
        result += [(start + int(a), start + int(b)) for a, b in edges.reshape(-1, 2) if b - a >= least]
    return result
