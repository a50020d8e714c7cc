"""The truck's recordings as the benchmark's models see them: split, every tenth row, steering without its dead zone.

What `prepared` makes of the steering angles and of the speed is NOT CAUSAL: filters are centred, and a stretch in which
alpha1 rests at zero is bridged from both of its ends. The task, a free run along recorded inputs, allows that; a
controller could not do it. What `causal` makes of them knows no later row. Outputs (v_y and yaw rate) are taken as they
are.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from scipy.ndimage import median_filter, uniform_filter1d
from scipy.signal import savgol_filter

from greybox_id.base.errors import BadInput
from greybox_id.base.shorthands import Array
from greybox_id.datasets.read import read
from greybox_id.datasets.recording import Recording

RATE = 200.0
"""Hz, of the files."""
EVERY = 10
"""200 Hz to the published 0.05 s."""
SHORT = 120
"""Rows (0.6 s): a shorter rest at zero between two readings is crossed straight, a longer one is left and entered on
ramps of at most so many."""
SLOPE_OVER = 16
"""Rows over which the slope of such a ramp is taken."""
EARLY = 17
"""Rows (85 ms) by which alpha2 leads alpha1."""
ORIGIN = (47.5342, -0.6355)
"""Latitude and longitude, deg, of the middle of the track."""
METRES_PER_DEGREE = (111132.0, 111320.0 * np.cos(np.radians(ORIGIN[0])))
ROAD = (0.755, -0.656)
"""East and north along the track's straights."""

SPLITS = ("train", "val", "test")
SECONDS, NEARLY = 10.0, 0.02
"""Of a chunk, and the share by which one may last or be sampled differently."""
HELD_OUT = 3
"""Every so many-th recording is held out where the split is by recording."""

HELD_FOR = {"held_short": 0.2, "held": 1.0, "held_long": 5.0}
"""Signal -> s in which what alpha1 read last fades while it rests: from what a slalom takes through the dead zone to
what a straight lasts. How much of each there is, is fitted."""
LINE = (40, 201)
"""Rows (0.2 s, 1 s) that a line through the last speeds takes at least and at most."""

Filter = Callable[[Array], Array]


def published_signs(path: Path) -> Recording:
    """The file as if all its signs were of one frame, as the publication takes them."""
    recording = raw(path)
    return recording.with_signals(yaw_rate=-recording["yaw_rate"], steer=-recording["steer"])


def raw(path: Path) -> Recording:
    """Every tenth row of a file, in ISO signs."""
    return read(path, "truck").every(EVERY)


def prepared(path: Path) -> Recording:
    """The same with speed and steering angles smoothed, alpha1 bridged, and what else the models read.

    Further signals: v_x_rate [m/s^2]; at_rest, the share of 0.1 s about a row in which alpha1 still rests at zero after
    bridging. Where alpha2 was recorded: alpha2 [rad]; alpha2_at_rest, that share of alpha2 85 ms ago [rad]. Where
    position was: x, y, metres east and north of the track's middle; along_road, the cosine of the angle between course
    and straights.
    """
    result = read(path, "truck")
    runs = result.runs
    bridged = np.concatenate([_bridged(result["steer"][a:b]) for a, b in runs])
    resting = _each((np.abs(bridged) < 1e-9).astype(float), runs, lambda z: _mean(z, 21))
    more = {
        "steer": _each(bridged, runs, lambda a: _mean(a, 21)),
        "v_x": _each(result["v_x"], runs, lambda v: savgol_filter(v, 41, 1)),
        "v_x_rate": _each(result["v_x"], runs, lambda v: savgol_filter(v, 201, 2, deriv=1, delta=1 / RATE)),
        "at_rest": resting,
    }
    if "alpha2" in result.signals:
        second = _each(result["alpha2"], runs, lambda a: _mean(_median(a, 5), 11))
        more |= {"alpha2": second, "alpha2_at_rest": resting * _each(second, runs, _later)}
    if {"longitude", "latitude"} <= set(result.signals):
        x = (result["longitude"] - ORIGIN[1]) * METRES_PER_DEGREE[1]
        y = (result["latitude"] - ORIGIN[0]) * METRES_PER_DEGREE[0]
        east, north = (_each(v, runs, lambda v: savgol_filter(v, 101, 1, deriv=1)) for v in (x, y))
        course = np.hypot(east, north)
        along = (ROAD[0] * east + ROAD[1] * north) / np.where(course > 0, course, 1.0)
        more |= {"x": x, "y": y, "along_road": along}
    return result.with_signals(**more).every(EVERY)


