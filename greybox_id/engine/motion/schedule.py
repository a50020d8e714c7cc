"""Segments: the stretches of a run between successive instants at which a command changes or an output is read.

Delays and latencies shift such instants, and with them the segments' lengths: a delay of 3.7 samples gives a segment of
0.7 of a sample, not an interpolation. Every instant is a row's time plus or minus at most one shift, so that the
derivatives of segments by shifts are sums of plus and minus ones.

The longest permitted segment follows from the vehicle's fastest motion: a longer Runge-Kutta step is unstable or
inaccurate.

`MotionRun` is an unbroken run of a recording for a motion model: inputs, readings, and rows at which predictions start.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from ...base.errors import BadInput
from ...base.shorthands import Array, Index, Mask
from ...base.statistics import moving_maximum
from ...datasets.recording import Recording
from ...models.motion_model import MotionModel
from .trace import MotionTrace

FEWEST_ROWS = 3
"""Shorter runs carry no information about motion."""


@dataclass(frozen=True)
class MotionRun:
    """One unbroken run.

    Attributes
    ----------
    name : name of the recording.
    time : (n,) s.
    inputs : (n, inputs) as recorded.
    held : (inputs,) whether an input is constant between rows (zero-order hold); else it is interpolated linearly.
    measured : (n, outputs) readings, NaN where missing.
    rows : the recording's rows of the n samples.
    number : number of the recording's run that contains them, from 1.
    """

    name: str
    time: Array
    inputs: Array
    held: Mask
    measured: Array
    rows: range
    number: int = 1

    def __len__(self) -> int:
        return len(self.time)

    @cached_property
    def sample_time(self) -> float:
        """Median time between rows, s."""
        return float(np.median(np.diff(self.time)))

    @cached_property
    def is_read(self) -> Mask:
        """(outputs,) whether an output has any reading in this run."""
        return np.asarray(np.any(np.isfinite(self.measured), axis=0))

    def states_read(self, model: MotionModel) -> tuple[str, ...]:
        """States of the model with any reading in this run."""
        return tuple(
            state.name
            for state in model.states
            if state.name in model.outputs and self.is_read[model.outputs.index(state.name)]
        )

    def starts(self, measured: Sequence[int], index: Index) -> Index:
        """The rows of `index`, each moved on to the next row in which all outputs in `measured` have a reading."""
        good = np.flatnonzero(np.all(np.isfinite(self.measured[:, list(measured)]), axis=1))
        if len(good) == 0:
            return np.empty(0, dtype=np.intp)
        places = np.searchsorted(good, index)
        return np.unique(good[places[places < len(good)]])


def motion_runs(model: MotionModel, recording: Recording, *, unread: bool = False) -> list[MotionRun]:
    """The runs of a recording in which every input is finite.

    Parameters
    ----------
    model : the model.
    recording : the recording.
    unread : whether a recording without outputs is accepted.

    Raises
    ------
    BadInput : an input is missing, no output was recorded, or no run is long enough.
    """
    table = np.column_stack([_input(model, recording, name) for name in model.inputs]) if model.inputs else None
    if table is None:
        table = np.empty((len(recording), 0))
    if not unread and not any(name in recording for name in model.outputs):
        raise BadInput(
            f"{recording.name} has none of the outputs of {model.name} ({', '.join(model.outputs)}); "
            f"it has {', '.join(recording.signals)}. Name the column of at least one output in the column map "
            "(‹columns›)."
        )
    nothing = np.full(len(recording), np.nan)
    measured = np.column_stack([recording.signals.get(n, nothing) for n in model.outputs])
    held = np.array([name in model.commands and recording.hold == "zero" for name in model.inputs], dtype=bool)
    result = []
    for number, (start, stop) in enumerate(recording.runs, 1):
        complete = np.all(np.isfinite(table[start:stop]), axis=1)
        for a, b in _stretches(complete):
            rows = range(start + a, start + b)
            value = slice(rows.start, rows.stop)
            if len(rows) >= FEWEST_ROWS:
                part = recording.time[value], table[value], held, measured[value]
                result.append(MotionRun(recording.name, *part, rows, number))
    if not result:
        raise BadInput(
            f"{recording.name} has no unbroken run of {FEWEST_ROWS} rows in which {', '.join(model.inputs)} are all "
            "present. Take a longer recording, or see with greybox data check where values are missing and runs end."
        )
    return result


def recorded_outputs(model: MotionModel, recording: Recording) -> tuple[str, ...]:
    """Outputs of the model that the recording contains."""
    return tuple(name for name in model.outputs if recording.has(name))


def recorded_as(model: MotionModel, recordings: Sequence[Recording]) -> dict[str, str]:
    """For inputs that may be any of several signals, the signal that the recordings contain.

    Raises `BadInput` if recordings contain different ones: parameters cannot be per newton and per ampere.
    """
    result: dict[str, str] = {}
    for name in model.aliases:
        signals = {
            text: recording.name for recording in reversed(recordings) if (text := _signal(model, recording, name))
        }
        if len(signals) > 1:
            listed = ", ".join(f"{signal} in {recording}" for signal, recording in signals.items())
            raise BadInput(
                f"the signal for {name} differs between recordings ({listed}): keep one of these signals "
                f"in the column maps, or fit the recordings one by one."
            )
        if signals:
            (result[name],) = signals
    return result


def _signal(model: MotionModel, recording: Recording, name: str) -> str:
    """The recording's signal for an input; empty if there is none."""
    return next((signal for signal in model.aliases.get(name, (name,)) if signal in recording), "")


