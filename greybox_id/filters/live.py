"""Live tracking: row by row as data arrive, in constant memory; lines of a CSV in, lines of estimates out."""

from __future__ import annotations

import csv
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from typing import TextIO

import numpy as np
from numpy.typing import NDArray

from ..base.errors import BadInput
from ..base.shorthands import Array
from ..datasets.column_map import Column, ColumnMap
from ..datasets.read import LARGEST
from ..datasets.recording import Recording
from ..engine.motion.schedule import MotionRun, longest_segment
from ..fitting.fit import Verdict
from ..models.effect import Effect
from ..models.motion_model import MotionModel
from .filtering import LONGEST_GAP, Filtering, LaidRun
from .findings import RunningConsistency
from .how import TrackOptions
from .track import of_innovations
from .tuning import start_levels
from .verb import Tracker

STEADY = 8.0
"""An input is held back for a row if it jumps by more than this many times its largest recent step ..."""
LEAST_JUMP = 0.02
"""... and by more than this share of its range so far."""
FADES = 2.0
"""Time constant with which the largest step is forgotten, s."""
UNKNOWN = 1000.0
"""Ratio of a state's standard deviation to its initial one above which the state is unknown."""
LONGEST_LINE = 1 << 20
"""Largest number of characters per line: ten thousand columns."""