def causal(path: Path) -> Recording:
    """alpha1 and speed as recorded, with further signals that know no later row.

    v_x_rate [m/s^2], a line through the last second. While alpha1 rests at zero: what it read last, fading as
    `HELD_FOR` says [rad], and `sliding` [rad], how far it would have come at the slope it had, fading with the first of
    them. While it does not: `turning` [rad/s], its slope.
    """
    result = read(path, "truck")
    runs = result.runs
    kept = [_remembered(result["steer"][a:b]) for a, b in runs]
    level, since, slope = (np.concatenate([item[k] for item in kept]) for k in range(3))
    fading = {name: np.where(since > 0, np.exp(-since / tau), 0.0) for name, tau in HELD_FOR.items()}
    more = {name: level * item for name, item in fading.items()}
    more |= {"sliding": slope * since * fading["held_short"], "turning": np.where(since > 0, 0.0, slope)}
    more |= {"v_x_rate": _each(result["v_x"], runs, _rise)}
    return result.with_signals(**more).every(EVERY)


@dataclass(frozen=True)
class Chunks:
    """Trajectories of 10 s, and the recording of the truck that each is a piece of.

    Attributes
    ----------
    recording : the trajectories as runs.
    piece_of : (trajectories,) number of the recording's first trajectory.
    """

    recording: Recording
    piece_of: Array

    def of(self, which: NDArray[np.bool_], name: str) -> Chunks:
        """Some of the trajectories, (trajectories,) bool."""
        value = self.recording
        runs = [run for run, taken in zip(value.runs, which, strict=True) if taken]
        rows = np.concatenate([np.arange(a, b) for a, b in runs])
        stops = np.cumsum([b - a for a, b in runs]).tolist()
        chosen = value.taken(rows, zip([0, *stops[:-1]], stops, strict=True))
        return Chunks(replace(chosen, name=name), self.piece_of[which])


def chunks(path: Path, prepare: Any = raw) -> Chunks:
    """The trajectories of a file. A chunk's number less its first second over ten is its recording's first chunk.

    Raises
    ------
    BadInput : the file is none of the truck's, or not recorded as these are.
    """
    result: Recording = prepare(path)
    _must_be_chunks(path, result)
    table = pd.read_parquet(path, columns=["trajectory", "time"])
    begun = table.groupby("trajectory", sort=False)["time"].first()
    numbers = begun.index.to_numpy(dtype=float) - np.round(begun.to_numpy(dtype=float) / SECONDS)
    if len(numbers) != len(result.runs):
        raise BadInput(f"{path} has {len(numbers)} trajectories in {len(result.runs)} unbroken runs; is it complete?")
    return Chunks(result, numbers)


def _must_be_chunks(path: Path, one: Recording) -> None:
    """Raise `BadInput` where the published metric cannot be taken of a file: ten seconds at 200 Hz, nothing missing."""
    for number, (a, b) in enumerate(one.runs, 1):
        apart = float(np.median(np.diff(one.time[a:b]))) if b - a > 1 else np.inf
        lasts = apart * (b - a)
        if abs(lasts / SECONDS - 1) > NEARLY or abs(apart * RATE / EVERY - 1) > NEARLY:
            raise BadInput(
                f"{path}: the metric is over trajectories of {SECONDS:g} s at {RATE:g} Hz, but number {number} lasts "
                f"{lasts:.3g} s at {EVERY / apart:.3g} Hz. Cut or resample the file to such chunks."
            )
    for name in ("v_x", "steer", "v_y", "yaw_rate"):
        lacking = np.flatnonzero(~np.isfinite(one[name]))
        if len(lacking):
            raise BadInput(
                f"{path} has no reading of {name} in {len(lacking)} of {len(one)} rows; the metric needs all. Leave "
                "out these trajectories."
            )


def splits(data: Path, prepare: Any, by_recording: bool) -> dict[str, Chunks]:
    """Split -> trajectories; test where its file is there."""
    result = {split: chunks(data / f"{split}.parquet", prepare) for split in SPLITS[:2]}
    if by_recording:
        both = _joined(result["train"], result["val"])
        held = np.isin(both.piece_of, np.unique(both.piece_of)[HELD_OUT - 1 :: HELD_OUT])
        result = {"train": both.of(~held, "train, by recording"), "val": both.of(held, "val, by recording")}
    elif (data / "test.parquet").is_file():
        result["test"] = chunks(data / "test.parquet", prepare)
    return result


def by_speed(result: dict[str, Chunks], slow: float, fast: float) -> dict[str, Chunks]:
    """Trajectories no faster than `slow` [m/s] of train and val, and "fast": those of both whose mean is above `fast`.

    Of a recording that has a fast trajectory no slow one is taken. Empty where one of the three would be.
    """
    both = _joined(result["train"], result["val"])
    speed = [both.recording["v_x"][a:b] for a, b in both.recording.runs]
    quick = np.array([np.mean(item) > fast for item in speed])
    calm = np.array([np.max(item) <= slow for item in speed]) & ~np.isin(both.piece_of, both.piece_of[quick])
    of_train = np.arange(len(calm)) < len(result["train"].piece_of)
    taken = {"train": calm & of_train, "val": calm & ~of_train, "fast": quick}
    if not all(np.any(which) for which in taken.values()):
        return {}
    return {split: both.of(which, f"{split}, by speed") for split, which in taken.items()}


