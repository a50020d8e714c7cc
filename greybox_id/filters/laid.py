"""A recording laid out for a filter: its runs cut into segments, and what was read at their starts."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass

import numpy as np

from ..engine.motion.runs import Index, MotionRun, motion_runs
from ..engine.motion.schedule import longest_segment, schedule
from ..parameter import Array
from ..recording import Recording
from .state_space import StateSpace


@dataclass(frozen=True)
class LaidRun:
    """One unbroken run (S segments, m outputs, n rows).

    Attributes
    ----------
    run : as the model sees it.
    segments : (S, numbers) of each segment.
    readings : (S, m) at the segments' starts; NaN where nothing was read.
    row_segment : (n,) segment that starts at a row.
    """

    run: MotionRun
    segments: Array
    readings: Array
    row_segment: Index

    def first(self, seconds: float) -> LaidRun:
        """Its beginning."""
        rows = max(2, int(np.searchsorted(self.run.time, self.run.time[0] + seconds)))
        if rows >= len(self.row_segment):
            return self
        stop = int(self.row_segment[rows])
        return LaidRun(self.run, self.segments[:stop], self.readings[:stop], self.row_segment[:rows])


def laid(space: StateSpace, recording: Recording, p: Array, read: Collection[str]) -> list[LaidRun]:
    """The runs of a recording.

    Parameters
    ----------
    p : (parameters,) of the model, for its delays and for how stiff it is.
    read : outputs that are read; others are left unread although they were recorded.

    Raises
    ------
    BadInput : an input is missing, or no run is long enough.
    """
    trace, model = space.trace, space.model
    runs = motion_runs(model, recording)
    shifts = np.asarray(trace.timing(p).full()).ravel() if trace.shift_count else np.empty(0)
    longest = longest_segment(trace, runs, p)
    unread = [k for k, name in enumerate(model.outputs) if name not in read]
    found = []
    for run in runs:
        plan = schedule(trace, run, shifts, longest)
        y = np.full((len(plan.segments), len(model.outputs)), np.nan)
        for k in range(len(model.outputs)):
            if k not in unread:
                taken = plan.read_segment[:, k] >= 0
                y[plan.read_segment[taken, k], k] = run.measured[taken, k]
        y[~np.isfinite(y)] = np.nan
        found.append(LaidRun(run, np.ascontiguousarray(plan.segments), y, plan.row_segment))
    return found
