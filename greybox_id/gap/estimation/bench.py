"""The test bench of a diagnosis: one model with everything it may lack, simulated many times over the same recordings.

All candidates are in one model, at their null values, so that one compiled kernel serves every hypothesis. Simulations
lie side by side in lanes; delays and latencies that are zero, and stay so, cut no segments.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from ...base.errors import BadInput
from ...base.shorthands import Array, Index
from ...datasets.recording import Recording
from ...engine.kernel import PAYS, WIDEST
from ...engine.motion.lanes import Interval, Lanes, chained, cut_rows, even_cuts, lay, packed
from ...engine.motion.schedule import MotionRun, Schedule, longest_segments, motion_runs, schedule
from ...engine.motion.simulator import Simulator
from ...models.motion_model import MotionModel
from .calibration import CAL
from .stable_slip import with_step_lengths
from .unknown_forces import knows_unknown_forces


@dataclass(frozen=True)
class Simulated:
    """A simulation: predicted readings, (N, outputs), and states, (lanes, nz), where `linearise` cuts the runs."""

    y: Array
    cuts: Array


def _runs(model: MotionModel, recordings: Sequence[Recording]) -> list[MotionRun]:
    """The runs of recordings; parts in which sensors were silent have none, as long as others have."""
    result, lacking = list[MotionRun](), list[BadInput]()
    for recording in recordings:
        try:
            result += motion_runs(model, recording)
        except BadInput as error:
            lacking.append(error)
    if not result:
        raise lacking[0]
    return result


@dataclass(frozen=True)
class Plans:
    """The segments of each run, and how `linearise` cuts them."""

    runs: Sequence[Schedule]

    @cached_property
    def lanes(self) -> list[int]:
        """Lanes into which each run is cut: a vector's worth in all, the longer the run, the more."""
        whole = [Interval(k, 0, len(plan.row_segment)) for k, plan in enumerate(self.runs)]
        return even_cuts(self.runs, whole, WIDEST)

    @cached_property
    def cuts(self) -> list[Index]:
        """Of each run, the segments at which these lanes begin."""
        return [
            plan.row_segment[cut_rows(plan, 0, len(plan.row_segment), count)]
            for plan, count in zip(self.runs, self.lanes, strict=True)
        ]


def _taken(lanes: Lanes) -> tuple[NDArray[np.bool_], Index | None]:
    """Which readings are of a lane's rows, (L, R), and the places of all rows' among them; None: one after the other.

    Where rows are cut into different numbers of segments, lanes are read at the rows of others, too.
    """
    there, outputs = lanes.lane >= 0, lanes.lane.shape[1]
    taken = np.zeros((len(lanes.interval), np.count_nonzero(lanes.reads)), dtype=bool)
    taken[lanes.lane[there], lanes.rank[there]] = True
    rank = (np.cumsum(taken) - 1).reshape(taken.shape)[np.maximum(lanes.lane, 0), np.maximum(lanes.rank, 0)]
    place = np.where(there, rank * outputs + np.arange(outputs), 0).ravel()
    return taken, None if np.array_equal(place, np.arange(np.count_nonzero(taken) * outputs)) else place


@dataclass(frozen=True)
class Passage:
    """Segments of a run that are integrated one after the other.

    Attributes
    ----------
    plan, segments : the run's schedule, and which of its segments.
    cuts : segments, counted from the first of these, at whose starts states are kept.
    """

    plan: Schedule
    segments: slice
    cuts: Index

    def __len__(self) -> int:
        return int(self.segments.stop - self.segments.start)


@dataclass(frozen=True)
class Integrated:
    """An integrated passage: states at its cuts, the state at its end, and readings in the order of reading."""

    cuts: Array
    end: Array
    y: Array

    def readings(self, plan: Schedule) -> Array:
        """(n, outputs) readings by rows, if the passage is a whole run; NaN where there is none."""
        result = self.y.ravel().take(plan.taken)
        if not plan.complete:
            result[plan.taken < 0] = np.nan
        return result.reshape(plan.read_segment.shape)