def _joined(one: Chunks, other: Chunks) -> Chunks:
    a, b = one.recording, other.recording
    shift = len(a)
    runs = (*a.runs, *((start + shift, stop + shift) for start, stop in b.runs))
    signals = {
        name: np.concatenate([signal, b.signals[name]]) for name, signal in a.signals.items() if name in b.signals
    }
    whole = replace(a, time=np.concatenate([a.time, b.time]), signals=signals, runs=runs)
    return Chunks(whole, np.concatenate([one.piece_of, other.piece_of]))


def _bridged(steer: Array) -> Array:
    """alpha1 (n,) without its rests at zero, where its neighbours tell what is between them."""
    result = steer.copy()
    for begin, end in _rests(steer):
        before, after = steer[:begin][::-1], steer[end:]  # both lead away from the rest
        if len(before) and len(after) and end - begin <= SHORT:
            result[begin:end] = np.linspace(before[0], after[0], end - begin + 2)[1:-1]
            continue
        if len(after):
            ramp = _ramp(after, end - begin)
            result[end - len(ramp) : end] = ramp[::-1]
        if len(before):
            ramp = _ramp(before, end - begin)
            result[begin : begin + len(ramp)] = ramp
    return _median(result, 9)


def _rests(steer: Array) -> Iterator[tuple[int, int]]:
    edges = np.flatnonzero(np.diff(np.concatenate(([False], steer == 0, [False])).astype(int)))
    return zip(edges[::2].tolist(), edges[1::2].tolist(), strict=True)


def _ramp(away: Array, longest: int) -> Array:
    """Down to zero from the first of some readings, as steep as they rise."""
    near, far = away[:5], away[SLOPE_OVER : SLOPE_OVER + 5]
    rise = (np.median(far) - np.median(near)) / SLOPE_OVER if len(far) else 0.0
    rows = away[0] / rise if away[0] * rise > 0 else np.inf
    rows = max(1, int(min(rows, SHORT, longest)))
    return np.asarray(away[0] * (1 - np.arange(1, rows + 1) / rows))


def _remembered(steer: Array) -> tuple[Array, Array, Array]:
    """At every row the last reading of alpha1 that is not zero, s since, and its slope then, rad/s; before it zeros."""
    step, rows = 1 / RATE, np.arange(len(steer))
    last = np.maximum.accumulate(np.where(steer != 0, rows, -1))
    known = np.maximum(last, 0)
    before = known - SLOPE_OVER
    steady = (before >= 0) & (steer[np.maximum(before, 0)] != 0)
    slope = np.where(steady, (steer[known] - steer[np.maximum(before, 0)]) / (SLOPE_OVER * step), 0.0)
    heard = last >= 0
    return np.where(heard, steer[known], 0.0), np.where(heard, (rows - known) * step, 0.0), np.where(heard, slope, 0.0)


def _rise(v: Array) -> Array:
    """(..., n) slope of a line through the last rows, per s; zero where there are too few."""
    least, most = LINE
    padded = np.concatenate([np.zeros((*v.shape[:-1], 1)), np.cumsum(v, axis=-1)], axis=-1)
    weighted = np.concatenate([np.zeros((*v.shape[:-1], 1)), np.cumsum(v * np.arange(v.shape[-1]), axis=-1)], axis=-1)
    stop = np.arange(1, v.shape[-1] + 1)
    start = np.maximum(stop - most, 0)
    count, middle = stop - start, (start + stop - 1) / 2
    covered = weighted[..., stop] - weighted[..., start] - middle * (padded[..., stop] - padded[..., start])
    return np.asarray(np.where(count >= least, covered / np.maximum(count * (count**2 - 1.0) / 12, 1.0), 0.0) * RATE)


def _each(values: Array, runs: tuple[tuple[int, int], ...], change: Filter) -> Array:
    """A filter of the last axis run by run; all at once where all are equally long, as they are in these files."""
    lengths = {b - a for a, b in runs}
    if len(lengths) == 1:
        return change(values.reshape(len(runs), -1)).ravel()
    return np.concatenate([change(values[a:b]) for a, b in runs])


def _mean(values: Array, rows: int) -> Array:
    return np.asarray(uniform_filter1d(values, rows, axis=-1, mode="nearest"))


def _median(values: Array, rows: int) -> Array:
    return np.asarray(median_filter(values, (1,) * (values.ndim - 1) + (rows,), mode="nearest"))


def _later(values: Array) -> Array:
    return np.concatenate([np.repeat(values[..., :1], EARLY, axis=-1), values[..., :-EARLY]], axis=-1)