def _input(model: MotionModel, recording: Recording, name: str) -> Array:
    if signal := _signal(model, recording, name):
        return recording[signal]
    if name in model.defaults:
        return np.full(len(recording), model.defaults[name])
    one = model.aliases.get(name, (name,))
    recording.require(one[:1], f"model {model.name} (any of {', '.join(one)})" if len(one) > 1 else model.name)
    raise AssertionError


def _stretches(good: Mask) -> list[tuple[int, int]]:
    edges = np.flatnonzero(np.diff(np.concatenate(([False], good, [False])).astype(int)))
    return [(int(a), int(b)) for a, b in zip(edges[::2], edges[1::2], strict=True)]


AT_ONCE = 1e-9
"""Largest difference of instants, s, that count as one: sums of times and shifts are rounded."""


@dataclass(frozen=True)
class Schedule:
    """The segments of one run.

    Attributes
    ----------
    segments : (S, segment size) data of each segment.
    row_segment : (n,) segment that starts at a row, just after its commands were applied.
    read_segment : (n, outputs) segment at whose start a row's output was read; -1 before the run began.
    reads : (S,) whether any output is read at a segment's start.
    """

    segments: Array
    row_segment: Index
    read_segment: Index
    reads: NDArray[np.bool_]

    @cached_property
    def taken(self) -> Index:
        """(n * outputs,) index of each row's reading among all readings taken, -1 where none was."""
        outputs = self.read_segment.shape[1]
        rank = (np.cumsum(self.reads) - 1)[np.maximum(self.read_segment, 0)]
        return np.asarray(np.where(self.read_segment >= 0, rank * outputs + np.arange(outputs), -1).ravel())

    @cached_property
    def complete(self) -> bool:
        """Whether every reading was taken."""
        return bool(np.all(self.taken >= 0))


