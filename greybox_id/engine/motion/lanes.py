"""Intervals of runs side by side as lanes, so that one call integrates them all, and the targets of their predictions.

An interval is a stretch of rows predicted from one start. It may be cut into several lanes that are integrated at the
same time once the states at the cuts are known: the parallel form of multiple shooting.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache
from heapq import heapify, heapreplace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...base.shorthands import Array, Index, Mask
from ...models.motion_model import MotionModel
from ..kernel import KnownSimulation
from .schedule import MotionRun, Schedule


class Interval(NamedTuple):
    """Rows [start, stop) of a run, predicted from its first row."""

    run: int
    start: int
    stop: int

    @property
    def rows(self) -> int:
        """Number of rows."""
        return self.stop - self.start


@dataclass(frozen=True)
class Lanes:
    """Intervals, possibly cut, as lanes of equal length.

    Attributes
    ----------
    segments : (L, S, segment size); shorter lanes are padded with segments of zero length. Lanes with the same segments
        share their memory.
    reads : (S,) segments at whose start outputs are read.
    interval : (L,) interval that each lane belongs to.
    first : (L,) whether a lane is the first of its interval.
    offset : (L,) segments between the interval's start and the lane's.
    lane, rank : (N, outputs) for each row of all intervals, the lane of its reading and the reading's number in that
        lane; -1 where nothing was read.
    rows : (intervals + 1,) first of the N rows of each interval.
    """

    segments: Array
    reads: NDArray[np.bool_]
    interval: Index
    first: NDArray[np.bool_]
    offset: Index
    lane: NDArray[np.int32]
    rank: NDArray[np.int32]
    rows: Index

    @cached_property
    def flat(self) -> Index:
        """(N * outputs,) index of each reading in the flattened readings of all lanes."""
        return self._places()

    def _places(self) -> Index:
        outputs = self.lane.shape[1]
        place = self.lane.astype(np.intp)
        place *= int(np.sum(self.reads))
        place += self.rank
        place *= outputs
        place += np.arange(outputs)
        place[self.lane < 0] = 0
        return np.asarray(place.ravel())

    @cached_property
    def ends(self) -> NDArray[np.bool_]:
        """(S + 1,) mask over the segments' starts and the end that is true at the end only."""
        return np.append(np.zeros(len(self.reads), dtype=bool), True)

    @cached_property
    def marks(self) -> NDArray[np.bool_]:
        """(S + 1,) `ends` with `MARKS` of the starts, at which lanes are compared with the previous pass."""
        marks = self.ends.copy()
        marks[:: -(-len(self.reads) // MARKS)] = True
        return marks

    @cached_property
    def complete(self) -> bool:
        """Whether every reading was taken."""
        return bool(np.all(self.lane >= 0))

    @cached_property
    def owner(self) -> Index:
        """(N * outputs,) interval that predicts each reading; for a late reading it may be the previous one."""
        if len(self.rows) == 2:  # a view instead of as many zeros, for hours of data
            return np.broadcast_to(np.zeros(1, dtype=np.intp), self.lane.size)
        value = np.repeat(np.arange(len(self.rows) - 1), np.diff(self.rows))[:, None]
        return np.asarray(np.where(self.lane >= 0, self.interval[self.lane], value).ravel())

    @cached_property
    def by_owner(self) -> tuple[Index | None, Index]:
        """The order that sorts readings by owner (None if sorted already), and the first index of each owner in it."""
        if len(self.rows) == 2:
            return None, np.array([0, self.lane.size])
        sorted_already = bool(np.all(np.diff(self.owner) >= 0))
        order = None if sorted_already else np.argsort(self.owner, kind="stable")
        in_order = self.owner if order is None else self.owner[order]
        return order, np.searchsorted(in_order, np.arange(len(self.rows)))

    @cached_property
    def in_order(self) -> bool:
        """Whether the lanes' readings, concatenated, are those of all rows in order, so that no copy is needed."""
        count = int(np.sum(self.reads))
        if len(self.interval) * count * self.lane.shape[1] != self.lane.size or not self.complete:
            return False
        order = np.arange(len(self.lane))  # as each is read once, they start with the first reading of the first lane
        columns = zip(self.lane.T, self.rank.T, strict=True)
        return all(np.array_equal(lane.astype(np.intp) * count + rank, order) for lane, rank in columns)

    def scattered(self, values: Array) -> Array:
        """Values per reading, (N, outputs), arranged by lanes, (L, R, outputs); zero elsewhere."""
        shape = (len(self.interval), int(np.sum(self.reads)), self.lane.shape[1])
        if self.in_order:
            return values.reshape(shape)
        result = np.zeros(int(np.prod(shape)))
        if self.complete:
            result[self.flat] = values.ravel()
            return result.reshape(shape)
        taken = (self.lane >= 0).ravel()
        result[self.flat[taken]] = values.ravel()[taken]
        return result.reshape(shape)

    def gathered(self, values: Array, nothing: float = np.nan) -> Array:
        """Values by lanes, (L, R, outputs, ...), arranged by rows of the intervals, (N, outputs, ...)."""
        more = values.shape[3:]
        if self.in_order:
            return values.reshape(*self.lane.shape, *more)
        result = (
            values.reshape(int(np.prod(values.shape[:3])), *more)
            .take(self.flat, axis=0)
            .reshape(*self.lane.shape, *more)
        )
        if not self.complete:
            result[self.lane < 0] = nothing
        return result


WIDTHS = {8: 1.0, 4: 0.62}
"""Trajectories that a compiled call integrates at once -> cost of a segment, relative to the widest.

Measured on single tracks with 15 states: 17.5 and 28 ms for 6 436 segments, 0.55 to 0.65 in all.
"""


@lru_cache(maxsize=256)
def packed(lengths: tuple[int, ...]) -> list[slice]:
    """Group trajectories into calls at the lowest cost, as slices of them.

    `lengths` are their segments, in ascending order. A call takes as long as its longest trajectory.
    """
    least, begin = [0.0], [0]
    for stop in range(1, len(lengths) + 1):
        costs = {
            start: least[start]
            + min(cost for width, cost in WIDTHS.items() if width >= stop - start) * lengths[stop - 1]
            for start in range(max(0, stop - max(WIDTHS)), stop)
        }
        begin.append(min(costs, key=lambda start: costs[start]))
        least.append(costs[begin[-1]])
    result, stop = list[slice](), len(lengths)
    while stop:
        result.insert(0, slice(begin[stop], stop))
        stop = begin[stop]
    return result


def cut_rows(plan: Schedule, start: int, stop: int, cuts: int) -> Index:
    """First rows of the lanes of an interval that is cut into `cuts` lanes of about equally many segments."""
    if cuts <= 1:
        return np.array([start])
    begin = plan.row_segment[start:stop]
    at = np.linspace(*segment_ends(plan, start, stop), cuts + 1)[:-1]
    return np.asarray(start + np.unique(np.searchsorted(begin, at, side="right") - 1))


def segment_ends(plan: Schedule, start: int, stop: int) -> tuple[int, int]:
    """Segments at which rows start to stop begin and end."""
    last = plan.row_segment[stop] if stop < len(plan.row_segment) else len(plan.segments)
    return int(plan.row_segment[start]), int(last)


def even_cuts(schedules: Sequence[Schedule], intervals: Sequence[Interval], lanes: int) -> list[int]:
    """Lanes per interval, `lanes` in all, that make the longest lane as short as possible.

    A call takes as long as its longest lane: with equally many lanes per interval, all would wait for the longest.
    """
    ends = (segment_ends(schedules[item.run], item.start, item.stop) for item in intervals)
    longest: list[tuple[float, int, int]] = [(first - last, k, 1) for k, (first, last) in enumerate(ends)]
    heapify(longest)  # by negative length: the longest comes first
    for _ in range(lanes - len(longest)):
        size, k, count = longest[0]
        heapreplace(longest, (size * count / (count + 1), k, count + 1))
    return [count for _, _, count in sorted(longest, key=lambda item: item[1])]


def lay(schedules: Sequence[Schedule], intervals: Sequence[Interval], cuts: Sequence[int] | int = 1) -> Lanes:
    """Arrange intervals side by side, each cut into lanes of about equal length.

    Parameters
    ----------
    schedules : per run.
    intervals : in the order of runs and rows.
    cuts : lanes per interval, one number or one for each; fewer if an interval is too short.
    """
    offsets = np.concatenate(([0], np.cumsum([len(plan.segments) for plan in schedules])))
    run, start, stop = (np.array(item) for item in zip(*intervals, strict=True))
    numbered = list(zip(schedules, offsets[:-1], strict=True))
    edge = np.concatenate([np.append(item.row_segment, len(item.segments)) + at for item, at in numbered])
    edges = np.concatenate(([0], np.cumsum([len(plan.row_segment) + 1 for plan in schedules])))[run]
    if cuts != 1:
        cuts_of_each = [cuts] * len(intervals) if isinstance(cuts, int) else cuts
        items = zip(intervals, cuts_of_each, strict=True)
        rows = [cut_rows(schedules[item.run], item.start, item.stop, count) for item, count in items]
        owner = np.repeat(np.arange(len(rows)), [len(row) for row in rows])
        begin = edge[edges[owner] + np.concatenate(rows)]
    else:
        owner, begin = np.arange(len(intervals)), edge[edges + start]
    first = np.append(True, np.diff(owner) > 0)
    length = np.where(np.append(first[1:], True), edge[edges + stop][owner], np.append(begin[1:], 0)) - begin
    lanes_stored = (
        np.zeros(1, dtype=np.intp) if _alike(schedules, run[owner], begin - offsets[run[owner]], length) else owner
    )
    segments, reads = _filled(schedules, begin[: len(lanes_stored)], length[: len(lanes_stored)])
    counts = stop - start
    row = np.repeat(edges - run + start - np.append(0, np.cumsum(counts)[:-1]), counts) + np.arange(np.sum(counts))
    del edge  # large for hours of data
    lane_of_segment = np.full(offsets[-1], -1, dtype=np.intp)
    lane_of_segment[np.repeat(begin - np.cumsum(length) + length, length) + np.arange(np.sum(length))] = np.repeat(
        np.arange(len(begin)), length
    )
    number = np.cumsum(reads) - 1
    outputs = schedules[0].read_segment.shape[1]
    alike = all(item.read_segment.strides[1] == 0 for item in schedules)  # one column represents all outputs
    lane, rank = np.empty((2, len(row), min(1, outputs) if alike else outputs), dtype=np.int32)
    for k in range(lane.shape[1]):  # output by output: intermediate arrays of hours of data are large
        columns = [(item.read_segment[:, k], at) for item, at in numbered]
        read = _joined([np.where(column < 0, -1, column + at) for column, at in columns])[row]
        lane_of_reading = np.where(read >= 0, lane_of_segment[np.maximum(read, 0)], -1)
        lane[:, k] = lane_of_reading
        rank[:, k] = np.where(
            lane_of_reading >= 0, number[np.where(lane_of_reading >= 0, read - begin[lane_of_reading], 0)], -1
        )
    lane, rank = (np.broadcast_to(item, (len(row), outputs)) if alike else item for item in (lane, rank))
    return Lanes(
        segments=np.broadcast_to(segments, (len(begin), *segments.shape[1:])),
        reads=reads,
        interval=owner,
        first=first,
        offset=begin - begin[np.flatnonzero(first)][owner],
        lane=lane,
        rank=rank,
        rows=np.concatenate(([0], np.cumsum(counts))),
    )


def _joined(parts: Sequence[NDArray[Any]]) -> NDArray[Any]:
    return parts[0] if len(parts) == 1 else np.concatenate(parts)


def _alike(schedules: Sequence[Schedule], run: Index, begin: Index, length: Index) -> bool:
    """Whether all lanes are the same stretch of the same schedule."""
    same = np.all(begin == begin[0]) and np.all(length == length[0])
    return bool(same) and all(schedules[k] is schedules[run[0]] for k in run)


def _filled(schedules: Sequence[Schedule], begin: Index, length: Index) -> tuple[Array, NDArray[np.bool_]]:
    """Segments of all lanes, padded with segments of zero length, and whether any lane reads at each segment.

    `begin` counts the segments of all schedules, concatenated.
    """
    if len(begin) == 1 and len(schedules) == 1:  # one lane is a view of its schedule, which may be hours long
        here = slice(int(begin[0]), int(begin[0] + length[0]))
        return schedules[0].segments[None, here], schedules[0].reads[here]
    place = np.arange(int(np.max(length)))
    over = place >= length[:, None]
    at = np.where(over, 0, begin[:, None] + place)
    segments = np.take(_joined([plan.segments for plan in schedules]), at, axis=0)
    segments[over] = 0.0
    return segments, np.any(_joined([plan.reads for plan in schedules])[at] & ~over, axis=0)


MARKS = 32
"""Places along lanes at which states are compared with the previous pass: on average half the distance between two is
simulated in vain, 2 % of a lane."""
MOST_PASSES, CLOSED, SHRINKS, SAME = 5, 1e-9, 0.3, 1e-12
"""Largest number of matching passes; gap, relative to a state's size, at which lanes match; largest ratio of the widest
gaps of two successive passes, beyond which lanes are simulated one after the other instead; relative difference to the
previous pass, a thousandth of a permitted gap, below which the rest of a lane is not simulated again. Motion forgets
its initial state: however wide the first gaps, one or two passes close them, in a sixth of the time of a sequential
simulation."""


@dataclass(frozen=True)
class Chain:
    """A linearisation of all lanes.

    Attributes
    ----------
    x : (unknowns,) point of the linearisation.
    index : (intervals, q) indices of each interval's free unknowns among all.
    starts : (L, nz) initial states of the lanes.
    by : (L, nz, q) their derivative by those unknowns.
    ends : (L, nz, nz) derivative of the lanes' final states by their initial states.
    """

    x: Array
    index: Index
    starts: Array
    by: Array
    ends: Array

    def first_order(self, x: Array, z0: Array, lanes: Lanes) -> Array:
        """Initial states of the lanes, (L, nz), to first order in the unknowns; intervals start at z0."""
        moved = (x - self.x)[self.index]
        starts: Array = self.starts + np.einsum("lzq,lq->lz", self.by, moved[lanes.interval])
        starts[lanes.first] = z0
        return starts


def matched(
    starts: Array,
    ends: Array | None,
    lanes: Lanes,
    simulate: Callable[[Array, KnownSimulation | None], tuple[Array, Array]],
) -> tuple[Array, Array] | None:
    """Simulate all lanes at once, and close the gaps between them by Newton's method.

    Parameters
    ----------
    starts : (L, nz) initial guesses of the lanes' initial states; overwritten.
    ends : (L, nz, nz) derivative of the lanes' final states by their initial states; None takes it as zero.
    lanes : in the order in which they continue one another.
    simulate : (starts, result of the previous pass) -> states at `marks`, readings.

    Returns
    -------
    Initial states of the lanes and readings; None if the gaps do not close.
    """
    scale, before, known = np.max(np.abs(starts), axis=0) + 1e-6, np.inf, None
    for _ in range(MOST_PASSES):
        z, y = simulate(starts, known)
        gaps = np.where(lanes.first[:, None], 0.0, np.roll(z[:, -1], 1, axis=0) - starts)
        size = np.max(np.abs(gaps / scale))
        if size < CLOSED:
            return starts, y
        if not size < SHRINKS * before:
            return None
        before, known = size, KnownSimulation((z, y), SAME * scale)
        carried = np.zeros(starts.shape[1])
        for lane in np.flatnonzero(~lanes.first):
            carried = gaps[lane] + (0.0 if ends is None or lanes.first[lane - 1] else ends[lane - 1] @ carried)
            starts[lane] += carried
    return None


def chained(
    lanes: Lanes,
    ends: Array,
    starts_by_p: Array,
    loose: Index,
    value: slice = slice(None),
    before: tuple[Array, Array] | None = None,
) -> Array:
    """Derivative of the lanes' initial states by the free parameters and their intervals' free starts, (L, nz, q).

    Parameters
    ----------
    lanes : in the order in which they continue one another.
    ends : (L, nz, nz + moving) derivative of the final states by the initial states and by the free parameters.
    starts_by_p : (intervals, nz, moving) derivative of the intervals' starts by the free parameters.
    loose : states with a free start.
    value : slice of lanes to treat, for which `ends` is given.
    before : result and ends of the lane before the first of them; None if that one begins an interval.
    """
    size, moving, first = ends.shape[1], starts_by_p.shape[2], lanes.first[value]
    G = np.zeros((len(first), size, moving + len(loose)))
    order = np.cumsum(lanes.first) - 1  # the interval of each lane, in the order of starts_by_p
    G[first, :, :moving] = starts_by_p[order[value][first]]
    G[:, loose, moving + np.arange(len(loose))] = first[:, None]
    for lane in np.flatnonzero(~first):
        start_by, end_by = (G[lane - 1], ends[lane - 1]) if lane or before is None else before
        G[lane] = end_by[:, :size] @ start_by
        G[lane, :, :moving] += end_by[:, size:]
    return G


CRAWLING = 0.1
"""Share of an output's readings: if equations hold in fewer, the recording has little else, and all readings count."""


@dataclass(frozen=True)
class Targets:
    """Readings of all rows of all intervals, concatenated.

    Attributes
    ----------
    reading : (N, outputs), zero where missing.
    weight : (N, outputs) root of each reading's weight, over its standard deviation; zero where missing.
    robust : Huber threshold in standard deviations, beyond which residuals count linearly; None: least squares.
    """

    reading: Array
    weight: Array
    robust: float | None

    def errors(self, y: Array, taken: Mask) -> Array:
        """(N, outputs) prediction minus reading, in the outputs' units; NaN where missing."""
        result = y - self.reading
        result[~((self.weight > 0) & taken)] = np.nan
        return result


def targets(
    runs: Sequence[MotionRun],
    intervals: Sequence[Interval],
    noise: Array,
    robust: float | None = None,
    keep: Sequence[Array | Mask] | None = None,
    reading: Array | None = None,
) -> Targets:
    """Targets of the intervals' predictions.

    Parameters
    ----------
    runs : the recordings' runs.
    intervals : the predicted intervals.
    noise : (outputs,) standard deviation by which residuals are divided.
    robust : as in `Targets`.
    keep : per run, (n,) weight of each row or (n, outputs) of each reading, 0 drops it; None weights all with 1.
    reading : as in `Targets`, if known for these intervals.
    """
    measured = _rows([run.measured for run in runs], intervals)
    read = np.isfinite(measured)
    weight = np.where(read, 1.0 / noise, 0.0)
    if keep is not None:
        kept = [np.asarray(item, dtype=float) for item in keep]
        weight *= np.sqrt(_rows([item.reshape(len(item), -1) for item in kept], intervals))
    return Targets(np.where(read, measured, 0.0) if reading is None else reading, weight, robust)


def _rows(tables: Sequence[Array], intervals: Sequence[Interval]) -> Array:
    """Rows of all intervals, concatenated, from each run's table."""
    if len(tables) > 1 or len(intervals) == 1:
        return _joined([tables[i.run][i.start : i.stop] for i in intervals])
    start, stop = (np.array([getattr(i, name) for i in intervals]) for name in ("start", "stop"))
    counts = stop - start
    before = np.cumsum(counts) - counts
    return np.asarray(tables[0][np.repeat(start - before, counts) + np.arange(np.sum(counts))])


def where_valid(model: MotionModel, runs: Sequence[MotionRun]) -> list[Mask]:
    """Per run, (n, outputs): whether the model's equations hold, or the signal that decides is missing."""
    result = [np.ones(run.measured.shape, dtype=bool) for run in runs]
    for item in model.validity:
        holds = []
        for run in runs:
            names, table = (model.inputs, run.inputs) if item.signal in model.inputs else (model.outputs, run.measured)
            holds.append(~(np.abs(table[:, names.index(item.signal)]) < item.least))
        for k, output in enumerate(model.outputs):
            read = [np.isfinite(run.measured[:, k]) for run in runs]
            valid_readings, readings = (
                sum(np.sum(a & b) for a, b in zip(read, holds, strict=True)),
                sum(map(np.sum, read)),
            )
            if output in item.outputs and valid_readings >= CRAWLING * readings:
                for mask, holds_in_run in zip(result, holds, strict=True):
                    mask[:, k] &= holds_in_run
    return result
