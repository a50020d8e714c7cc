"""Where intervals start: states from readings, actuators from the commands before, and deviations that are estimated."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ...parameter import Array
from .lanes import Interval, lay
from .runs import Index, MotionRun
from .schedule import Schedule
from .simulator import Simulator


class IntervalStarts:
    """States at the starts of intervals, as functions of the parameters.

    Parameters
    ----------
    simulator : the model.
    runs : the recordings' runs.
    intervals : what starts.
    measured : states that have readings.
    carried : actuators have moved since the run began; else they rest at their command.
    """

    def __init__(
        self,
        simulator: Simulator,
        runs: Sequence[MotionRun],
        intervals: Sequence[Interval],
        measured: tuple[str, ...],
        carried: bool,
    ) -> None:
        self._simulator, self._runs, self._intervals, self._measured = simulator, runs, intervals, measured
        at = {name: k for k, name in enumerate(simulator.trace.model.outputs)}
        channels = np.array([at[name] for name in measured], dtype=np.intp)
        self._readings = np.array([runs[i.run].measured[i.start, channels] for i in intervals])
        self._inputs = np.array([runs[i.run].inputs[i.start] for i in intervals])
        self._carried = carried and simulator.actuators is not None
        self._touched = simulator.start_touched(measured)
        self._last: tuple[Array, Array, Array] | None = None

    def __call__(self, p: Array, plans: Sequence[Schedule]) -> tuple[Array, Array]:
        """States at the starts, (intervals, nz), and their derivative by the parameters, (intervals, nz, parameters).

        Parameters
        ----------
        p : (runs, parameters) of each run.
        plans : each run's segments.
        """
        acting = p[:, self._touched]
        if self._last is None or not np.array_equal(self._last[0], acting):
            own = p[[interval.run for interval in self._intervals]]
            z, by_p = self._simulator.start(self._measured, self._readings, self._inputs, own)
            self._last = (acting.copy(), z, by_p)
        z, by_p = self._last[1].copy(), self._last[2]
        if self._carried:
            model = self._simulator.trace.model
            place = slice(len(model.states), len(model.states) + len(model.actuators))
            by_p = by_p.copy()
            z[:, place], by_p[:, place] = self._actuated(p, plans)
        return z, by_p

    def _actuated(self, p: Array, plans: Sequence[Schedule]) -> tuple[Array, Array]:
        """Actuators run through from the beginning of every run."""
        model = self._simulator.trace.model
        assert self._simulator.actuators is not None
        whole = lay(plans, [Interval(k, 0, len(run)) for k, run in enumerate(self._runs)])
        commands = [model.inputs.index(actuator.signal) for actuator in model.actuators]
        first = np.array([run.inputs[0, commands] for run in self._runs])
        every = np.arange(model.size)
        _, _, states, by = self._simulator.actuators.linearise(first, whole.segments, p, whole.reads, every)
        rank = np.cumsum(whole.reads) - 1
        runs = [i.run for i in self._intervals]
        at: Index = np.array([rank[plans[i.run].row_segment[i.start]] for i in self._intervals])
        return states[runs, at], by[runs, at][:, :, first.shape[1] :]
