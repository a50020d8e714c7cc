"""A traced motion model with its kernel, shared by problems over different recordings and horizons.

Predictions over fixed horizons and in free run start from the readings of a row. Unmeasured states come from an
observer: the model run along the recording, with every measured state reset to its reading row by row. Actuators at the
starts of intervals come from the commands before them.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from copy import copy
from dataclasses import dataclass, replace
from functools import cached_property

import casadi as cs
import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from ...base.shorthands import Array, Index, Mask
from ...datasets.recording import Recording
from ...models.motion_model import MotionModel
from ..kernel import Kernel
from ..simulation import Prediction
from ..virtual import SampledFunction, on_arrays
from .lanes import Interval, lay
from .schedule import MotionRun, Schedule, least_segment, longest_segment, motion_runs, schedule
from .traced import traced

ALONE = 25
"""Cost of a segment of a single trajectory in the virtual machine, in lanes: 40 us, against 1.5 us per lane of many."""


class Simulator:
    """A traced model and its kernel.

    Parameters
    ----------
    model : the model.
    compiled : whether the kernel is compiled; None decides by the work.
    """

    def __init__(self, model: MotionModel, compiled: bool | None = None) -> None:
        self.trace = traced(model)
        known = self.trace.kernel
        self.kernel = known if compiled is None else Kernel(self.trace.step, self.trace.output, compiled=compiled)
        self.actuators = self._actuators() if model.actuators else None
        self._starts: dict[tuple[tuple[str, ...], tuple[str, ...], bool], SampledFunction] = {}
        self._touched: dict[tuple[str, ...], Index] = {}
        self._timing = on_arrays(self.trace.timing)

    def of(self, model: MotionModel) -> Simulator:
        """The same simulator for a model with the same equations but other values, bounds or priors."""
        result = copy(self)
        result.trace = self.trace.of(model)
        return result

    def shifts(self, p: Array) -> Array:
        """Values of the delays and latencies, s."""
        if self.trace.shift_count == 0:
            return np.empty(0)
        return self._timing(p)[0].ravel()

    def start(
        self, measured: tuple[str, ...], readings: Array, inputs: Array, p: Array, given: tuple[str, ...] = ()
    ) -> tuple[Array, Array]:
        """Initial states, (n, nz), and their derivative by the parameters, (n, nz, parameters).

        Parameters
        ----------
        measured : states with a reading.
        readings : (n, measured).
        inputs : (n, inputs).
        p : (parameters,) or (n, parameters).
        given : measured states whose reading is the state itself, not a sensor's.
        """
        size, function = self.trace.size, self._start_function(measured, given, True)
        result = np.broadcast_to(function(readings, inputs, p), (len(readings), function.outputs))
        return result[:, :size], result[:, size:].reshape(len(readings), size, function.outputs // size - 1)

    def start_states(
        self, measured: tuple[str, ...], readings: Array, inputs: Array, p: Array, given: tuple[str, ...] = ()
    ) -> Array:
        """The initial states of `start` alone: derivatives by all parameters take a hundred times as long."""
        result = self._start_function(measured, given, False)(readings, inputs, p)
        return np.broadcast_to(result, (len(readings), self.trace.size))

    def _start_function(self, measured: tuple[str, ...], given: tuple[str, ...], by_p: bool) -> SampledFunction:
        """(readings, inputs, parameters) -> initial states, and with `by_p` their derivatives."""
        key = (measured, given, by_p)
        if key not in self._starts:
            y, u, q = (cs.SX.sym(name, size) for name, size in zip("yuq", self._sizes(measured), strict=True))
            z = self.trace.start(measured, given)(y, u, q)
            stacked = cs.vertcat(z, cs.vec(cs.jacobian(z, q).T)) if by_p else z
            self._starts[key] = SampledFunction(cs.Function("starts", [y, u, q], [cs.densify(stacked)]))
        return self._starts[key]

    def start_touched(self, measured: tuple[str, ...]) -> Index:
        """Parameters that the initial states depend on."""
        if measured not in self._touched:
            function = self.trace.start(measured)
            pattern = function.jac_sparsity(0, 2) if function.numel_in(2) else cs.Sparsity(function.numel_out(0), 0)
            self._touched[measured] = np.array(sorted(set(pattern.get_col())), dtype=np.intp)
        return self._touched[measured]

    @cached_property
    def actuators_touched(self) -> Index:
        """Parameters that actuators depend on."""
        pattern = self.trace.actuation.jac_sparsity(0, 2)
        return np.array(sorted({*pattern.get_triplet()[1]}), dtype=np.intp)

    def _actuators(self) -> Kernel:
        """A kernel of the actuators alone, whose outputs are their states."""
        a, s, p = (cs.SX.sym(name, self.trace.actuation.numel_in(k)) for k, name in enumerate("asp"))
        return Kernel(self.trace.actuation, cs.Function("standing", [a, s, p], [a]))

    def _sizes(self, measured: tuple[str, ...]) -> tuple[int, int, int]:
        return len(measured), len(self.trace.model.inputs), self.trace.model.size


def observed(simulator: Simulator, run: MotionRun, plan: Schedule, p: Array) -> Array:
    """(n, nz) states at every row, from running the model along a recording and resetting it to every reading.

    It is reset in rows in which all measured states have a reading, and starts from their first readings.

    Parameters
    ----------
    simulator : the model.
    run : the run.
    plan : its segments.
    p : (parameters,).
    """
    model = simulator.trace.model
    names = run.states_read(model)
    states = [simulator.trace.names.index(name) for name in names]
    readings = run.measured[:, [model.outputs.index(name) for name in names]]
    complete = np.all(np.isfinite(readings), axis=1)
    first = [item[np.isfinite(item)][0] for item in readings.T]
    starts = np.where(complete[:, None], readings, first)
    corrected = np.array(simulator.start_states(names, starts, run.inputs, p))
    measured = np.isin(np.arange(simulator.trace.size), states)
    if measured.all() and complete.all():
        return corrected
    simulator.kernel.expect(ALONE * len(plan.segments))
    with np.errstate(all="ignore"):
        return simulator.kernel.followed(plan.segments, p, plan.row_segment, corrected, measured, complete)


MOST_STARTS = 4000
"""Largest number of rows to predict from; beyond it, every second, third ... row is used."""
HUGE = 1e6
"""Size of outputs beyond which a simulation has diverged; the model's stiffness there is meaningless."""


