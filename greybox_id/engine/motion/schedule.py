"""Segments: the stretches of a run between any two instants at which a command changes or something is read.

Delays and latencies move such instants, and segments' lengths with them: a delay of 3.7 samples is a segment of 0.7 of
a sample, not an interpolation. Every instant is a row's time, moved by at most one shift, so that how segments move
with shifts is a matter of plus and minus ones.

How long a segment may be follows from the vehicle's fastest motion: a Runge-Kutta step that is longer is unstable or
inaccurate.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from ...base.shorthands import Array, Index
from ...base.windows import moving_maximum
from .runs import MotionRun
from .trace import MotionTrace

AT_ONCE = 1e-9
"""Instants no further apart than this, s, are one: sums of times and shifts are rounded."""


@dataclass(frozen=True)
class Schedule:
    """The segments of one run.

    Attributes
    ----------
    segments : (S, segment size) data of each segment.
    row_segment : (n,) segment that starts at a row, just after its commands were applied.
    read_segment : (n, outputs) segment at whose start a row's reading of an output was taken; -1 before the run began.
    reads : (S,) whether anything is read at a segment's start.
    """

    segments: Array
    row_segment: Index
    read_segment: Index
    reads: NDArray[np.bool_]

    @cached_property
    def taken(self) -> Index:
        """(n * outputs,) where the reading of each row stands among all that are taken, -1 where none is."""
        outputs = self.read_segment.shape[1]
        rank = (np.cumsum(self.reads) - 1)[np.maximum(self.read_segment, 0)]
        return np.asarray(np.where(self.read_segment >= 0, rank * outputs + np.arange(outputs), -1).ravel())

    @cached_property
    def complete(self) -> bool:
        """Whether every reading is taken."""
        return bool(np.all(self.taken >= 0))


def schedule(
    trace: MotionTrace,
    run: MotionRun,
    shifts: Array,
    longest: float | Array,
    moving: Sequence[bool] | None = None,
    read: NDArray[np.bool_] | None = None,
) -> Schedule:
    """Lay a run out in segments.

    Parameters
    ----------
    trace : the model.
    run : the run.
    shifts : the delays' and latencies' values, s.
    longest : no segment is longer than this, s; one number, or (n,) from each row to the next.
    moving : which shifts are differentiated by; the others, where they are zero, cut nothing, and where their readings
        are late at instants that are there already, nothing there. None: all of them.
    read : (n,) rows at which something may be read late; at the others latencies cut nothing. None: all of them.
    """
    rows, delays = len(run), len(trace.delayed)
    cuts = [k for k, shift in enumerate(shifts) if moving is None or moving[k] or shift != 0]
    parts = np.broadcast_to(segments_of_rows(run, longest), rows)
    steps = np.append(np.diff(run.time), run.sample_time)
    inside = [np.flatnonzero(parts > k) for k in range(1, int(np.max(parts)))]
    within = [run.time[item] + steps[item] * k / parts[item] for k, item in enumerate(inside, 1)]
    every = np.arange(rows)
    late_rows = every if read is None else np.flatnonzero(read)
    late = [run.time[late_rows] - shifts[k] for k in cuts if k >= delays]
    delayed = [run.time + shifts[k] for k in cuts if k < delays]
    # At the same instant: delayed commands arrive first, then rows' own, then late readings are taken.
    first_late = sum(k < delays for k in cuts)
    kinds = [*cuts[:first_late], -1, *cuts[first_late:], *(-2 for _ in within)]
    times = [*delayed, run.time, *late, *within]
    counts = [len(time) for time in times]
    instant, kind = np.concatenate(times), np.repeat(kinds, counts)
    row = np.concatenate([*[every] * (len(delayed) + 1), *[late_rows] * len(late), *inside])
    order = _in_time(instant, np.repeat(np.arange(len(times)), counts))
    order = order[(instant[order] >= run.time[0] - AT_ONCE) & (instant[order] <= run.time[-1] + AT_ONCE)]
    first = int(np.flatnonzero((kind[order] == -1) & (row[order] == 0))[0])
    instant, kind, row = (values[order[first:]] for values in (instant, kind, row))
    instant = np.maximum.accumulate(instant)
    fixed = [k for k in cuts if k >= delays and moving is not None and not moving[k]]
    same = np.append(False, np.diff(instant) <= AT_ONCE) & np.isin(kind, fixed)  # read with what is there already
    held, taker, late_kind, late_row = ~same, np.cumsum(~same) - 1, kind, row
    instant, kind, row = instant[held], kind[held], row[held]

    count = len(shifts)
    sign = np.zeros((len(kind), count))
    for k in cuts:
        sign[kind == k, k] = 1.0 if k < delays else -1.0
    length = np.append(np.diff(instant), 0.0)
    length_by = np.vstack([np.diff(sign, axis=0), np.zeros((1, count))])
    values, slopes = _commands(trace, run, instant, kind, row, shifts, cuts)
    guess = np.broadcast_to(shifts, (len(kind), count))
    segments = np.column_stack([length, values, slopes, length_by, sign, guess])

    places = np.arange(len(kind))
    row_segment = np.empty(rows, dtype=np.intp)
    row_segment[row[kind == -1]] = places[kind == -1]
    taken = np.tile(row_segment[:, None], (1, len(trace.model.outputs)))
    for k, name in enumerate(trace.late):
        value = late_kind == delays + k
        if delays + k not in cuts:
            continue
        column = trace.model.outputs.index(name)
        taken[:, column] = -1
        taken[late_row[value], column] = taker[value]
    reads = np.zeros(len(kind), dtype=bool)
    reads[taken[taken >= 0]] = True
    return Schedule(segments, row_segment, taken, reads)


def segments_of_rows(run: MotionRun, longest: float | Array) -> NDArray[np.intp]:
    """Segments that each row is cut into, that none be longer than this, s."""
    return np.maximum(1, np.ceil(run.sample_time / np.asarray(longest) - 1e-9).astype(np.intp))


def _in_time(instant: Array, rank: Index) -> Index:
    """The order of instants; those at once in that of their ranks."""
    order = np.argsort(instant, kind="stable")
    moment = np.concatenate(([0], np.cumsum(np.diff(instant[order]) > AT_ONCE)))
    return np.asarray(order[np.lexsort((rank[order], moment))])


def _commands(
    trace: MotionTrace, run: MotionRun, instant: Array, kind: Index, row: Index, shifts: Array, cuts: Sequence[int]
) -> tuple[Array, Array]:
    """Value and slope of every input at every segment's start, (S, inputs) each."""
    steps = np.append(np.diff(run.time), 1.0)
    rises = np.vstack([np.diff(run.inputs, axis=0), np.zeros((1, run.inputs.shape[1]))]) / steps[:, None]
    values = np.empty((len(kind), run.inputs.shape[1]))
    slopes = np.zeros_like(values)
    for k, name in enumerate(trace.model.inputs):
        source = trace.delayed.index(name) if name in trace.delayed else -1
        source = source if source in cuts else -1
        shift = shifts[source] if source >= 0 else 0.0
        before = np.count_nonzero(run.time + shift <= run.time[0] + AT_ONCE) - 1  # had arrived when the run began
        current = np.maximum.accumulate(np.where(kind == source, row, before))
        known = np.maximum(current, 0)
        values[:, k] = run.inputs[known, k]
        if not run.held[k]:
            slopes[:, k] = np.where(current >= 0, rises[known, k], 0.0)
            values[:, k] += slopes[:, k] * (instant - shift - run.time[known])
    return values, slopes


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
    known = [_fastest(trace, run, rows, p) for run, rows in zip(runs, sampled, strict=True)]
    fastest = np.concatenate([item[np.isfinite(item)] for item in known])
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
    result = []
    for run in runs:
        fastest = _fastest(trace, run, np.arange(len(run)), p)
        fastest = np.where(np.isfinite(fastest), fastest, ACCURATE / usual)
        near = 2 * max(1, round(ABOUT / run.sample_time)) + 1
        fastest = np.maximum(moving_maximum(fastest, near), 1e-9)
        result.append(np.clip(ACCURATE / fastest, usual, run.sample_time))
    return result


def _fastest(trace: MotionTrace, run: MotionRun, rows: Index, p: Array) -> Array:
    """(rows,) the largest eigenvalue of the motion at rows, 1/s; NaN where it cannot be told."""
    result = np.full(len(rows), np.nan)
    state = _between_readings(trace, run, rows)
    if not trace.names or not np.any(np.isfinite(state)):
        return result
    segment = np.zeros((len(rows), trace.segment_size))
    segment[:, 1 : 1 + len(trace.model.inputs)] = run.inputs[rows]
    known = trace.stiffness(np.nan_to_num(state), segment, np.where(np.isfinite(p), p, UNLIMITED))
    A = np.asarray(known).reshape(len(rows), len(trace.names), len(trace.names))
    finite = np.all(np.isfinite(A), axis=(1, 2))
    result[finite] = np.max(np.abs(np.linalg.eigvals(A[finite])), axis=1)
    return result


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
