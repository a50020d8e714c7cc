"""Segments: the stretches of a run between any two instants at which a command changes or something is read.

Delays and latencies move such instants, and segments' lengths with them: a delay of 3.7 samples is a segment of 0.7 of
a sample, not an interpolation. Every instant is a row's time, moved by at most one shift, so that how segments move
with shifts is a matter of plus and minus ones.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ...parameter import Array
from .runs import Index, MotionRun
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


def schedule(
    trace: MotionTrace, run: MotionRun, shifts: Array, longest: float | Array, moving: Sequence[bool] | None = None
) -> Schedule:
    """Lay a run out in segments.

    Parameters
    ----------
    trace : the model.
    run : the run.
    shifts : the delays' and latencies' values, s.
    longest : no segment is longer than this, s; one number, or (n,) from each row to the next.
    moving : which shifts are differentiated by; the others, where they are zero, cut nothing. None: all of them.
    """
    rows, delays = len(run), len(trace.delayed)
    cuts = [k for k, shift in enumerate(shifts) if moving is None or moving[k] or shift != 0]
    parts = np.maximum(1, np.ceil(run.sample_time / np.broadcast_to(longest, rows) - 1e-9).astype(np.intp))
    steps = np.append(np.diff(run.time), run.sample_time)
    inside = [np.flatnonzero(parts > k) for k in range(1, int(np.max(parts)))]
    within = [run.time[own] + steps[own] * k / parts[own] for k, own in enumerate(inside, 1)]
    late = [run.time - shifts[k] for k in cuts if k >= delays]
    delayed = [run.time + shifts[k] for k in cuts if k < delays]
    # At the same instant: delayed commands arrive first, then rows' own, then late readings are taken.
    first_late = sum(k < delays for k in cuts)
    kinds = [*cuts[:first_late], -1, *cuts[first_late:], *(-2 for _ in within)]
    times = [*delayed, run.time, *late, *within]
    counts, every = [len(own) for own in times], np.arange(rows)
    instant, kind = np.concatenate(times), np.repeat(kinds, counts)
    row = np.concatenate([*[every] * (len(times) - len(within)), *inside])
    order = _in_time(instant, np.repeat(np.arange(len(times)), counts))
    order = order[(instant[order] >= run.time[0] - AT_ONCE) & (instant[order] <= run.time[-1] + AT_ONCE)]
    first = int(np.flatnonzero((kind[order] == -1) & (row[order] == 0))[0])
    instant, kind, row = (values[order[first:]] for values in (instant, kind, row))
    instant = np.maximum.accumulate(instant)

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
    read = np.tile(row_segment[:, None], (1, len(trace.model.outputs)))
    for k, name in enumerate(trace.late):
        own = kind == delays + k
        if delays + k not in cuts:
            continue
        column = trace.model.outputs.index(name)
        read[:, column] = -1
        read[row[own], column] = places[own]
    reads = np.zeros(len(kind), dtype=bool)
    reads[read[read >= 0]] = True
    return Schedule(segments, row_segment, read, reads)


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
