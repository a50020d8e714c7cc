"""Predictions of a motion model over fixed horizons and in free run, each from readings of a row.

States that are not recorded come from an observer (simulator.py): the model run along the recording with every state
that is read set back to its reading row by row.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from ...base.shorthands import Array, Index
from ...datasets.recording import Recording
from ..simulation import Prediction
from .lanes import Interval, lay
from .runs import MotionRun, motion_runs
from .schedule import Schedule, least_segment, longest_segment, schedule
from .simulator import Simulator, observed

MOST_STARTS = 4000
"""Rows predicted from, at most; beyond it every second, third ... row is."""
HUGE = 1e6
"""Beyond this a simulation went astray; how stiff the model is there is no guide to anything."""


class Predictor:
    """A model at given parameters laid over a recording.

    Parameters
    ----------
    simulator : the model.
    recording : the recording.
    p : (parameters,).
    given : states at the starts of free runs, where they are not to be taken from readings. Recordings of inputs alone
        will do where it is not None.
    """

    def __init__(
        self, simulator: Simulator, recording: Recording, p: Array, given: Mapping[str, float] | None = None
    ) -> None:
        self.simulator, self.p, self._given = simulator, p, dict(given or {})
        model = simulator.trace.model
        self.runs = motion_runs(model, recording, unread=given is not None)
        self._read = [run.states_read(model) for run in self.runs]
        self._observed: list[Array] | None = None
        self._seen = any(self._read) and not self._given  # readings tell how stiff the model is along the way
        known = self.runs if self._seen else [self._held(run) for run in self.runs]
        self._lay_out(longest_segment(simulator.trace, known, p))

    def free_run(self) -> Prediction:
        """Every run from the readings of its first row to its end."""
        intervals = []
        for k, run in enumerate(self.runs):
            first = run.starts(self._channels(self._counting(k)), np.array([0]))
            intervals += [Interval(k, int(a), len(run)) for a in first]
        rows = [(i.run, np.arange(i.start, i.stop)) for i in intervals]
        if not intervals:
            return self._collected(rows, np.empty((0, len(self.simulator.trace.model.outputs))))
        result = self._run_freely(intervals)
        if not self._seen:
            edges = np.cumsum([len(item) for _, item in rows])[:-1]
            longest = self._longest_along(rows, np.split(result, edges))
            if longest < self._longest * (1 - 1e-9):  # it went where the model is stiffer
                self._lay_out(longest)
                result = self._run_freely(intervals)
        return self._collected(rows, result)

    def ahead(self, horizon: float, overlapping: int | None = None) -> Prediction:
        """Rows predicted from the readings so many seconds before.

        Parameters
        ----------
        horizon : s.
        overlapping : how many windows a row lies in at most; None: every row is predicted, as far as `MOST_STARTS` go.
        """
        chosen: list[tuple[int, Index]] = []
        result = []
        stride = max(1, round(sum(len(run) for run in self.runs) / MOST_STARTS))
        for k, (run, states) in enumerate(zip(self.runs, self.observed(), strict=True)):
            steps = max(1, round(horizon / run.sample_time))
            complete = np.all(np.isfinite(run.measured[:, self._channels(self._read[k])]), axis=1)
            apart = stride if overlapping is None else max(stride, steps // overlapping)
            begin = np.flatnonzero(complete[: max(0, len(run) - steps)])[::apart]
            if len(begin):
                chosen.append((k, begin + steps))
                result.append(self._led(self._plans[k], states[begin], begin, begin + steps))
        empty = np.empty((0, len(self.simulator.trace.model.outputs)))
        return self._collected(chosen, np.vstack(result) if result else empty)

    def observed(self) -> list[Array]:
        """Per run, (n, nz) states with those that are read as read and the others as the model carries them."""
        if self._observed is None:
            pairs = zip(self.runs, self._plans, strict=True)
            self._observed = [observed(self.simulator, run, plan, self.p) for run, plan in pairs]
        return self._observed

    def _lay_out(self, longest: float) -> None:
        """Segments of all runs, none longer than this, s."""
        shifts = self.simulator.shifts(self.p)
        self._longest = longest
        self._plans = [schedule(self.simulator.trace, run, shifts, longest) for run in self.runs]

    def _run_freely(self, intervals: Sequence[Interval]) -> Array:
        """(rows, outputs) of all intervals, one after the other."""
        lanes = lay(self._plans, intervals)
        z0 = np.vstack([self._start(i.run, np.array([i.start])) for i in intervals])
        with np.errstate(all="ignore"):
            _, y = self.simulator.kernel.simulate(z0, lanes.segments, self.p, lanes.reads)
        return np.where(lanes.lane >= 0, _astray(y)[lanes.lane, lanes.rank, np.arange(y.shape[2])], np.nan)

    def _held(self, run: MotionRun) -> MotionRun:
        """A run as if its states stayed where they start: all that is known of them before it is simulated."""
        outputs = self.simulator.trace.model.outputs
        first = np.nan_to_num(run.measured[0])
        for name, value in self._given.items():
            if name in outputs:
                first[outputs.index(name)] = value
        return replace(run, measured=np.tile(first, (len(run), 1)))

    def _longest_along(self, rows: Sequence[tuple[int, Index]], simulated: Sequence[Array]) -> float:
        """The longest segment, s, with what was simulated in the place of readings."""
        along = []
        for (k, item), y in zip(rows, simulated, strict=True):
            if not np.all(np.abs(y[-1]) < HUGE):
                return least_segment(self.runs[k].sample_time)
            measured = np.full(self.runs[k].measured.shape, np.nan)
            measured[item] = y
            along.append(replace(self.runs[k], measured=measured))
        return longest_segment(self.simulator.trace, along, self.p)

    def _led(self, plan: Schedule, z0: Array, begin: Index, end: Index) -> Array:
        """Readings at rows `end` from states at rows `begin`."""
        first = plan.row_segment[begin]
        read = np.where(plan.read_segment[end] >= first[:, None], plan.read_segment[end], -1)
        ends = np.maximum(plan.row_segment[end], np.max(read, axis=1))  # a latency of zero is read just after its row
        length = int(np.max(ends - first)) + 1
        places = np.minimum(first[:, None] + np.arange(length), len(plan.segments) - 1)
        segments = plan.segments[places]
        segments[places > ends[:, None]] = 0.0
        rank = np.where(read >= 0, read - first[:, None], 0)
        reads = np.zeros(length, dtype=bool)
        reads[np.unique(rank)] = True
        with np.errstate(all="ignore"):
            _, y = self.simulator.kernel.simulate(z0, segments, self.p, reads)
        among = np.cumsum(reads) - 1
        result = _astray(y)[np.arange(len(begin))[:, None], among[rank], np.arange(y.shape[2])]
        return np.where(read >= 0, result, np.nan)

    def _start(self, k: int, rows: Index) -> Array:
        run, given, counting = self.runs[k], tuple(self._given), self._counting(k)
        values = np.tile(list(self._given.values()), (len(rows), 1))
        readings = np.hstack([run.measured[rows][:, self._channels(counting)], values])
        return self.simulator.start(counting + given, readings, run.inputs[rows], self.p, given)[0]

    def _counting(self, k: int) -> tuple[str, ...]:
        """States of a run whose readings count: those that are not given."""
        return tuple(name for name in self._read[k] if name not in self._given)

    def _channels(self, names: tuple[str, ...]) -> list[int]:
        return [self.simulator.trace.model.outputs.index(name) for name in names]

    def _collected(self, rows: Sequence[tuple[int, Index]], predicted: Array) -> Prediction:
        def of(run: MotionRun, index: Index) -> Index:
            return np.asarray(run.rows.start + index)

        if not rows:
            return Prediction(np.empty(0, np.intp), predicted, predicted, np.empty(0, np.intp))
        return Prediction(
            rows=np.concatenate([of(self.runs[k], item) for k, item in rows]),
            predicted=predicted,
            measured=np.vstack([self.runs[k].measured[item] for k, item in rows]),
            run=np.concatenate([np.full(len(item), k) for k, item in rows]),
        )


def _astray(y: Array) -> Array:
    """Predictions in which no number stands for one beyond all bounds: NaN is left to what nobody predicted."""
    return np.where(np.isnan(y), np.inf, y)
