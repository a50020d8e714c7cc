"""The least-squares problem of fitting a motion model: multiple shooting with the nodes eliminated.

A run is predicted in intervals. Each starts from the readings of its first row, inverted through the sensors; a free
start may deviate from them. Without a horizon the whole run is one interval (output error), cut only so that its pieces
can be linearised side by side. With a horizon the problem is multi-step prediction: every interval starts again from
readings, while actuators and unmeasured states continue (`simulator`).

States at cuts follow by simulation; their derivatives follow from piece to piece by the chain rule (lanes.py). The
result is a dense problem in the parameters and the free starts.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from copy import copy
from dataclasses import dataclass, replace
from functools import cached_property, partial
from typing import Literal

import numpy as np

from ...base.errors import BadInput
from ...base.shorthands import Array, Index, Mask
from ...datasets.recording import Recording
from ..kernel import SHARED_FROM, WIDEST
from ..lane_targets import HOURS, LaneTargets
from ..least_squares import NormalEquations
from .lanes import Chain, Interval, Lanes, Targets, chained, even_cuts, lay, matched, targets, where_valid
from .schedule import MotionRun, Schedule, longest_segment, motion_runs, schedule, segments_of_rows
from .simulator import IntervalStarts, Simulator
from .unknowns import Unknowns, lay_out_unknowns

LANES = 16
"""Lanes that a single long run is cut into: two vectors of eight, one for each thread; eight lanes for a single thread,
since longer lanes forget more of their initial states."""
LANE = 2000
"""Segments per lane for recordings of hours: linearising `LANES` of them takes some 10 MB."""
MOST_SEGMENTS = 600_000
"""Segments per call when many points are simulated at once: some 50 MB."""
Starts = Literal["free", "measured"]


@dataclass(frozen=True)
class SimulatedRuns:
    """A simulation of all intervals.

    Attributes
    ----------
    lanes : the intervals as lanes, at the shifts' values.
    cut : the same, cut into more lanes for linearising.
    starts : (lanes of cut, nz) their initial states.
    used : the one of `lanes` and `cut` that was simulated.
    read : (L, R, outputs) readings of its lanes.
    """

    lanes: Lanes
    cut: Lanes
    starts: Array
    used: Lanes
    read: Array

    @cached_property
    def y(self) -> Array:
        """(N, outputs) predicted readings of all rows of all intervals; NaN where none was taken."""
        return self.used.gathered(self.read)

    @property
    def taken(self) -> Mask:
        """(N, outputs) whether a reading was taken."""
        return np.asarray(self.lanes.lane >= 0)


class MotionProblem:
    """Least-squares problem of fitting a motion model to recordings.

    Parameters
    ----------
    simulator : the model.
    recordings : training data.
    noise : (outputs,) standard deviation by which residuals are divided, in each output's unit.
    horizon : s predicted from one start; None for whole runs.
    most_rows : with a horizon, the approximate number of rows to use of all runs, in evenly spread intervals; or None.
    starts : "free" lets the start of every interval deviate from its readings; "measured" fixes it to them.
    strengths : factor by which each group of priors is tightened beyond its stated strength.
    robust : Huber threshold in standard deviations, beyond which residuals count linearly; None for least squares.
    keep : per run, (n,) weight of each row or (n, outputs) of each reading, 0 drops it; None weights all with 1.
    about : (parameters,) near the expected estimates; the longest segment, and the unmeasured states at the starts of a
        horizon, are computed there once; None takes the model's values.
    like : a problem of the same simulator and recordings, whose layouts are reused where they are the same.

    Attributes
    ----------
    parameters, loose, layout, bounds, free, R, r : of the unknowns, as in `Unknowns`.
    """

    def __init__(
        self,
        simulator: Simulator,
        recordings: Sequence[Recording],
        *,
        noise: Array,
        horizon: float | None = None,
        most_rows: int | None = None,
        starts: Starts = "free",
        strengths: Mapping[str, float] | None = None,
        robust: float | None = None,
        keep: Sequence[Array] | None = None,
        about: Array | None = None,
        like: MotionProblem | None = None,
    ) -> None:
        self.simulator, self.trace, self.model = simulator, simulator.trace, simulator.trace.model
        read_runs = () if like is not None else (motion_runs(self.model, recording) for recording in recordings)
        self.runs: list[MotionRun] = [run for item in read_runs for run in item] if like is None else like.runs
        self.noise, self.horizon = np.asarray(noise, dtype=float), horizon
        every = 1 if most_rows is None else max(1, sum(len(run) for run in self.runs) // most_rows)
        self.intervals = [interval for k, run in enumerate(self.runs) for interval in self._intervals(k, run, every)]
        if not self.intervals:
            names = ", ".join(dict.fromkeys(name for run in self.runs for name in run.states_read(self.model)))
            raise BadInput(f"No run of {self.runs[0].name} has a row at which {names} are all there.")
        self.copies, self._run = len(self.intervals), np.array([item.run for item in self.intervals])
        same = like is not None and self.intervals == like.intervals
        known = like.unknowns_laid if like is not None and same else None
        unknowns = lay_out_unknowns(self.model, self.runs, self._run, starts == "free", strengths, known)
        self.unknowns_laid: Unknowns = unknowns
        self.parameters, self.loose, self.layout = unknowns.parameters, unknowns.loose, unknowns.layout
        self.bounds, self.free, self.R, self.r = unknowns.bounds, unknowns.free, unknowns.R, unknowns.r
        self.prior_curvature = (self.R.T @ self.R).toarray()
        self.moving = np.flatnonzero(np.any([self.free[index] for index in self.parameters.index], axis=0))
        self._valid: list[Mask] = like._valid if like is not None and same else self._where_valid()
        self.targets: Targets = self._targets(robust, keep, like.targets.reading if like is not None and same else None)
        self._about: Array = self.model.values if about is None else about
        near = like is not None and np.array_equal(self._about, like._about)
        self.longest: float = like.longest if like and near else longest_segment(self.trace, self.runs, self._about)
        self._interval_starts = IntervalStarts(simulator, self.runs, self.intervals)
        if horizon is not None:
            shifts = np.tile(simulator.shifts(self._about), (len(self.runs), 1))
            self._interval_starts.carry(self._about, lambda: self._scheduled(shifts))
        alike = like is not None and self._steps() == like._steps()
        self._plans: tuple[Array, list[Schedule]] | None = like._plans if like and alike else None
        self._lanes: list[Lanes] = [*like._lanes] if like and alike and same else []
        self._chain: Chain | None = like._chain if self._lanes and like and len(like.free) == len(self.free) else None
        self._tiled: tuple[Lanes, Array] | None = None
        self._laid: list[tuple[Lanes, Targets, LaneTargets]] = []

    def weighing(self, keep: Sequence[Array] | None) -> MotionProblem:
        """The same problem with other weights of rows or readings; all layouts are shared."""
        other = copy(self)
        other.targets = self._targets(self.targets.robust, keep, self.targets.reading)
        return other

    def driven_by(self, inputs: Sequence[Array]) -> MotionProblem:
        """The same problem with other inputs, (n, inputs) per run; starts and readings are shared."""
        other = copy(self)
        other.runs = [replace(run, inputs=item) for run, item in zip(self.runs, inputs, strict=True)]
        other._plans = other._chain = other._tiled = None
        other._lanes, other._laid = [], []
        return other

    def forget(self) -> None:
        """Release layouts of all rows; they are made again when needed."""
        self._plans = self._chain = self._tiled = None
        self._lanes, self._laid = [], []
        self._interval_starts.forget()

    def forget_targets(self) -> None:
        """Release the targets arranged by lanes; they are made again when needed."""
        self._laid = []

    @property
    def carries(self) -> bool:
        """Whether starts contain unmeasured states from an observer, computed when the problem was set up."""
        return self._interval_starts.carries

    @property
    def target(self) -> Array:
        """(N, outputs) target readings, zero where missing."""
        return self.targets.reading

    @property
    def weight(self) -> Array:
        """(N, outputs) factor on residuals, zero where missing."""
        return self.targets.weight

    @property
    def start(self) -> Array:
        """Unknowns at the parameters' nominal values, starts at their readings."""
        return self.unknowns(self.model.values)

    def unknowns(self, p: Array) -> Array:
        """All unknowns from one vector of model parameters: the same in all runs, starts at their readings."""
        x = np.zeros(self.layout.size)
        for index in self.parameters.index:
            x[index] = p
        return x

    def shared(self, x: Array) -> Array:
        """One vector of model parameters for new runs: run-scoped ones at the mean over runs."""
        low, high = (bound[self.parameters.index[0]] for bound in self.bounds)
        mean = np.mean([x[index] for index in self.parameters.index], axis=0)
        return np.asarray(np.clip(mean, low, high))  # rounding may put the mean of values at a bound beyond it

    def per_run(self, x: Array) -> Array:
        """(runs, parameters) the parameters of each run."""
        return np.array([x[index] for index in self.parameters.index])

    def of_intervals(self, x: Array) -> Array:
        """(intervals, parameters) the parameters of each interval."""
        return np.asarray(self.per_run(x)[self._run])

    def simulated_nodes(self, x: Array) -> SimulatedRuns:
        """A simulation of every interval: of all its lanes at once if the gaps between them close."""
        lanes, cut = self.lanes(x)
        p, kernel = self.of_intervals(x), self.simulator.kernel
        z0, _ = self.starts(x)
        with np.errstate(all="ignore"):
            if cut is not lanes:
                chain = self._chain if self._chain and len(self._chain.starts) == len(cut.interval) else None
                begin, ends = (z0[cut.interval], None) if chain is None else (chain.first_order(x, z0, cut), chain.ends)
                run = partial(kernel.simulate, s=cut.segments, p=p[cut.interval], reads=cut.reads, keeps=cut.marks)
                result = matched(begin, ends, cut, lambda z, known: run(z, known=known))
                if result is not None:
                    return SimulatedRuns(lanes, cut, result[0], cut, result[1])
            keeps = np.zeros(lanes.segments.shape[1] + 1, dtype=bool)
            keeps[cut.offset] = True
            z, y = kernel.simulate(z0, lanes.segments, p, lanes.reads, keeps)
        return SimulatedRuns(lanes, cut, z[cut.interval, (np.cumsum(keeps) - 1)[cut.offset]], lanes, y)

    def predicted_readings(self, x: Array) -> Array:
        """Predicted readings at many points at once: (points, unknowns) -> (points, N, outputs).

        If every point has the same segments (no delay or latency differs), all intervals of all points are lanes of
        one call; otherwise points are simulated one after the other. NaN where no reading was taken.
        """
        alike = True
        if self.trace.shift_count:
            shifts = np.array([[self.simulator.shifts(p) for p in self.per_run(item)] for item in x])
            alike = bool(np.all(shifts == shifts[:1]))
        if not (alike and self._interval_starts.plain_starts):
            return np.array([self.simulated_nodes(item).y for item in x])
        _, lanes = self._whole(x[0])
        count, segments = len(self.intervals), lanes.segments.shape[1]
        at_once = max(1, MOST_SEGMENTS // max(count * segments, 1))
        result = np.empty((len(x) if len(x) > at_once else 0, *self.target.shape))
        for first in range(0, len(x), at_once):
            points = x[first : first + at_once]
            per_run = points[:, np.array(self.parameters.index)]
            z0 = self._interval_starts.of_many(per_run)
            if len(self.loose):
                z0[:, :, self.loose] += points[:, self.parameters.size :].reshape(len(points), count, -1)
            p = per_run[:, self._run]
            if len(points) == 1:  # no second copy of what may be hours of data
                self._tiled = (lanes, lanes.segments)
            elif self._tiled is None or self._tiled[0] is not lanes or len(self._tiled[1]) != len(points) * count:
                self._tiled = (lanes, np.tile(lanes.segments, (len(points), 1, 1)))
            with np.errstate(over="ignore", invalid="ignore"):
                z0, p = (item.reshape(len(points) * count, -1) for item in (z0, p))
                _, y = self.simulator.kernel.simulate(z0, self._tiled[1], p, lanes.reads, lanes.ends)
            read = y.reshape(len(points), -1)
            read = (read if lanes.in_order else read[:, lanes.flat]).reshape(len(points), *self.target.shape)
            read = read if lanes.complete else np.where(lanes.lane >= 0, read, np.nan)
            if len(x) <= at_once:  # no second copy of what may be hours of data
                return read
            result[first : first + at_once] = read
        return result

    def objective(self, x: Array, nodes: SimulatedRuns) -> float:
        """Half the sum of squared residuals, priors included; infinite where the model is not finite."""
        total = 0.5 * float(np.sum(self.prior_residuals(x) ** 2)) + self.misfit(x, nodes)
        return total if np.isfinite(total) else np.inf

    def misfit(self, x: Array, nodes: SimulatedRuns) -> float:
        """Half the sum of squared residuals of the data alone."""
        del x
        return self.against(nodes.used).misfit(nodes.read)

    def errors(self, nodes: SimulatedRuns) -> Array:
        """(N, outputs) prediction minus reading, in the outputs' units; NaN where missing."""
        return self.targets.errors(nodes.y, nodes.taken)

    def normal_equations(self, x: Array, nodes: SimulatedRuns) -> NormalEquations:
        """Linearise all residuals at a simulated point."""
        H, g = self.prior_curvature.copy(), self.prior_gradient(x)
        cut, index = nodes.cut, self._moving_index[nodes.cut.interval]
        with np.errstate(over="ignore", invalid="ignore"):  # far off, derivatives overflow first
            T, inner, pull = self._accumulated(x, nodes)
            if T is not None:
                inner, pull = T.swapaxes(1, 2) @ inner @ T, (pull[:, None] @ T)[:, 0]
        _add(H, g, index, inner, pull)

        def frozen_gradient(other_x: Array, other: SimulatedRuns) -> Array:
            e, _ = self.against(other.used).weighted(other.read)
            e = e if other.used is cut else other.used.gathered(e, 0.0)  # in two steps: each array may be large
            e = e if other.used is cut else cut.scattered(e)
            _, _, pull = self._accumulated(x, nodes, e)
            result = self.prior_gradient(other_x)
            _add(None, result, index, None, pull if T is None else (pull[:, None] @ T)[:, 0])
            return result

        return NormalEquations(H, g, frozen_gradient)

    def residuals(self, x: Array, nodes: SimulatedRuns) -> Iterator[tuple[Array, Array]]:
        """Per interval, residuals (rows, outputs) in noise standard deviations and their derivative (rows, outputs, p).

        p are the interval's unknowns in the layout's order; for fixed ones the derivative is zero. Missing readings
        have zero residuals. Rows are those for which the interval predicts a reading: late ones reach into the next.
        """
        cut, against = nodes.cut, self.against(nodes.used)
        J = cut.gathered(np.concatenate([item for _, item in self._linearised(x, nodes)]), 0.0)
        e = nodes.used.gathered(against.weighted(nodes.read)[0], 0.0)
        owner = cut.owner.reshape(e.shape)
        for k, rows in enumerate(self.rows_of_intervals(nodes)):
            owned = (owner[rows] == k)[:, :, None]
            full = np.zeros((len(rows), e.shape[1], len(self.layout.index[k])))
            full[:, :, self._chosen] = np.where(owned, J[rows], 0.0)
            yield np.where(owned[:, :, 0], e[rows], 0.0), full

    def rows_of_intervals(self, nodes: SimulatedRuns) -> Iterator[Index]:
        """Per interval, those of the N rows of which it predicts a reading."""
        (order, edges), outputs = nodes.cut.by_owner, nodes.cut.lane.shape[1]
        for first, last in zip(edges[:-1], edges[1:], strict=True):
            together = np.arange(first // outputs, -(-last // outputs))[: last - first]
            yield together if order is None else np.unique(order[first:last] // outputs)

    def parts(self, x: Array, nodes: SimulatedRuns) -> Iterator[tuple[int, int, Array, Array]]:
        """Interval, first row of a part in it, and the part's residuals and derivatives as in `residuals`.

        Intervals with many lanes come `LANES` at a time: linearising a day then takes no more memory than an hour. A
        row read in two lanes is in two parts, each zero where the other has the reading.
        """
        cut = nodes.cut
        if len(cut.interval) <= LANES or cut is nodes.lanes:
            yield from ((k, 0, e, J) for k, (e, J) in enumerate(self.residuals(x, nodes)))
            return
        e, _ = self.against(nodes.used).weighted(nodes.read)
        e, place = nodes.used.gathered(e, 0.0), cut.flat.reshape(cut.lane.shape)
        begins = np.full(len(self.intervals), -1)
        for item, J in self._linearised(x, nodes):
            flat, skipped = J.reshape(-1, J.shape[-1]), item.start * J.shape[1] * J.shape[2]
            readings = np.flatnonzero(np.any((cut.lane >= item.start) & (cut.lane < item.stop), axis=1))
            rows = np.arange(readings[0], readings[-1] + 1) if len(readings) else readings
            lane = cut.lane[rows]
            owner = np.where((lane >= item.start) & (lane < item.stop), cut.interval[lane], -1)
            for k in np.unique(owner[owner >= 0]).tolist():
                inside = np.flatnonzero(np.any(owner == k, axis=1))
                rows_of_part, mask = rows[inside[0] : inside[-1] + 1], owner[inside[0] : inside[-1] + 1] == k
                begins[k] = rows_of_part[0] if begins[k] < 0 else begins[k]
                full = np.zeros((*mask.shape, len(self.layout.index[k])))
                full[:, :, self._chosen] = flat[np.where(mask, place[rows_of_part] - skipped, 0)] * mask[:, :, None]
                yield k, int(rows_of_part[0] - begins[k]), np.where(mask, e[rows_of_part], 0.0), full

    def prior_residuals(self, x: Array) -> Array:
        """Residuals of the priors, in standard deviations."""
        return np.asarray(self.R @ x - self.r) if len(self.r) else np.zeros(0)

    def prior_gradient(self, x: Array) -> Array:
        """Gradient of the priors' part of the objective."""
        return np.asarray(self.R.T @ self.prior_residuals(x)) if len(self.r) else np.zeros(len(x))

    def lanes(self, x: Array) -> tuple[Lanes, Lanes]:
        """Intervals as lanes, whole and cut; laid out again when a delay changes."""
        plans, lanes = self._whole(x)
        if len(self._lanes) == 1:
            items, count, segments = self.intervals, len(self.intervals), lanes.segments.shape[1]
            wide = WIDEST if WIDEST % count == 0 and count * segments < SHARED_FROM else LANES
            cuts = max(1, wide // count, LANES * round(segments / LANES / LANE))
            self._lanes = [lanes, lay(plans, items, even_cuts(plans, items, cuts * count)) if cuts > 1 else lanes]
        return lanes, self._lanes[1]

    def _whole(self, x: Array) -> tuple[list[Schedule], Lanes]:
        """Schedules of the runs, and intervals as uncut lanes."""
        if self._plans is None or self.trace.shift_count:
            shifts = np.array([self.simulator.shifts(p) for p in self.per_run(x)])
            if self._plans is None or not np.array_equal(self._plans[0], shifts):
                self._plans, self._lanes = (shifts, self._scheduled(shifts)), []
        if not self._lanes:
            self._lanes = [lay(self._plans[1], self.intervals)]
        return self._plans[1], self._lanes[0]

    def starts(self, x: Array) -> tuple[Array, Array]:
        """States at the intervals' starts, (intervals, nz), and their derivative by the parameters."""
        z, by_p = self._interval_starts(self.per_run(x), self._whole(x)[0])
        if len(self.loose):
            z[:, self.loose] += x[self.parameters.size :].reshape(len(self.intervals), -1)
        return z, by_p

    def _where_valid(self) -> list[Mask]:
        """Per run, (n, outputs): readings that count, where the equations hold or an interval starts."""
        result = where_valid(self.model, self.runs)
        states = [
            self.model.outputs.index(state.name) for state in self.model.states if state.name in self.model.outputs
        ]
        for k, valid in enumerate(result):  # readings at starts always count: nothing else determines a free start
            valid[np.ix_([interval.start for interval in self.intervals if interval.run == k], states)] = True
        return result

    def _targets(self, robust: float | None, keep: Sequence[Array] | None, reading: Array | None) -> Targets:
        """Targets from kept readings in rows in which the model's equations hold."""
        kept: Sequence[Array | Mask] = self._valid
        if keep is not None:
            wide = (np.asarray(item, dtype=float).reshape(len(item), -1) for item in keep)
            kept = [item * valid for item, valid in zip(wide, kept, strict=True)]
        return targets(self.runs, self.intervals, self.noise, robust, kept, reading)

    def _steps(self) -> list[int]:
        """Segments per row, run by run: the only influence of the longest segment on schedules."""
        return [int(segments_of_rows(run, self.longest)) for run in self.runs]

    def _scheduled(self, shifts: Array) -> list[Schedule]:
        return [schedule(self.trace, run, shift, self.longest) for run, shift in zip(self.runs, shifts, strict=True)]

    def _intervals(self, k: int, run: MotionRun, every: int) -> list[Interval]:
        """Every `every`-th horizon of a run, each starting in a row with readings of all measured states."""
        rows = len(run) if self.horizon is None else max(1, round(self.horizon / run.sample_time))
        channels = [self.model.outputs.index(name) for name in run.states_read(self.model)]
        starts = run.starts(channels, np.arange(0, len(run), rows))
        stops = np.append(starts[1:], len(run))[: len(starts)]
        return [Interval(k, a, b) for a, b in zip(starts[::every].tolist(), stops[::every].tolist(), strict=True)]

    @cached_property
    def _moving_index(self) -> Index:
        """(intervals, q) indices of each interval's free parameters and free starts among all unknowns."""
        return np.asarray(self.layout.index)[:, self._chosen]

    @cached_property
    def _chosen(self) -> Index:
        """(q,) indices of the free parameters and free starts among an interval's unknowns."""
        return np.concatenate((self.moving, self.model.size + np.arange(len(self.loose))))

    def against(self, lanes: Lanes) -> LaneTargets:
        """Targets arranged by lanes; the last two are cached, for hours of data one."""
        for known, of, against in self._laid:
            if known is lanes and of is self.targets:
                return against
        self._laid = self._laid[-1:] if self.targets.reading.size <= HOURS else []
        weight, target = lanes.scattered(self.targets.weight), lanes.scattered(self.targets.reading)
        against = LaneTargets(target, weight, self.targets.robust)
        self._laid = [*self._laid, (lanes, self.targets, against)]
        return against

    def _accumulated(
        self, x: Array, nodes: SimulatedRuns, residuals: Array | None = None
    ) -> tuple[Array | None, Array, Array]:
        """J'J and J'r of every lane, and T, the derivative of the lane's variables by its interval's unknowns.

        Lanes of cut intervals have their initial state and the free parameters as variables, since initial states
        follow from lane to lane afterwards. Uncut ones have the unknowns themselves, and T is None.
        """
        cut, moving, loose = nodes.cut, self.moving, self.loose
        _, starts_by_p = self.starts(x)
        size, count, places = self.trace.size, len(self.moving), np.arange(len(self.moving))
        uncut = cut is nodes.lanes
        if uncut:
            seed = np.concatenate((starts_by_p[:, :, moving], np.zeros((len(cut.interval), size, len(loose)))), axis=2)
            seed[:, loose, count + np.arange(len(loose))] = 1.0
        else:
            seed, places = np.tile(np.eye(size, size + count), (len(cut.interval), 1, 1)), size + places
        Z, H, g = self.simulator.kernel.normal_equations(
            nodes.starts, cut.segments, self.of_intervals(x)[cut.interval], cut.reads, moving, seed, places,
            self.against(cut), residuals,
        )  # fmt: skip
        if uncut:
            return None, H, g
        G = chained(cut, Z, starts_by_p[:, :, moving], loose)
        if residuals is None:
            self._chain = Chain(x.copy(), self._moving_index, nodes.starts, G, Z[:, :, :size])
        of_parameters = np.broadcast_to(np.eye(count, G.shape[2]), (len(G), count, G.shape[2]))
        return np.concatenate((G, of_parameters), axis=1), H, g

    def _linearised(self, x: Array, nodes: SimulatedRuns) -> Iterator[tuple[slice, Array]]:
        """Slices of lanes, and the derivative of their weighted residuals by the unknowns in `_moving_index`."""
        cut, p, size, count = nodes.cut, self.of_intervals(x)[nodes.cut.interval], self.trace.size, len(self.moving)
        _, starts_by_p = self.starts(x)
        weight = self.against(cut).weighted(nodes.read if nodes.used is cut else cut.scattered(nodes.y))[1]
        before: tuple[Array, Array] | None = None
        for first in range(0, len(p), max(LANES, 1)):
            block = slice(first, min(first + LANES, len(p)))
            _, Z, _, Y = self.simulator.kernel.linearise(
                nodes.starts[block], cut.segments[block], p[block], cut.reads, self.moving
            )
            G = chained(cut, Z, starts_by_p[:, :, self.moving], self.loose, block, before)
            before = G[-1], Z[-1]
            lanes, reads, outputs, _ = Y.shape
            J = Y[..., :size].reshape(lanes, reads * outputs, size) @ G
            J[:, :, :count] += Y[..., size:].reshape(lanes, reads * outputs, -1)
            J = J.reshape(lanes, reads, outputs, -1)
            J *= weight[block, ..., None]
            yield block, J


def _add(H: Array | None, g: Array, index: Index, inner: Array | None, pull: Array) -> None:
    """Add the J'J and J'r of lanes to H and g, in place, at the indices of their unknowns."""
    first = index[0]
    if (index == first).all():
        g[first] += pull.sum(axis=0)
        if H is not None and inner is not None:
            H[first[:, None], first] += inner.sum(axis=0)
        return
    np.add.at(g, index, pull)
    if H is not None and inner is not None:
        np.add.at(H, (index[:, :, None], index[:, None, :]), inner)
