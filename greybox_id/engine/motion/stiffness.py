"""How long a Runge-Kutta step may be before a vehicle's fastest motion makes it unstable or inaccurate."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.ndimage import maximum_filter1d

from ...parameter import Array
from .runs import Index, MotionRun
from .trace import MotionTrace

ACCURATE, STABLE = 1.0, 2.3
"""Largest product of step and eigenvalue: where the classical method is accurate to a few per mille, and where it is
stable (it is up to 2.78). The first is kept to in 95 % of the rows, the second in all of them."""
MOST_STEPS, SHORTEST = 40, 2.5e-4
"""Steps per row at most, unless they would be longer than so many seconds: a vehicle that stands still is stiff, and
uninteresting, but it must not be unstable. Rows at 25 Hz in 40 steps of 1 ms were, at the stiffness of a racing car,
and no parameter of it could be found."""
MOST_STEPS_OF_SLOW = 400
"""Steps per row at most, however far apart rows are."""
SAMPLED_ROWS = 200
FEW, ABOUT = 3.0, 0.5
"""Steps per row up to which all rows have as many; elsewhere a row has those of the stiffest within so many seconds,
for a simulation is not exactly where readings are."""
UNLIMITED = 1e10
"""Stands for parameters that mean no limit at all."""


def longest_segment(trace: MotionTrace, runs: Sequence[MotionRun], p: Array) -> float:
    """The longest segment, s, for these runs at these parameters."""
    shortest = min(run.sample_time for run in runs)
    sampled = [np.unique(np.linspace(0, len(run) - 1, max(3, SAMPLED_ROWS // len(runs))).astype(int)) for run in runs]
    told = [_fastest(trace, run, rows, p) for run, rows in zip(runs, sampled, strict=True)]
    fastest = np.concatenate([own[np.isfinite(own)] for own in told])
    if len(fastest) == 0:
        return shortest
    usual, most = max(float(np.quantile(fastest, 0.95)), 1e-9), max(float(np.max(fastest)), 1e-9)
    return float(np.clip(min(ACCURATE / usual, STABLE / most), least_segment(shortest), shortest))


def longest_segments(trace: MotionTrace, runs: Sequence[MotionRun], p: Array) -> list[Array]:
    """The longest segment, s, from each row of each run to the next, (n,) each.

    A vehicle that stands is stiff: what it needs there, it does not need at speed. The same as `longest_segment`
    everywhere where that cuts no row into more than a few.
    """
    usual = longest_segment(trace, runs, p)
    if min(run.sample_time for run in runs) <= FEW * usual:
        return [np.full(len(run), usual) for run in runs]
    found = []
    for run in runs:
        fastest = _fastest(trace, run, np.arange(len(run)), p)
        fastest = np.where(np.isfinite(fastest), fastest, ACCURATE / usual)
        near = 2 * max(1, round(ABOUT / run.sample_time)) + 1
        fastest = np.maximum(maximum_filter1d(fastest, near), 1e-9)
        found.append(np.clip(ACCURATE / fastest, usual, run.sample_time))
    return found


def _fastest(trace: MotionTrace, run: MotionRun, rows: Index, p: Array) -> Array:
    """(rows,) the largest eigenvalue of the motion at rows, 1/s; NaN where it cannot be told."""
    found = np.full(len(rows), np.nan)
    state = _between_readings(trace, run, rows)
    if not trace.names or not np.any(np.isfinite(state)):
        return found
    segment = np.zeros((len(rows), trace.segment_size))
    segment[:, 1 : 1 + len(trace.model.inputs)] = run.inputs[rows]
    told = trace.stiffness(np.nan_to_num(state), segment, np.where(np.isfinite(p), p, UNLIMITED))
    A = np.asarray(told).reshape(len(rows), len(trace.names), len(trace.names))
    finite = np.all(np.isfinite(A), axis=(1, 2))
    found[finite] = np.max(np.abs(np.linalg.eigvals(A[finite])), axis=1)
    return found


def least_segment(sample_time: float) -> float:
    """The shortest segment that rows this far apart are ever cut into, s."""
    return min(sample_time / MOST_STEPS, max(SHORTEST, sample_time / MOST_STEPS_OF_SLOW))


def _between_readings(trace: MotionTrace, run: MotionRun, rows: Index) -> Array:
    """States at rows, (rows, nz), straight between readings: a sensor that reads rarely is not at zero meanwhile."""
    state = np.full((len(rows), trace.size), np.nan)
    for k, name in enumerate(trace.names):
        if name in trace.model.outputs:
            reading = run.measured[:, trace.model.outputs.index(name)]
            read = np.isfinite(reading)
            if np.any(read):
                state[:, k] = np.interp(run.time[rows], run.time[read], reading[read])
    return state