def schedule(
    trace: MotionTrace,
    run: MotionRun,
    shifts: Array,
    longest: float | Array,
    moving: Sequence[bool] | None = None,
    read: NDArray[np.bool_] | None = None,
) -> Schedule:
    """Divide a run into segments.

    Parameters
    ----------
    trace : the model.
    run : the run.
    shifts : values of the delays and latencies, s.
    longest : longest permitted segment, s; one number, or (n,) from each row to the next.
    moving : shifts to differentiate by, None: all. The others make no cuts if they are zero, or where late readings
        coincide with an existing instant.
    read : (n,) rows in which an output may be read late; in others latencies make no cuts. None: all rows.
    """
    rows, delays = len(run), len(trace.delayed)
    cuts = [k for k, shift in enumerate(shifts) if moving is None or moving[k] or shift != 0]
    parts = np.broadcast_to(segments_of_rows(run, longest), rows)
    steps = np.append(np.diff(run.time), run.sample_time)
    all_rows = np.arange(rows)
    cut_rows = np.repeat(all_rows, parts - 1)
    part = np.arange(1, len(cut_rows) + 1) - np.repeat(np.cumsum(parts - 1) - (parts - 1), parts - 1)
    within = [run.time[cut_rows] + steps[cut_rows] * part / parts[cut_rows]] if len(cut_rows) else []
    late_rows = all_rows if read is None else np.flatnonzero(read)
    late = [run.time[late_rows] - shifts[k] for k in cuts if k >= delays]
    delayed = [run.time + shifts[k] for k in cuts if k < delays]
    # At equal instants: delayed commands arrive first, then the rows' own commands, then late readings are taken.
    first_late = sum(k < delays for k in cuts)
    kinds = [*cuts[:first_late], -1, *cuts[first_late:], *(-2 for _ in within)]
    times = [*delayed, run.time, *late, *within]
    counts = [len(time) for time in times]
    instant, kind = np.concatenate(times), np.repeat(kinds, counts)
    row = np.concatenate([*[all_rows] * (len(delayed) + 1), *[late_rows] * len(late), cut_rows])
    order = all_rows
    if len(times) > 1:
        order = _in_time(instant, np.repeat(np.arange(len(times)), counts))
        order = order[(instant[order] >= run.time[0] - AT_ONCE) & (instant[order] <= run.time[-1] + AT_ONCE)]
    first = int(np.flatnonzero((kind[order] == -1) & (row[order] == 0))[0])
    instant, kind, row = (values[order[first:]] for values in (instant, kind, row))
    instant = np.maximum.accumulate(instant)
    fixed = [k for k in cuts if k >= delays and moving is not None and not moving[k]]
    taker, late_kind, late_row = np.arange(len(kind)), kind, row
    coincides = np.zeros(len(kind), dtype=bool)  # no new segment: the instant exists
    if fixed:
        coincides[1:] = (np.diff(instant) <= AT_ONCE) & np.isin(kind[1:], fixed)
    if np.any(coincides):
        taker = np.cumsum(~coincides) - 1
        instant, kind, row = (values[~coincides] for values in (instant, kind, row))
    del steps, all_rows, order  # each is large for hours of data

    count = len(shifts)
    first_shift = 1 + 2 * run.inputs.shape[1]
    segments = np.zeros((len(kind), first_shift + 3 * count))
    length_by, sign, guess = np.split(segments[:, first_shift:], 3, axis=1)  # views
    segments[:-1, 0] = np.diff(instant)
    for k in cuts:  # the others are zero
        of_shift = np.where(kind == k, 1.0 if k < delays else -1.0, 0.0)
        sign[:, k], length_by[:-1, k], guess[:, k] = of_shift, np.diff(of_shift), shifts[k]
    _commands(trace, run, instant, kind, row, shifts, cuts, segments[:, 1:])

    places = np.arange(len(kind))
    row_segment = np.empty(rows, dtype=np.intp)
    row_segment[row[kind == -1]] = places[kind == -1]
    read_segment = np.broadcast_to(row_segment[:, None], (rows, len(trace.model.outputs)))
    if any(k >= delays for k in cuts):
        read_segment = read_segment.copy()
    for k, name in enumerate(trace.late):
        of_output = late_kind == delays + k
        if delays + k not in cuts:
            continue
        column = trace.model.outputs.index(name)
        read_segment[:, column] = -1
        read_segment[late_row[of_output], column] = taker[of_output]
    reads = np.zeros(len(kind), dtype=bool)
    for column in read_segment.T:  # column by column: a copy of all is large for hours of data
        reads[column[column >= 0]] = True
    return Schedule(segments, row_segment, read_segment, reads)


def segments_of_rows(run: MotionRun, longest: float | Array) -> NDArray[np.intp]:
    """Number of segments per row such that none is longer than `longest`, s."""
    return np.maximum(1, np.ceil(run.sample_time / np.asarray(longest) - 1e-9).astype(np.intp))


def _in_time(instant: Array, rank: Index) -> Index:
    """The order of instants; equal ones in the order of their ranks."""
    order = np.argsort(instant, kind="stable")
    apart, ranks = np.diff(instant[order]) > AT_ONCE, rank[order]
    if np.all(apart | (ranks[1:] >= ranks[:-1])):
        return order
    moment = np.concatenate(([0], np.cumsum(apart)))
    return np.asarray(order[np.lexsort((rank[order], moment))])


def _commands(
    trace: MotionTrace, run: MotionRun, instant: Array, kind: Index, row: Index, shifts: Array, cuts: Sequence[int],
    to: Array,
) -> None:  # fmt: skip
    """Value, and then slope, of every input at every segment's start, written into the first columns of `to`."""
    steps, inputs = np.append(np.diff(run.time), 1.0), run.inputs.shape[1]
    sources = [trace.delayed.index(name) if name in trace.delayed else -1 for name in trace.model.inputs]
    sources = [source if source in cuts else -1 for source in sources]
    for source in (-1, *sorted({*sources} - {-1})):  # inputs that are delayed alike have the same rows
        alike = [k for k, item in enumerate(sources) if item == source]
        shift = shifts[source] if source >= 0 else 0.0
        before = np.count_nonzero(run.time + shift <= run.time[0] + AT_ONCE) - 1  # last command to arrive by the start
        arrived = np.maximum.accumulate(np.where(kind == source, row, before))
        row_of_command = np.maximum(arrived, 0)
        if source < 0:  # whole rows are copied faster, and those of delayed inputs are overwritten
            to[:, :inputs] = run.inputs.take(row_of_command, axis=0)
        for k in alike if source >= 0 else ():
            to[:, k] = run.inputs[row_of_command, k]
        since = instant - shift - run.time[row_of_command]
        for k in (k for k in alike if not run.held[k]):
            slope = np.append(np.diff(run.inputs[:, k]), 0.0) / steps
            to[:, inputs + k] = np.where(arrived >= 0, slope[row_of_command], 0.0)
            to[:, k] += to[:, inputs + k] * since