class LiveFilter:
    """A filter that processes one row at a time.

    Parameters
    ----------
    filtering : the filter.
    names : names of the estimates to return.
    p : (parameters,) model and noise.
    moves : (k, parameters) standard deviations of uncertain parameters, as moves of p; each gets a parallel filter.
    hold : hold of commands between rows, "zero" or "linear".
    """

    def __init__(self, filtering: Filtering, names: Sequence[str], p: Array, moves: Array, hold: str) -> None:
        trace = filtering.space.trace
        if trace.shift_count and np.any(np.asarray(trace.timing(p[: trace.model.size]).full()) != 0):
            raise BadInput(
                f"{trace.model.name} has delays or latencies, which need later rows; omit those effects to follow a "
                "vehicle live."
            )
        self._filtering, self.names, self._hold = filtering, tuple(names), hold
        self._p = np.ascontiguousarray(np.vstack([p, *(p + move for move in moves)]))
        self._seen = filtering.space.seen(self.names)
        self._guard = _LiveGuard(trace.model.inputs)
        self._believed = np.full(len(trace.model.inputs), np.nan)
        self._last: tuple[float, Array] | None = None
        self._met: float | None = None
        self._began = np.empty(0)
        outputs = filtering.space.model.outputs
        self._judged = {name: RunningConsistency(filtering.gate) for name in outputs}
        self._x = self._P = np.empty(0)

    def push(self, time: float, inputs: Array, readings: Array) -> tuple[Array, Array, tuple[str, ...]]:
        """Process a row: estimates, their standard deviations, and inputs held back as glitches.

        Parameters
        ----------
        time : s.
        inputs : (inputs,) of the model; NaN keeps the previous value.
        readings : (outputs,), NaN where missing.

        Values of `LARGEST` or more count as missing, as in files. If a state becomes NaN nevertheless, the row is
        dropped and the filter restarts with the next one. It also restarts if all readings are beyond the gate.
        """
        space = self._filtering.space
        inputs, readings = (np.where(np.abs(row) < LARGEST, row, np.nan) for row in (inputs, readings))
        if self._last is None:
            inputs = np.where(np.isfinite(inputs), inputs, self._believed)
        if not np.all(np.isfinite(inputs)) and self._last is None:
            lacking = [n for n, v in zip(space.model.inputs, inputs, strict=True) if not np.isfinite(v)]
            raise BadInput(f"The first row lacks {', '.join(lacking)}; begin with one that has every input.")
        step = np.inf if self._last is None else time - self._last[0]
        if self._last is not None and step <= 0:
            raise BadInput(f"Time goes from {self._last[0]:g} s to {time:g} s; rows must come in the order of time.")
        u, glitches = self._guard.clean(inputs, step)
        row = np.concatenate([[0.0], u, np.zeros(space.trace.segment_size - 1 - len(u))])
        if step > LONGEST_GAP:
            self._start(row, readings)
        else:
            self._go(row, u, step)
        segments, y = np.ascontiguousarray(row[None]), np.ascontiguousarray(readings[None], dtype=float)
        filtering = self._filtering
        _, history = filtering.filter.run(self._x, self._P, segments, y, self._p, filtering.gate, "filtered")
        assert history is not None
        for judged, off, spread in zip(self._judged.values(), history.off[0], history.spread[0], strict=True):
            judged.take(time, float(off), float(spread))
        if self._lost(time, history.off[0] ** 2 > filtering.gate**2 * history.spread[0], np.isfinite(readings)):
            self._x = self._P = np.empty(0)
            self._start(row, readings)
        if not (np.all(np.isfinite(self._x)) and np.all(np.isfinite(self._P))):
            self._last, self._x, self._P, self._guard = None, np.empty(0), np.empty(0), _LiveGuard(space.model.inputs)
            nothing = np.full(len(self.names), np.nan)
            return nothing, nothing, space.model.inputs
        self._last, self._believed = (time, u), u
        return *self._told(row), glitches

    def verdict(self) -> Verdict:
        """Whether the estimates so far are usable, and why."""
        channels = {name: judged.consistency() for name, judged in self._judged.items()}
        channels = {name: one for name, one in channels.items() if one.count}
        lost = {name: self._judged[name].lost / max(self._judged[name].windows, 1) for name in channels}
        return of_innovations(channels, lost, widened=1.0)

    def _lost(self, time: float, off: NDArray[np.bool_], read: NDArray[np.bool_]) -> bool:
        """Whether all readings for `LONGEST_GAP` were beyond the gate, or a state is unknown, as after absurd ones."""
        if self._met is None or np.any(read & ~off):
            self._met = time
        is_off = bool(np.any(read)) and time - self._met > LONGEST_GAP
        is_unknown = bool(np.any(np.diagonal(self._P[0]) > UNKNOWN**2 * self._began))
        if is_off or is_unknown:
            self._met = time
        return is_off or is_unknown

    def _start(self, row: Array, readings: Array) -> None:
        inputs = row[1 : 1 + len(self._filtering.space.model.inputs)]
        run = MotionRun("live", np.zeros(1), inputs[None], np.zeros(len(inputs), dtype=bool), readings[None], range(1))
        laid_run = LaidRun(
            run, row[None], readings[None], np.zeros(1, dtype=np.intp), np.zeros(readings[None].shape, dtype=np.intp)
        )
        before = (self._x, self._P)
        self._x, self._P = self._filtering.begin(laid_run, self._p, before if before[0].size else None)
        self._began = np.maximum(np.diagonal(self._P[0]), self._began if self._began.size else 0.0)

    def _go(self, row: Array, u: Array, step: float) -> None:
        """Predict from the previous row to this one."""
        assert self._last is not None
        space, before = self._filtering.space, self._last[1]
        held = np.array([n in space.model.commands and self._hold == "zero" for n in space.model.inputs], dtype=bool)
        slope = np.where(held, 0.0, (u - before) / step)
        state = np.full((1, len(space.model.outputs)), np.nan)
        for k, name in enumerate(space.model.outputs):
            if name in space.trace.names:
                state[0, k] = self._x[0, space.trace.names.index(name)]
        times = np.array([0.0, step])
        run = MotionRun("live", times, np.vstack([before, u]), held, np.repeat(state, 2, axis=0), range(2))
        longest = longest_segment(space.trace, [run], self._p[0, : space.model.size])
        parts = max(1, int(np.ceil(step / longest - 1e-9)))
        segments = np.tile(row, (parts + 1, 1))
        segments[:, 0] = step / parts
        begins = step / parts * np.arange(parts + 1)
        segments[:, 1 : 1 + len(u)] = before + slope * begins[:, None]
        segments[:, 1 + len(u) : 1 + 2 * len(u)] = slope
        nothing = np.full((parts + 1, len(space.model.outputs)), np.nan)
        filtering = self._filtering
        filtering.filter.run(self._x, self._P, segments, nothing, self._p, filtering.gate, "nothing")

    def _told(self, row: Array) -> tuple[Array, Array]:
        count, n = len(self.names), self._filtering.space.size
        rows = np.tile(row, (len(self._p), 1))
        result = self._seen(np.ascontiguousarray(self._x), rows, self._p)
        by_x = result[0, count:].reshape(count, n)
        variance = np.einsum("ij,jl,il->i", by_x, self._P[0], by_x)
        variance += np.sum((result[1:, :count] - result[0, :count]) ** 2, axis=0)
        values = result[0, :count]
        return values, np.where(np.isnan(values), np.nan, np.sqrt(np.maximum(variance, 0.0)))


