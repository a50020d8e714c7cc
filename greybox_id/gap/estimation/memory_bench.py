"""The test bench of a diagnosis for maps with memory: whole runs, predicted from their first windows on.

Such a map is driven by measured signals, speed among them, so that a whole run does not drift away from what the
vehicle drove: no observer is needed, and windows are filled with readings only once, at the start of each run. A sample
is a row, and effects, late readings too, change predictions continuously: no row is cut into segments.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ...base.shorthands import Array
from ...datasets.recording import Recording
from ...engine.elements import Sensing
from ...engine.series import Run, runs
from ...engine.trace import Trace
from ...models.memory_model import MemoryModel
from .calibration import CAL


@dataclass(frozen=True)
class PredictedRun:
    """The rows of an unbroken run that have a prediction; no input is held: a map knows nothing between its samples."""

    time: Array
    held: NDArray[np.bool_]


class MemoryBench:
    """Simulates whole runs freely, without the rows that only fill windows.

    Parameters
    ----------
    model : with all candidates; its weights are never differentiated by.
    recordings : what to simulate; N rows with a prediction in all.

    Attributes
    ----------
    runs : the recordings' unbroken runs.
    measured : (N, outputs) readings.
    rows : slices of the N rows, per run.
    counted : (N, outputs) readings that count: not those in a run's first moments, before which a late sensor is taken
        to have read its first value.
    time : (N,) s.
    inputs : (N, inputs) commands as the equations receive them; fed-back ones as the model predicts them.
    loose : none: windows start as they were read.
    """

    learnt = True
    loose: tuple[int, ...] = ()

    def __init__(self, model: MemoryModel, recordings: Sequence[Recording]) -> None:
        self.model = model
        trace = Trace(model)
        self._sensing = Sensing(trace.model)
        pairs = [(recording, run) for recording in recordings for run in runs(trace, recording)]
        self._laid: list[Run] = [run for _, run in pairs]
        still = np.zeros(len(model.inputs), dtype=bool)
        self.runs = [PredictedRun(recording.time[run.rows][run.predicted], still) for recording, run in pairs]
        edges = np.concatenate(([0], np.cumsum([len(run.time) for run in self.runs])))
        self.rows = [slice(int(a), int(b)) for a, b in zip(edges[:-1], edges[1:], strict=True)]
        self.measured = np.vstack([run.measured[run.predicted] for run in self._laid])
        self.time = np.concatenate([run.time for run in self.runs])
        self.counted = np.isfinite(self.measured)
        for run, rows in zip(self.runs, self.rows, strict=True):
            self.counted[rows] &= (run.time - run.time[0] >= CAL.settling)[:, None]
        p = model.values
        self.inputs = np.vstack([run.inputs(p, run.simulate(p))[0][run.predicted] for run in self._laid])

    @property
    def channels(self) -> tuple[str, ...]:
        """Outputs, in order."""
        return self.model.outputs

    @property
    def sample_time(self) -> float:
        """Step, s."""
        return self.model.sample_time

    def simulate(self, P: Array) -> Array:
        """(K, N, outputs) readings predicted with each of (K, parameters) vectors."""
        result = np.empty((len(P), *self.measured.shape))
        with np.errstate(all="ignore"):
            for item, p in zip(result, P, strict=True):
                for run, rows in zip(self._laid, self.rows, strict=True):
                    item[rows] = self._read(run, p)
        return result

    def linearise(self, p: Array, columns: Sequence[int]) -> tuple[Array, Array, Array]:
        """A simulation and its derivatives, by central differences; at a bound, by one towards the inside.

        Parameters
        ----------
        columns : parameters to differentiate by; by one that is infinite, the derivative is zero.

        Returns
        -------
        y, J, S : as of `Bench`; S is (N, outputs, 0), for no start is a nuisance.
        """
        sides, spans = [p], []
        for column in columns:
            below, above = self._beside(column, float(p[column]))
            spans.append(above - below)
            for value in (below, above):
                sides.append(p.copy())
                sides[-1][column] = value
        y, *beside = self.simulate(np.array(sides))
        slopes = [
            (above - below) / span if span > 0 else np.zeros_like(y)
            for below, above, span in zip(beside[::2], beside[1::2], spans, strict=True)
        ]
        nothing = np.zeros((*self.measured.shape, 0))
        return y, np.stack(slopes, axis=2) if slopes else nothing, nothing

    def _read(self, run: Run, p: Array) -> Array:
        """(n, outputs) what the sensors would have recorded in one run."""
        return self._sensing(run.simulate(p)[run.predicted], None, p)[0]

    def _beside(self, column: int, value: float) -> tuple[float, float]:
        """Values below and above a parameter's, within its bounds."""
        if not np.isfinite(value):
            return value, value
        low, high = self._bounds(column)
        step = CAL.memory_step * max(abs(value), high - low if np.isfinite(high - low) else 1.0)
        return max(value - step, low), min(value + step, high)

    def _bounds(self, column: int) -> tuple[float, float]:
        ends = np.cumsum([parameter.size for parameter in self.model.parameters])
        return self.model.parameters[int(np.searchsorted(ends, column, side="right"))].bounds


def must_suit(model: MemoryModel, recordings: Sequence[Recording]) -> None:
    """Raise `BadInput` where a recording lacks what a map needs: a signal, its sample time, a run long enough."""
    trace = Trace(model)
    for recording in recordings:
        runs(trace, recording)
