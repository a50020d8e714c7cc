"""How long a Runge-Kutta step may be before a vehicle's fastest motion makes it unstable or inaccurate."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ...parameter import Array
from .runs import Index, MotionRun
from .trace import MotionTrace

ACCURATE, STABLE = 1.0, 2.3
"""Largest product of step and eigenvalue: where the classical method is accurate to a few per mille, and where it is
stable (it is up to 2.78). The first is kept to in 95 % of the rows, the second in all of them."""
MOST_STEPS = 40
"""Steps per row at most: a vehicle that stands still is stiff, and uninteresting."""
SAMPLED_ROWS = 200
UNLIMITED = 1e10
"""Stands for parameters that mean no limit at all."""


def longest_segment(trace: MotionTrace, runs: Sequence[MotionRun], p: Array) -> float:
    """The longest segment, s, for these runs at these parameters."""
    model = trace.model
    shortest = min(run.sample_time for run in runs)
    states, segments = [], []
    for run in runs:
        rows = np.unique(np.linspace(0, len(run) - 1, max(3, SAMPLED_ROWS // len(runs))).astype(int))
        segment = np.zeros((len(rows), trace.segment_size))
        segment[:, 1 : 1 + len(model.inputs)] = run.inputs[rows]
        state = _between_readings(trace, run, rows)
        if np.any(np.isfinite(state)):
            states.append(np.nan_to_num(state))
            segments.append(segment)
    if not states or not trace.names:
        return shortest
    z = np.vstack(states)
    found = trace.stiffness(z, np.vstack(segments), np.where(np.isfinite(p), p, UNLIMITED))
    A = np.asarray(found).reshape(len(z), len(trace.names), len(trace.names))
    fastest = np.max(np.abs(np.linalg.eigvals(A[np.all(np.isfinite(A), axis=(1, 2))])), axis=1)
    if len(fastest) == 0:
        return shortest
    usual, most = max(float(np.quantile(fastest, 0.95)), 1e-9), max(float(np.max(fastest)), 1e-9)
    return float(np.clip(min(ACCURATE / usual, STABLE / most), shortest / MOST_STEPS, shortest))


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