class _LiveGuard:
    """Holds an input back for a row if it jumps unusually far; a glitch is over by then, a true jump is not."""

    def __init__(self, inputs: Sequence[str]) -> None:
        self._names = tuple(inputs)
        self._before: Array | None = None
        self._largest = np.zeros(len(inputs))
        self._low = self._high = np.zeros(len(inputs))
        self._doubted = np.zeros(len(inputs), dtype=bool)
        self._rows = 0

    def clean(self, inputs: Array, step: float) -> tuple[Array, tuple[str, ...]]:
        """The inputs to use, and names of those held back."""
        if self._before is None:
            self._before, self._low, self._high = inputs.copy(), inputs.copy(), inputs.copy()
            return inputs.copy(), ()
        missing = ~np.isfinite(inputs)
        filled = np.where(missing, self._before, inputs)
        jump = np.abs(filled - self._before)
        warmed_up = self._rows * min(step, 1.0) > FADES
        jumps = (
            warmed_up
            & (jump > STEADY * self._largest)
            & (jump > LEAST_JUMP * (self._high - self._low))
            & ~self._doubted
        )
        result = np.where(jumps, self._before, filled)
        self._doubted = jumps
        decay = np.exp(-min(step, FADES) / FADES)
        self._largest = np.where(jumps, self._largest, np.maximum(jump, self._largest * decay))
        self._low, self._high = np.minimum(self._low, result), np.maximum(self._high, result)
        self._before, self._rows = result, self._rows + 1
        return result, tuple(name for name, held in zip(self._names, jumps, strict=True) if held)


def as_row(values: Mapping[str, float], names: Sequence[str]) -> Array:
    """Values by name as an array, NaN where missing."""
    return np.array([values.get(name, np.nan) for name in names])


