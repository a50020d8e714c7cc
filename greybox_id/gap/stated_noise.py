"""How large sensor noise is: as the vehicle's file says, or as readings tell that are smoother than what they read."""

from __future__ import annotations

import numpy as np

from ..parameter import Array
from ..vehicle import Vehicle
from .kinds import AnyBench

TOO_LARGE = 0.8
"""Noise that is stated is not believed where residuals are smaller than this share of it."""


def stated_noise(bench: AnyBench, vehicle: Vehicle | None, residuals: Array) -> tuple[Array, bool]:
    """Standard deviation of each channel's noise, (channels,), and whether all of them were stated.

    Parameters
    ----------
    bench : whose channels.
    vehicle : what is stated of its sensors; of a map with memory, what its training left, which holds in any case.
    residuals : (N, channels) of any model: a slow misfit does not count as noise.
    """
    stated = vehicle.noise if vehicle is not None else {}
    found, told = [], True
    for c, channel in enumerate(bench.channels):
        own = bench.counted[:, c]
        if not np.any(own):
            found.append(1.0)
            continue
        e = residuals[own, c]
        spread = 1.4826 * float(np.median(np.abs(e - np.median(e))))
        held = bench.learnt or spread > TOO_LARGE * stated.get(channel, 0.0)
        if channel in stated and held:
            found.append(stated[channel])
            continue
        told = told and channel in stated
        found.append(max(_fast(bench, c), 1e-9 * float(np.max(np.abs(bench.measured[own, c]))), 1e-12))
    return np.array(found), told


def _fast(bench: AnyBench, c: int) -> float:
    """Standard deviation of what changes from row to row faster than a straight line does."""
    seconds = [np.diff(bench.measured[rows, c], 2) for rows in bench.rows]
    bends = np.concatenate(seconds) if seconds else np.empty(0)
    bends = bends[np.isfinite(bends)]
    return float(1.4826 * np.median(np.abs(bends)) / np.sqrt(6)) if len(bends) else 1.0