class Predictor:
    """A model at given parameters with a recording.

    Parameters
    ----------
    simulator : the model.
    recording : the recording.
    p : (parameters,).
    given : initial states of free runs that replace readings. If it is not None, a recording without outputs is
        accepted.
    """

    def __init__(
        self, simulator: Simulator, recording: Recording, p: Array, given: Mapping[str, float] | None = None
    ) -> None:
        self.simulator, self.p, self._given = simulator, p, dict(given or {})
        model = simulator.trace.model
        self.runs = motion_runs(model, recording, unread=given is not None)
        self._read = [run.states_read(model) for run in self.runs]
        self._observed: list[Array] | None = None
        self._seen = any(self._read) and not self._given  # readings along the run tell the model's stiffness
        run_data = self.runs if self._seen else [self._held(run) for run in self.runs]
        self._lay_out(longest_segment(simulator.trace, run_data, p))

    def free_run(self) -> Prediction:
        """Every run simulated from the readings of its first row to its end."""
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
            if longest < self._longest * (1 - 1e-9):  # the simulation went where the model is stiffer
                self._lay_out(longest)
                result = self._run_freely(intervals)
        return self._collected(rows, result)

    def ahead(self, horizon: float, overlapping: int | None = None) -> Prediction:
        """Rows predicted from the readings `horizon` seconds before.

        Parameters
        ----------
        horizon : s.
        overlapping : largest number of windows that a row lies in; None: every row is predicted, within `MOST_STARTS`.
        """
        (result,) = self.each_ahead([horizon], overlapping)
        return result

    def each_ahead(self, horizons: Sequence[float], overlapping: int | None = None) -> list[Prediction]:
        """`ahead` for several horizons: every start is simulated once, to the longest horizon that its run contains."""
        stride = max(1, round(sum(len(run) for run in self.runs) / MOST_STARTS))
        for run in self.runs:  # the work of all windows decides on compiling before the observer runs
            self.simulator.kernel.expect(len(run) // stride * max(1, round(max(horizons) / run.sample_time)))
        chosen: list[list[tuple[int, Index]]] = [[] for _ in horizons]
        result: list[list[Array]] = [[np.empty((0, len(self.simulator.trace.model.outputs)))] for _ in horizons]
        for k, (run, states) in enumerate(zip(self.runs, self.observed(), strict=True)):
            steps = np.array([max(1, round(horizon / run.sample_time)) for horizon in horizons])
            complete = np.all(np.isfinite(run.measured[:, self._channels(self._read[k])]), axis=1)
            apart = stride if overlapping is None else max(stride, int(max(steps)) // overlapping)
            begin = np.flatnonzero(complete[: max(0, len(run) - int(min(steps)))])[::apart]
            if not len(begin):
                continue
            ends = begin[:, None] + steps
            led = self._led(self._plans[k], states[begin], begin, np.minimum(ends, len(run) - 1))
            for number, (end, inside) in enumerate(zip(ends.T, len(run) > ends.T, strict=True)):
                if np.any(inside):
                    chosen[number].append((k, end[inside]))
                    result[number].append(led[inside, number])
        return [self._collected(rows, np.vstack(item)) for rows, item in zip(chosen, result, strict=True)]

    def observed(self) -> list[Array]:
        """Per run, (n, nz) states from the observer: measured ones at their readings, the others from the model."""
        if self._observed is None:
            pairs = zip(self.runs, self._plans, strict=True)
            self._observed = [observed(self.simulator, run, plan, self.p) for run, plan in pairs]
        return self._observed

    def _lay_out(self, longest: float) -> None:
        """Schedules of all runs, with no segment longer than `longest`, s."""
        shifts = self.simulator.shifts(self.p)
        self._longest = longest
        self._plans = [schedule(self.simulator.trace, run, shifts, longest) for run in self.runs]

    def _run_freely(self, intervals: Sequence[Interval]) -> Array:
        """(rows, outputs) simulated readings of all intervals, concatenated."""
        lanes = lay(self._plans, intervals)
        z0 = np.vstack([self._start(i.run, np.array([i.start])) for i in intervals])
        with np.errstate(all="ignore"):
            nothing = np.zeros(lanes.segments.shape[1] + 1, dtype=bool)
            _, y = self.simulator.kernel.simulate(z0, lanes.segments, self.p, lanes.reads, nothing)
        return np.where(lanes.lane >= 0, _astray(y)[lanes.lane, lanes.rank, np.arange(y.shape[2])], np.nan)

    def _held(self, run: MotionRun) -> MotionRun:
        """A run whose states stay at their initial values: nothing more is known before it is simulated."""
        outputs = self.simulator.trace.model.outputs
        first = np.nan_to_num(run.measured[0])
        for name, value in self._given.items():
            if name in outputs:
                first[outputs.index(name)] = value
        return replace(run, measured=np.tile(first, (len(run), 1)))

    def _longest_along(self, rows: Sequence[tuple[int, Index]], simulated: Sequence[Array]) -> float:
        """The longest permitted segment, s, with simulated values in place of readings."""
        along = []
        for (k, item), y in zip(rows, simulated, strict=True):
            if not np.all(np.abs(y[-1]) < HUGE):
                return least_segment(self.runs[k].sample_time)
            measured = np.full(self.runs[k].measured.shape, np.nan)
            measured[item] = y
            along.append(replace(self.runs[k], measured=measured))
        return longest_segment(self.simulator.trace, along, self.p)

    def _led(self, plan: Schedule, z0: Array, begin: Index, ends: Index) -> Array:
        """Readings at rows `ends`, (n, m), simulated from states at rows `begin`, (n,): (n, m, outputs)."""
        first = plan.row_segment[begin]
        read = np.where(plan.read_segment[ends] >= first[:, None, None], plan.read_segment[ends], -1)
        # a latency of zero is read just after its row
        last = np.max(np.maximum(plan.row_segment[ends], np.max(read, axis=2)), axis=1)
        length = int(np.max(last - first)) + 1
        beyond = np.zeros((length, plan.segments.shape[1]))
        windows = sliding_window_view(np.concatenate((plan.segments, beyond)), length, axis=0).swapaxes(1, 2)
        spacing = np.diff(first)
        equally_spaced = (
            len(spacing) > 0 and spacing[0] > 0 and np.all(spacing == spacing[0])
        )  # then a view of the windows suffices
        segments = windows[first[0] : first[-1] + 1 : spacing[0]] if equally_spaced else windows[first]
        rank = np.where(read >= 0, read - first[:, None, None], 0)
        reads, nothing = np.zeros(length, dtype=bool), np.zeros(length + 1, dtype=bool)
        reads[np.unique(rank)] = True
        with np.errstate(all="ignore"):
            _, y = self.simulator.kernel.simulate(z0, segments, self.p, reads, nothing)
        among = np.cumsum(reads) - 1
        result = _astray(y)[np.arange(len(begin))[:, None, None], among[rank], np.arange(y.shape[2])]
        return np.where(read >= 0, result, np.nan)

    def _start(self, k: int, rows: Index) -> Array:
        run, given, counting = self.runs[k], tuple(self._given), self._counting(k)
        values = np.tile(list(self._given.values()), (len(rows), 1))
        readings = np.hstack([run.measured[rows][:, self._channels(counting)], values])
        return self.simulator.start_states(counting + given, readings, run.inputs[rows], self.p, given)

    def _counting(self, k: int) -> tuple[str, ...]:
        """Measured states of a run whose readings are used: those that are not given."""
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
    """Predictions with NaN replaced by infinity, for diverged simulations: NaN marks missing predictions only."""
    return np.where(np.isnan(y), np.inf, y)


@dataclass(frozen=True)
class _Alike:
    """Intervals with the same measured states."""

    names: tuple[str, ...]
    which: Index
    readings: Array
    inputs: Array


class IntervalStarts:
    """Initial states of intervals as functions of the parameters.

    Actuators have moved since the run began, and are simulated from there for every set of parameters if intervals
    start within runs. Unmeasured states and lags come from an observer, once: they remain as computed at the parameters
    of `carry`.

    Parameters
    ----------
    simulator : the model.
    runs : the recordings' runs.
    intervals : the intervals.
    """

    def __init__(self, simulator: Simulator, runs: Sequence[MotionRun], intervals: Sequence[Interval]) -> None:
        self._simulator, self._runs, self._intervals = simulator, runs, intervals
        model = simulator.trace.model
        self._model = model
        read = [run.states_read(model) for run in runs]
        owner, begin, _ = (np.array(item) for item in zip(*intervals, strict=True))
        is_read = [name in names for names in read for name in simulator.trace.names]
        self._read = np.array(is_read, dtype=bool).reshape(len(runs), -1)[owner]
        self._groups = []
        for names in dict.fromkeys(read):
            which = np.flatnonzero(np.array([states == names for states in read])[owner])
            channels = [model.outputs.index(name) for name in names]
            if len(which):
                starts = [(run, begin[which[owner[which] == j]]) for j, run in enumerate(runs)]
                readings = np.concatenate([run.measured[np.ix_(rows, channels)] for run, rows in starts if len(rows)])
                inputs = np.concatenate([run.inputs[rows] for run, rows in starts if len(rows)])
                self._groups.append(_Alike(names, which, readings.reshape(len(which), -1), inputs))
        self._touched = np.unique(np.concatenate([simulator.start_touched(group.names) for group in self._groups]))
        self._last: tuple[Array, Array, Array] | None = None
        self._carried: tuple[Mask, Array] | None = None
        self._actuated = False
        self._ran: tuple[Array, Sequence[Schedule], tuple[Array, Array]] | None = None

    def carry(self, p: Array, plans: Callable[[], Sequence[Schedule]]) -> None:
        """From now on, starts within a run continue actuators and unmeasured states from before.

        Parameters
        ----------
        p : (parameters,) of the observer.
        plans : returns each run's schedule at these parameters; called only if a state is unmeasured.
        """
        trace = self._simulator.trace
        self._actuated = self._simulator.actuators is not None
        actuators = slice(len(trace.names), len(trace.names) + len(self._model.actuators))
        unread = np.ones((len(self._intervals), trace.size), dtype=bool)
        unread[:, : len(trace.names)] = ~self._read
        unread[:, actuators] = False
        unread[[interval.start == 0 for interval in self._intervals]] = False
        if not np.any(unread):
            return
        along = [observed(self._simulator, run, plan, p) for run, plan in zip(self._runs, plans(), strict=True)]
        states = np.array([along[i.run][i.start] for i in self._intervals])
        self._carried = (unread & np.isfinite(states), states)

    @property
    def carries(self) -> bool:
        """Whether any initial state comes from an observer."""
        return self._carried is not None

    def __call__(self, p: Array, plans: Sequence[Schedule]) -> tuple[Array, Array]:
        """Initial states, (intervals, nz), and their derivative by the parameters, (intervals, nz, parameters).

        Parameters
        ----------
        p : (runs, parameters) of each run.
        plans : each run's schedule.
        """
        acting = p[:, self._touched]
        if self._last is None or not np.array_equal(self._last[0], acting):
            self._last = (acting.copy(), *self._from_readings(p))
        z, by_p = self._last[1].copy(), self._last[2]
        if self._actuated:
            place = slice(len(self._model.states), len(self._model.states) + len(self._model.actuators))
            by_p, acting = by_p.copy(), p[:, self._simulator.actuators_touched]
            if self._ran is None or self._ran[1] is not plans or not np.array_equal(self._ran[0], acting):
                self._ran = (acting, plans, self._run_through(p, plans))
            z[:, place], by_p[:, place] = self._ran[2]
        return z, by_p

    def forget(self) -> None:
        """Release the cached simulation of the actuators."""
        self._ran = None

    def of_many(self, p: Array) -> Array:
        """Initial states for many sets of parameters at once, (sets, intervals, nz), without derivatives.

        Parameters
        ----------
        p : (sets, runs, parameters). Requires `plain_starts`: with actuators that move before an interval starts, the
            initial states depend on the segments, which differ from set to set.
        """
        if len(p) > 1 and np.all(p[1:, :, self._touched] == p[:1, :, self._touched]):
            return np.repeat(self.of_many(p[:1]), len(p), axis=0)
        of_intervals = p[:, [interval.run for interval in self._intervals]]
        sets = len(of_intervals)
        z = np.empty((sets, len(self._intervals), self._simulator.trace.size))
        for group in self._groups:
            readings, inputs = (np.tile(table, (sets, 1)) for table in (group.readings, group.inputs))
            result = self._simulator.start_states(
                group.names, readings, inputs, of_intervals[:, group.which].reshape(len(readings), -1)
            )
            z[:, group.which] = result.reshape(sets, len(group.which), -1)
        if self._carried is not None:
            where, states = self._carried
            z[:, where] = states[where]
        return z

    @property
    def plain_starts(self) -> bool:
        """Whether initial states depend on parameters and readings alone."""
        return not self._actuated

    def _from_readings(self, p: Array) -> tuple[Array, Array]:
        of_intervals = p[[interval.run for interval in self._intervals]]
        size = self._simulator.trace.size
        z, by_p = np.empty((len(of_intervals), size)), np.empty((len(of_intervals), size, of_intervals.shape[1]))
        for group in self._groups:
            result = self._simulator.start(group.names, group.readings, group.inputs, of_intervals[group.which])
            z[group.which], by_p[group.which] = result
        if self._carried is not None:
            where, states = self._carried
            z[where], by_p[where] = states[where], 0.0
        return z, by_p

    def _run_through(self, p: Array, plans: Sequence[Schedule]) -> tuple[Array, Array]:
        """States of the actuators at the starts and their derivatives, simulated from the beginning of every run."""
        model = self._model
        assert self._simulator.actuators is not None
        whole = lay(plans, [Interval(k, 0, len(run)) for k, run in enumerate(self._runs)])
        commands = [model.inputs.index(actuator.signal) for actuator in model.actuators]
        first = np.array([run.inputs[0, commands] for run in self._runs])
        runs = [i.run for i in self._intervals]
        segments = np.array([plans[i.run].row_segment[i.start] for i in self._intervals])
        reads = np.zeros(whole.segments.shape[1], dtype=bool)
        reads[segments] = True
        acting = self._simulator.actuators_touched
        _, _, states, by = self._simulator.actuators.linearise(first, whole.segments, p, reads, acting)
        at: Index = (np.cumsum(reads) - 1)[segments]
        by_p = np.zeros((len(runs), first.shape[1], model.size))
        by_p[:, :, acting] = by[runs, at][:, :, first.shape[1] :]
        return states[runs, at], by_p