class Bench:
    """Simulates whole runs freely.

    Parameters
    ----------
    model : with all candidates.
    recordings : what to simulate; N rows in all.
    simulator : of the model, where there is one already.

    Attributes
    ----------
    runs : the recordings' unbroken runs.
    measured : (N, outputs) readings, NaN where there is none.
    rows : slices of the N rows, per run.
    counted : (N, outputs) readings that exist, without a run's first moments, which a late sensor does not cover.
    loose : indices of states that start at a noisy reading: their starts are nuisances.
    """

    def __init__(self, model: MotionModel, recordings: Sequence[Recording], simulator: Simulator | None = None) -> None:
        self.model, self.size = model, model.size
        self.simulator = simulator or Simulator(model, compiled=None)
        self.runs = _runs(model, recordings)
        edges = np.concatenate(([0], np.cumsum([len(run) for run in self.runs])))
        self.rows = [slice(int(a), int(b)) for a, b in zip(edges[:-1], edges[1:], strict=True)]
        self.measured = np.vstack([run.measured for run in self.runs])
        self.counted = np.isfinite(self.measured)
        for run, rows in zip(self.runs, self.rows, strict=True):
            self.counted[rows] &= (run.time - run.time[0] >= CAL.settling)[:, None]
        self.time = np.concatenate([run.time for run in self.runs])
        self.inputs = np.vstack([run.inputs for run in self.runs])
        if len(self.time) * WIDEST > PAYS:  # many simulations follow: compile before the first of them
            self.simulator.kernel.prepare()
        self.longest = longest_segments(self.simulator.trace, self.runs, model.values)
        self.runs = [with_step_lengths(model, run, each) for run, each in zip(self.runs, self.longest, strict=True)]
        self.loose: tuple[int, ...] = ()
        if not knows_unknown_forces(model) or len(self.runs) <= CAL.few_runs:
            self.loose = tuple(k for k, state in enumerate(model.states) if state.name in model.outputs)
        self._readings = [self._starting_readings(run) for run in self.runs]
        self._schedules: dict[tuple[float, ...], Plans] = {}
        self._simulated: dict[bytes, Simulated] = {}
        self._room = np.empty(0)  # memory for segments of unlike runs side by side, reused by each call

    @property
    def learnt(self) -> bool:
        """Whether a learnt network replaces the equations."""
        return self.model.learnt

    @property
    def channels(self) -> tuple[str, ...]:
        """Outputs, in order."""
        return self.model.outputs

    @property
    def sample_time(self) -> float:
        """Usual step, s."""
        return float(np.median([run.sample_time for run in self.runs]))

    def simulate(self, P: Array) -> Array:
        """(K, N, outputs) readings predicted with each of (K, parameters) vectors."""
        return np.stack([simulation.y for simulation in self._simulations(P)])

    def _simulations(self, P: Array) -> list[Simulated]:
        """Simulations with each vector: those that are remembered, and new ones."""
        P = np.ascontiguousarray(P, dtype=float)
        keys = [p.tobytes() for p in P]
        known = {key: self._simulated[key] for key in keys if key in self._simulated}
        new = {key: k for k, key in enumerate(keys) if key not in known}
        if new:
            some = P[list(new.values())]
            plans = [self._scheduled(tuple(self.simulator.shifts(p[: self.size]))) for p in some]
            known |= dict(zip(new, self._simulated_along(plans, some), strict=True))
        for key in keys:  # the least recently requested is dropped first
            self._simulated.pop(key, None)
            self._simulated[key] = known[key]
        most = max(WIDEST, CAL.remembered // max(self.measured.size, 1))
        for key in list(self._simulated)[: max(len(self._simulated) - most, 0)]:
            del self._simulated[key]
        return [known[key] for key in keys]

    def _simulated_along(self, plans: Sequence[Plans], P: Array) -> list[Simulated]:
        """Simulations with each vector, along its own segments."""
        starts, count = self._starts(P), len(self.runs)
        whole = [
            Passage(plan, slice(0, len(plan.segments)), cuts)
            for item in plans
            for plan, cuts in zip(item.runs, item.cuts, strict=True)
        ]
        result = self._integrated(whole, starts.reshape(len(whole), -1), np.repeat(P, count, axis=0))
        return [self._simulated_by(plan, result[k * count : (k + 1) * count]) for k, plan in enumerate(plans)]

    def _simulated_by(self, plans: Plans, runs: Sequence[Integrated]) -> Simulated:
        """A simulation made of integrated runs."""
        y = np.full(self.measured.shape, np.nan)
        for rows, plan, run in zip(self.rows, plans.runs, runs, strict=True):
            y[rows] = run.readings(plan)
        return Simulated(y, np.concatenate([run.cuts for run in runs]))

    def _integrated(self, passages: Sequence[Passage], z0: Array, P: Array) -> list[Integrated]:
        """Integrate passages, those of similar length in one call: a call takes as long as its longest passage."""
        kernel, result = self.simulator.kernel, dict[int, Integrated]()
        first = dict[int, int]()
        for k, passage in enumerate(passages):  # not by address: rounding depends on which passages share a call
            first.setdefault(id(passage.plan), k)
        order = sorted(range(len(passages)), key=lambda k: (len(passages[k]), first[id(passages[k].plan)]))
        lengths = tuple(len(passages[k]) for k in order)
        for part in packed(lengths) if kernel.compiled else [slice(0, len(order))]:
            call = order[part]
            segments, reads = self._laid_out([passages[k] for k in call])
            keeps = np.zeros(len(reads) + 1, dtype=bool)
            for k in call:
                keeps[passages[k].cuts] = keeps[len(passages[k])] = True
            with np.errstate(all="ignore"):
                z, y = kernel.simulate(z0[call], segments, P[call], reads, keeps)
            place, rank = np.cumsum(keeps) - 1, np.cumsum(reads) - 1
            for lane, k in enumerate(call):
                each, its = passages[k], y[lane]
                if len(call) > 1 and segments.strides[0] != 0:  # lanes are read at different segments
                    its = its[rank[: len(each)][each.plan.reads[each.segments]]]
                result[k] = Integrated(z[lane, place[each.cuts]], z[lane, place[len(each)]], its)
        return [result[k] for k in range(len(passages))]

    def _laid_out(self, passages: Sequence[Passage]) -> tuple[Array, NDArray[np.bool_]]:
        """Segments of passages side by side, (L, S, segment size), and at which of their starts any lane is read.

        Shorter passages are padded with segments of no length; passages with the same segments share them.
        """
        first, *_ = passages
        if all(passage.plan is first.plan and passage.segments == first.segments for passage in passages):
            segments = first.plan.segments[first.segments]
            return np.broadcast_to(segments, (len(passages), *segments.shape)), first.plan.reads[first.segments]
        most, size = max(len(passage) for passage in passages), first.plan.segments.shape[1]
        if len(self._room) < len(passages) * most * size:
            self._room = np.empty(len(passages) * most * size)
        segments, reads = self._room[: len(passages) * most * size], np.zeros(most, dtype=bool)
        segments = segments.reshape(len(passages), most, size)
        for lane, passage in zip(segments, passages, strict=True):
            lane[: len(passage)] = passage.plan.segments[passage.segments]
            lane[len(passage) :] = 0.0
            reads[: len(passage)] |= passage.plan.reads[passage.segments]
        return segments, reads

    def along(self, p: Array) -> Array:
        """Parameters along the segments of `trajectory`, (S, parameters); one vector where they are the same in all."""
        return p

    def trajectory(self, p: Array) -> list[tuple[Schedule, Array]]:
        """Every run's segments, and the states (segments, nz) at their starts, simulated with these parameters."""
        plans, (starts,) = self._scheduled(tuple(self.simulator.shifts(p))).runs, self._starts(p[None])
        whole = [Passage(plan, slice(0, len(plan.segments)), np.arange(len(plan.segments))) for plan in plans]
        result = self._integrated(whole, starts, np.tile(p, (len(plans), 1)))
        return [(plan, item.cuts) for plan, item in zip(plans, result, strict=True)]

    def linearise(self, p: Array, columns: Sequence[int]) -> tuple[Array, Array, Array]:
        """A simulation and its derivatives.

        Parameters
        ----------
        p : (parameters,).
        columns : parameters to differentiate by.

        Returns
        -------
        y : (N, outputs).
        J : (N, outputs, columns).
        S : (N, outputs, runs * loose) by the starts of every run.
        """
        moving = [not by.isdisjoint(columns) for by in self._shifted_by]
        shifts = self.simulator.shifts(p[: self.size])
        plans = self._scheduled(tuple(shifts))
        if any(moving):
            plans = self._planned(shifts, moving)
        cut, by_lane, held = self._lanes_in(plans, p)
        by_p = self._starts_by(p)
        (result,) = self._simulated_along([plans], p[None]) if any(moving) else self._simulations(p[None])
        chosen, kernel, size = np.asarray(columns, dtype=np.intp), self.simulator.kernel, self.simulator.trace.size
        with np.errstate(all="ignore"):
            taken, place = _taken(cut)
            _, Z_end, _, Y = kernel.linearise(result.cuts, cut.segments, by_lane, cut.reads, chosen, taken)
            parts = [slice(a, b) for a, b in pairwise(np.cumsum([0, *np.count_nonzero(taken, axis=1)]))]
            for lanes_held, index in held:
                at = size + np.flatnonzero(chosen == index)
                Z_end[np.ix_(lanes_held, np.arange(size), at)] = 0.0
                for lane in lanes_held:
                    Y[parts[lane], :, at] = 0.0
            G = chained(cut, Z_end, by_p[:, :, chosen], np.array(self.loose, dtype=np.intp))
            J = np.empty((*Y.shape[:2], G.shape[2]))
            for by_start, part in zip(G, parts, strict=True):  # one product per lane, not one per reading
                each, result_of = Y[part].reshape(-1, Y.shape[2]), J[part].reshape(-1, J.shape[2])
                np.matmul(each[:, :size], by_start, out=result_of)
                result_of[:, : len(chosen)] += each[:, size:]
        if place is not None:
            J = J.reshape(-1, J.shape[2]).take(place, axis=0).reshape(*cut.lane.shape, -1)
            J[cut.lane < 0] = 0.0
        with np.errstate(all="ignore"):
            within = abs(np.sum(J)) < CAL.far
        if not within:  # the last rows of a diverging simulation have no useful derivatives
            J = np.nan_to_num(J, copy=False, posinf=0.0, neginf=0.0)
            np.clip(J, -CAL.far, CAL.far, out=J)
        loose = len(self.loose)
        S = np.zeros((*self.measured.shape, len(self.runs) * loose))
        for k, rows in enumerate(self.rows):
            S[rows, :, k * loose : (k + 1) * loose] = J[rows, :, len(chosen) :]
        return result.y.copy(), J[:, :, : len(chosen)], S

    def _lanes_in(self, plans: Plans, p: Array) -> tuple[Lanes, Array, Sequence[tuple[Index, int]]]:
        """Lanes of runs, to be differentiated, their parameters, and (lanes, parameter without effect in them)."""
        return lay(plans.runs, [Interval(k, 0, len(run)) for k, run in enumerate(self.runs)], plans.lanes), p, ()

    @cached_property
    def _shifted_by(self) -> list[set[int]]:
        """Of each shift, the parameters that it depends on."""
        trace = self.simulator.trace
        pattern = zip(*trace.timing.jac_sparsity(0, 0).get_triplet(), strict=True) if trace.shift_count else ()
        result = [set[int]() for _ in range(trace.shift_count)]
        for shift, parameter in pattern:
            result[shift].add(parameter)
        return result

    def _scheduled(self, shifts: tuple[float, ...]) -> Plans:
        if shifts not in self._schedules:
            while len(self._schedules) > 2 * WIDEST:
                del self._schedules[next(iter(self._schedules))]
            self._schedules[shifts] = self._planned(np.array(shifts), [False] * len(shifts))
        return self._schedules[shifts]

    def _planned(self, shifts: Array, moving: Sequence[bool]) -> Plans:
        """Segments of all runs at these delays and latencies, of which some are differentiated by."""
        runs = zip(self.runs, self.longest, strict=True)
        return Plans([schedule(self.simulator.trace, run, shifts, longest, moving) for run, longest in runs])

    def _starts(self, P: Array) -> Array:
        """(K, runs, nz) states at the runs' starts."""
        K, result = len(P), np.empty((len(P), len(self.runs), self.simulator.trace.size))
        for names, which, readings, inputs, p in self._starts_alike(P):
            z = self.simulator.start_states(names, np.repeat(readings, K, axis=0), np.repeat(inputs, K, axis=0), p)
            result[:, which] = z.reshape(len(which), K, -1).swapaxes(0, 1)
        return result

    def _starts_by(self, p: Array) -> Array:
        """(runs, nz, parameters) derivatives of these states by the parameters."""
        result = np.empty((len(self.runs), self.simulator.trace.size, self.size))
        for names, which, readings, inputs, at in self._starts_alike(p[None]):
            result[which] = self.simulator.start(names, readings, inputs, at)[1]
        return result

    def _starts_alike(self, P: Array) -> Iterator[tuple[tuple[str, ...], list[int], Array, Array, Array]]:
        """Runs that read the same states: these, which runs, first readings and inputs; parameters, run by run."""
        at_starts = self._at_starts(P)
        for names in dict.fromkeys(names for names, _ in self._readings):
            which = [k for k, (others, _) in enumerate(self._readings) if others == names]
            readings, inputs = (np.array(each) for each in zip(*(
                (self._readings[k][1], self.runs[k].inputs[0]) for k in which), strict=True))  # fmt: skip
            yield names, which, readings, inputs, np.concatenate([at_starts[k] for k in which])

    def _at_starts(self, P: Array) -> Sequence[Array]:
        """Of each run, (K, parameters) vectors in force where it begins."""
        return [P] * len(self.runs)

    def _starting_readings(self, run: MotionRun) -> tuple[tuple[str, ...], Array]:
        """Names of the states that are read, and their first readings, at which simulations start."""
        names = run.states_read(self.model)
        columns = [self.model.outputs.index(name) for name in names]
        first = np.array([run.measured[np.flatnonzero(np.isfinite(run.measured[:, c]))[:1], c][0] for c in columns])
        return names, first
