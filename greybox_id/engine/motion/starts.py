"""Where intervals start: from readings, from the commands before, and what nothing reads from an observer."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ...base.shorthands import Array, Index, Mask
from .lanes import Interval, lay
from .runs import MotionRun
from .schedule import Schedule
from .simulator import Simulator, observed


@dataclass(frozen=True)
class _Alike:
    """Intervals of whose states the same ones are read."""

    names: tuple[str, ...]
    which: Index
    readings: Array
    inputs: Array


class IntervalStarts:
    """States at the starts of intervals, as functions of the parameters.

    Where intervals start again and again, actuators have moved since the run began, and are run through anew for
    every set of parameters. States and lags that nothing reads come from an observer, once: they stay what they were at
    the parameters given.

    Parameters
    ----------
    simulator : the model.
    runs : the recordings' runs.
    intervals : what starts.
    """

    def __init__(self, simulator: Simulator, runs: Sequence[MotionRun], intervals: Sequence[Interval]) -> None:
        self._simulator, self._runs, self._intervals = simulator, runs, intervals
        model = simulator.trace.model
        self._model = model
        read = [run.states_read(model) for run in runs]
        self._read = np.array([[name in read[i.run] for name in simulator.trace.names] for i in intervals])
        self._groups = []
        for names in dict.fromkeys(read):
            which = np.array([k for k, i in enumerate(intervals) if read[i.run] == names], dtype=np.intp)
            channels = [model.outputs.index(name) for name in names]
            if len(which):
                starts = [
                    (run, [intervals[k].start for k in which if intervals[k].run == j]) for j, run in enumerate(runs)
                ]
                readings = np.concatenate([run.measured[np.ix_(rows, channels)] for run, rows in starts if rows])
                inputs = np.concatenate([run.inputs[rows] for run, rows in starts if rows])
                self._groups.append(_Alike(names, which, readings.reshape(len(which), -1), inputs))
        self._touched = np.unique(np.concatenate([simulator.start_touched(group.names) for group in self._groups]))
        self._last: tuple[Array, Array, Array] | None = None
        self._carried: tuple[Mask, Array] | None = None
        self._actuated = False

    def carry(self, p: Array, plans: Sequence[Schedule]) -> None:
        """From here on, starts within a run go on from what was before.

        Parameters
        ----------
        p : (parameters,) of the observer.
        plans : each run's segments at these parameters.
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
        along = [observed(self._simulator, run, plan, p) for run, plan in zip(self._runs, plans, strict=True)]
        states = np.array([along[i.run][i.start] for i in self._intervals])
        self._carried = (unread & np.isfinite(states), states)

    @property
    def carries(self) -> bool:
        """Whether anything comes from an observer."""
        return self._carried is not None

    def __call__(self, p: Array, plans: Sequence[Schedule]) -> tuple[Array, Array]:
        """States at the starts, (intervals, nz), and their derivative by the parameters, (intervals, nz, parameters).

        Parameters
        ----------
        p : (runs, parameters) of each run.
        plans : each run's segments.
        """
        acting = p[:, self._touched]
        if self._last is None or not np.array_equal(self._last[0], acting):
            self._last = (acting.copy(), *self._from_readings(p))
        z, by_p = self._last[1].copy(), self._last[2]
        if self._actuated:
            place = slice(len(self._model.states), len(self._model.states) + len(self._model.actuators))
            by_p = by_p.copy()
            z[:, place], by_p[:, place] = self._run_through(p, plans)
        return z, by_p

    def of_many(self, p: Array) -> Array:
        """States at the starts for many sets of parameters at once, (sets, intervals, nz), without derivatives.

        Parameters
        ----------
        p : (sets, runs, parameters). Models with actuators that move before an interval starts are not for this: their
            starts depend on the segments, which differ from set to set (`plain_starts`).
        """
        if len(p) > 1 and np.all(p[1:, :, self._touched] == p[:1, :, self._touched]):
            return np.repeat(self.of_many(p[:1]), len(p), axis=0)
        value = p[:, [interval.run for interval in self._intervals]]
        sets = len(value)
        z = np.empty((sets, len(self._intervals), self._simulator.trace.size))
        for group in self._groups:
            readings, inputs = (np.tile(table, (sets, 1)) for table in (group.readings, group.inputs))
            result = self._simulator.start(
                group.names, readings, inputs, value[:, group.which].reshape(len(readings), -1)
            )
            z[:, group.which] = result[0].reshape(sets, len(group.which), -1)
        if self._carried is not None:
            where, states = self._carried
            z[:, where] = states[where]
        return z

    @property
    def plain_starts(self) -> bool:
        """Whether starts depend on parameters and readings alone."""
        return not self._actuated

    def _from_readings(self, p: Array) -> tuple[Array, Array]:
        value = p[[interval.run for interval in self._intervals]]
        size = self._simulator.trace.size
        z, by_p = np.empty((len(value), size)), np.empty((len(value), size, value.shape[1]))
        for group in self._groups:
            result = self._simulator.start(group.names, group.readings, group.inputs, value[group.which])
            z[group.which], by_p[group.which] = result
        if self._carried is not None:
            where, states = self._carried
            z[where], by_p[where] = states[where], 0.0
        return z, by_p

    def _run_through(self, p: Array, plans: Sequence[Schedule]) -> tuple[Array, Array]:
        """Actuators run through from the beginning of every run."""
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