def follow(
    model: MotionModel, parameters: Sequence[str], disturbances: Sequence[str], effects: Mapping[str, Effect],
    how: TrackOptions, columns: ColumnMap, lines: TextIO, out: TextIO, uncertain: Array | None = None,
) -> Verdict:  # fmt: skip
    """Track a vehicle live.

    Parameters
    ----------
    model, parameters, disturbances, effects, how, uncertain : as for `track`; noise is as stated, nothing is tuned.
    columns : column map of the lines; the first line names the columns.
    lines : comma-separated text, line by line.
    out : receives a header line, then for every line time, each estimate and its standard deviation, and the names of
        inputs that were held back as glitches; flushed line by line.

    Returns
    -------
    Verdict at the end of the lines: whether the innovations were as the filter expects.

    Raises
    ------
    BadInput : a column is missing, a line cannot be read, or the noise of a reading is not stated.
    """
    rows = _rows(lines, columns.separator or ",")
    _, header = next(rows, (1, None))
    if header is None:
        raise BadInput("Standard input is empty: send a line with the names of the columns first.")
    place = {name.strip(): k for k, name in enumerate(header)}
    if columns.time.column not in place:
        raise BadInput(f'Standard input has no column "{columns.time.column}" for time; it has {", ".join(place)}.')
    channels = [signal for signal in columns.signals.values() if all(name in place for name in signal.names)]
    one = np.zeros(1)
    example = Recording("standard input", one, {channel.signal: one for channel in channels}, hold=columns.hold)
    tracker = Tracker(model, example, parameters, disturbances, effects, replace(how, tune=0.0), uncertain)
    live = _live(tracker, columns.hold)
    writer = csv.writer(out, lineterminator="\n")
    writer.writerow(["time", *(f"{name}{end}" for name in live.names for end in ("", "_sd")), "held_back"])
    aliases = tracker.space.model.aliases
    for number, row in rows:
        time = float(columns.time.convert(np.array([_number(row, place[columns.time.column], number)]))[0])
        if not np.isfinite(time):
            raise BadInput(f"Line {number} of standard input has no time; every row needs one.")
        signals = {
            channel.signal: float(channel.convert(np.array([_magnitude(channel, row, place, number)]))[0])
            for channel in channels
        }
        of_inputs = {
            name: signals[s] for name in tracker.space.model.inputs for s in aliases.get(name, (name,)) if s in signals
        }
        defaults = tracker.space.model.defaults
        inputs = as_row({**defaults, **of_inputs}, tracker.space.model.inputs)
        readings = as_row({name: signals[name] for name in tracker.readings}, tracker.space.model.outputs)
        values, sds, held = live.push(time, inputs, readings)
        numbers = [f"{number:.9g}" for pair in zip(values, sds, strict=True) for number in pair]
        writer.writerow([f"{time:.9g}", *numbers, " ".join(held)])
        out.flush()
    return live.verdict()


def _magnitude(channel: Column, row: list[str], place: Mapping[str, int], line: int) -> float:
    """A cell's number, with its sign if that has a separate column."""
    value = _number(row, place[channel.column], line)
    sign = row[place[channel.sign_column] :][:1] if channel.sign_column else []
    return value * channel.sign_of(sign[0] if sign else "") if channel.sign_column else value


def _rows(lines: TextIO, separator: str) -> Iterator[tuple[int, list[str]]]:
    """Numbers of lines, and their cells. Raises `BadInput` for unreadable lines."""
    number = 0
    try:
        while line := lines.readline(LONGEST_LINE):
            number += 1
            if len(line) == LONGEST_LINE:
                raise BadInput(
                    f"Line {number} of standard input has {LONGEST_LINE >> 20} MB or more; send rows of a CSV."
                )
            if cells := next(csv.reader([line], delimiter=separator), []):
                yield number, cells
    except csv.Error as error:
        raise BadInput(
            f"Line {number} of standard input cannot be read ({error}); send numbers between {separator!r}."
        ) from error
    except UnicodeDecodeError as error:
        raise BadInput(f"Standard input after line {number} is not text ({error.reason}); send UTF-8.") from error


def _live(tracker: Tracker, hold: str) -> LiveFilter:
    stated = tracker.stated_noise
    lacking = [f"noise_{name}" for name in tracker.readings if f"noise_{name}" not in stated]
    if lacking:
        raise BadInput(
            f"To follow a vehicle, the noise of its readings must be stated: {', '.join(lacking)}. State it with "
            "‹noise› NAME=SIZE; or track a recording once with ‹apply› FILE, and name that FILE as ‹vehicle›."
        )
    levels = start_levels(tracker.space, {}, tracker.readings, stated)
    p = np.concatenate([tracker.space.model.values, levels.values])
    return LiveFilter(tracker.filtering, tracker.reported, p, tracker.stated_moves(len(p)), hold)


def _number(row: Sequence[str], place: int, line: int) -> float:
    text = row[place].strip() if place < len(row) else ""
    if not text:
        return np.nan
    try:
        result = float(text)
    except ValueError as error:
        raise BadInput(f"Line {line} of standard input: {text!r} is not a number.") from error
    return result if np.isfinite(result) else np.nan  # infinite readings count as missing