ACCURATE, STABLE = 1.0, 2.3
"""Largest products of step and eigenvalue: below the first, the classical method is accurate to a few per mille, below
the second it is stable (the limit is 2.78). The first holds in 95 % of the rows, the second in all."""
MOST_STEPS, SHORTEST = 40, 2.5e-4
"""Largest number of steps per row, unless they would be longer than SHORTEST, s: a standing vehicle is stiff, and
uninteresting, but must not be unstable. Rows at 25 Hz in 40 steps of 1 ms were unstable at the stiffness of a racing
car, and none of its parameters could be estimated."""
MOST_STEPS_OF_SLOW = 400
"""Largest number of steps per row, however long rows are."""
SAMPLED_ROWS = 200
"""Rows at which eigenvalues are computed to find one step for all rows."""
FEW, ABOUT = 3.0, 0.5
"""Steps per row up to which all rows have equally many; beyond, each row gets the steps of the stiffest row within
ABOUT seconds, since a simulated state is not exactly the measured one."""
UNLIMITED = 1e10
"""Finite value in place of an infinite parameter, which means no limit at all."""


def longest_segment(trace: MotionTrace, runs: Sequence[MotionRun], p: Array) -> float:
    """The longest permitted segment, s, for these runs at these parameters."""
    shortest = min(run.sample_time for run in runs)
    sampled = [np.unique(np.linspace(0, len(run) - 1, max(3, SAMPLED_ROWS // len(runs))).astype(int)) for run in runs]
    eigenvalues = [_fastest(trace, run, rows, p) for run, rows in zip(runs, sampled, strict=True)]
    fastest = np.concatenate([item[np.isfinite(item)] for item in eigenvalues])
    if len(fastest) == 0:
        return shortest
    typical, most = max(float(np.quantile(fastest, 0.95)), 1e-9), max(float(np.max(fastest)), 1e-9)
    return float(np.clip(min(ACCURATE / typical, STABLE / most), least_segment(shortest), shortest))


def longest_segments(trace: MotionTrace, runs: Sequence[MotionRun], p: Array) -> list[Array]:
    """The longest permitted segment, s, from each row of each run to the next, (n,) each.

    A standing vehicle is stiff, and the segments that it needs are not needed at speed. Equals `longest_segment`
    everywhere if that makes only a few segments per row.
    """
    typical = longest_segment(trace, runs, p)
    if min(run.sample_time for run in runs) <= FEW * typical:
        return [np.full(len(run), typical) for run in runs]
    result = []
    for run in runs:
        fastest = _fastest(trace, run, np.arange(len(run)), p)
        fastest = np.where(np.isfinite(fastest), fastest, ACCURATE / typical)
        near = 2 * max(1, round(ABOUT / run.sample_time)) + 1
        fastest = np.maximum(moving_maximum(fastest, near), 1e-9)
        result.append(np.clip(ACCURATE / fastest, typical, run.sample_time))
    return result


def _fastest(trace: MotionTrace, run: MotionRun, rows: Index, p: Array) -> Array:
    """(rows,) the largest eigenvalue of the motion at rows, 1/s; NaN where it is unknown."""
    result = np.full(len(rows), np.nan)
    state = _between_readings(trace, run, rows)
    if not trace.names or not np.any(np.isfinite(state)):
        return result
    segment = np.zeros((len(rows), trace.segment_size))
    segment[:, 1 : 1 + len(trace.model.inputs)] = run.inputs[rows]
    jacobians = trace.stiffness(np.nan_to_num(state), segment, np.where(np.isfinite(p), p, UNLIMITED))
    A = np.asarray(jacobians).reshape(len(rows), len(trace.names), len(trace.names))
    finite = np.all(np.isfinite(A), axis=(1, 2))
    result[finite] = np.max(np.abs(np.linalg.eigvals(A[finite])), axis=1)
    return result


def least_segment(sample_time: float) -> float:
    """Lower limit of segments' lengths for rows of this sample time, s."""
    return min(sample_time / MOST_STEPS, max(SHORTEST, sample_time / MOST_STEPS_OF_SLOW))


def _between_readings(trace: MotionTrace, run: MotionRun, rows: Index) -> Array:
    """States at rows, (rows, nz), interpolated between readings, so that a slow sensor does not read zero meanwhile."""
    state = np.full((len(rows), trace.size), np.nan)
    for k, name in enumerate(trace.names):
        if name in trace.model.outputs:
            reading = run.measured[:, trace.model.outputs.index(name)]
            read = np.isfinite(reading)
            if np.any(read):
                state[:, k] = np.interp(run.time[rows], run.time[read], reading[read])
    return state
