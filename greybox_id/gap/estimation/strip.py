"""Data of the pictures of a gap: over time and path, spectrum, and map over speed and lateral acceleration."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from ...base.shorthands import Array
from ...base.statistics import welch
from ...datasets.recording import Recording
from ...engine.simulation import FreeRuns
from .calibration import CAL
from .noise import blocks


@dataclass(frozen=True)
class Strip:
    """Data of the pictures of a gap, per block of time.

    Attributes
    ----------
    time : (n,) s, middles of the blocks; where recordings' times start anew, runs are put one after the other.
    before, after : (n,) mean square of the errors over the noise's.
    x, y : (n,) m, the path as recorded, else integrated from speed and yaw rate; empty where neither is recorded.
    frequency : (k,) Hz.
    spectrum_before, spectrum_after : channel -> (k,) spectral density of the errors over that of the noise.
    map : "v_x" and "a_y": (cells + 1,) edges; "gap", "time": (v_x cells, a_y cells) shares of the gap and of the time,
        the first NaN in cells never driven.
    """

    time: Array
    before: Array
    after: Array
    x: Array
    y: Array
    frequency: Array
    spectrum_before: Mapping[str, Array]
    spectrum_after: Mapping[str, Array]
    map: Mapping[str, Array]


def strip(
    bench: FreeRuns,
    before: Array,
    after: Array,
    sd: Array,
    seen: Mapping[str, Array],
    excess: Array,
    recordings: Sequence[Recording] = (),
) -> Strip:
    """The pictures' data.

    Parameters
    ----------
    bench : whose rows.
    before, after : (N, channels) residuals, zero where nothing counts.
    sd : (channels,) of noise.
    excess : (N,) squares of errors over noise that make up the gap, for the map.
    recordings : whose rows these are, for the path.
    """
    channels = np.maximum(np.sum(bench.counted, axis=1), 1)
    first, then = (np.sum((item / sd) ** 2, axis=1) / channels for item in (before, after))
    parts = [slice(*ends) for ends in blocks(bench, CAL.strip_block)]
    time = running(bench.time)
    x, y = recorded_path(bench, recordings) or _path(bench, seen)
    frequency, spectra = np.empty(0), ({}, {})  # type: tuple[Array, tuple[dict[str, Array], dict[str, Array]]]
    longest = max(bench.rows, key=lambda rows: rows.stop - rows.start)
    window = min(256, longest.stop - longest.start)
    for c, channel in enumerate(bench.channels):
        if not np.any(bench.counted[longest, c]):
            continue
        for item, spectrum in zip((before, after), spectra, strict=True):
            frequency, density = welch(item[longest, c] / sd[c], 1 / bench.sample_time, window)
            spectrum[channel] = density / (2 * bench.sample_time)  # white noise of the stated size is one
    return Strip(
        time=np.array([float(np.mean(time[part])) for part in parts]),
        before=np.array([float(np.mean(first[part])) for part in parts]),
        after=np.array([float(np.mean(then[part])) for part in parts]),
        x=_middles(x, parts),
        y=_middles(y, parts),
        frequency=frequency,
        spectrum_before=spectra[0],
        spectrum_after=spectra[1],
        map=_map(excess, seen),
    )


def _middles(values: Array, parts: Sequence[slice]) -> Array:
    """Means over blocks; NaN for a block without readings, empty where there are no values."""
    if not len(values):
        return values
    read = [values[part][np.isfinite(values[part])] for part in parts]
    return np.array([float(np.mean(one)) if len(one) else np.nan for one in read])


def recorded_path(bench: FreeRuns, recordings: Sequence[Recording]) -> tuple[Array, Array] | None:
    """The path, if it is recorded for every row."""
    if not recordings or not all({"x", "y"} <= recording.signals.keys() for recording in recordings):
        return None
    time = np.concatenate([recording.time for recording in recordings])
    if len(time) != len(bench.measured) or not np.allclose(time, bench.time):
        return None
    x, y = (np.concatenate([recording[name] for recording in recordings]) for name in ("x", "y"))
    return (x, y) if np.any(np.isfinite(x) & np.isfinite(y)) else None


def _path(bench: FreeRuns, seen: Mapping[str, Array]) -> tuple[Array, Array]:
    if "v_x" not in seen or "yaw_rate" not in seen:
        return np.empty(0), np.empty(0)
    x, y = np.zeros(len(bench.measured)), np.zeros(len(bench.measured))
    for run, rows in zip(bench.runs, bench.rows, strict=True):
        steps = np.append(np.diff(run.time), 0.0)
        yaw = np.cumsum(seen["yaw_rate"][rows] * steps)
        x[rows] = np.cumsum(seen["v_x"][rows] * np.cos(yaw) * steps)
        y[rows] = np.cumsum(seen["v_x"][rows] * np.sin(yaw) * steps)
    return x, y


def _map(gap: Array, seen: Mapping[str, Array]) -> dict[str, Array]:
    if "v_x" not in seen or "a_y" not in seen:
        return {}
    v, a = seen["v_x"], seen["a_y"]
    edges = [_edges(item) for item in (v, a)]
    if any(edge[-1] <= edge[0] for edge in edges):
        return {}
    rows, _, _ = np.histogram2d(v, a, edges)
    total, _, _ = np.histogram2d(v, a, edges, weights=gap)
    share = np.where(rows > 0, total / max(float(np.sum(np.abs(total))), 1e-12), np.nan)
    return {"v_x": edges[0], "a_y": edges[1], "gap": share, "time": rows / max(len(v), 1)}


def _edges(values: Array) -> Array:
    low, high = (float(end) for end in np.quantile(values, [0.001, 0.999]))
    return np.linspace(low, high, CAL.strip_cells + 1)


def running(time: Array) -> Array:
    """Time that continues where it starts anew, as between recordings."""
    steps = np.diff(time, prepend=time[0] if len(time) else 0.0)
    usual = float(np.median(steps[steps > 0])) if np.any(steps > 0) else 1.0
    if np.all(steps >= 0):
        return time
    return np.asarray(time[0] + np.cumsum(np.where(steps < 0, usual, steps)))
