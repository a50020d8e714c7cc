"""A recording made ready for a filter: glitches of its inputs bridged, its runs cut into segments with what was read.

A filter believes its inputs. A glitch of one sample in the steering angle would pass for a kick of the vehicle, and
smoothing the input would hide it and delay everything else: glitches are found against their neighbours, said, and
bridged. Glitches in readings are no matter here; the filter weighs each against what it expects.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass

import numpy as np

from ..base.shorthands import Array, Index
from ..datasets.checks.values import outlying
from ..datasets.recording import Recording
from ..engine.motion.runs import MotionRun, motion_runs
from ..engine.motion.schedule import longest_segment, schedule
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
    read_segment : (n, m) segment at whose start a row's reading was taken; -1 for none.
    """

    run: MotionRun
    segments: Array
    readings: Array
    row_segment: Index
    read_segment: Index

    def first(self, seconds: float) -> LaidRun:
        """Its beginning."""
        rows = max(2, int(np.searchsorted(self.run.time, self.run.time[0] + seconds)))
        if rows >= len(self.row_segment):
            return self
        stop = int(self.row_segment[rows])
        taken = np.where(self.read_segment[:rows] < stop, self.read_segment[:rows], -1)
        return LaidRun(self.run, self.segments[:stop], self.readings[:stop], self.row_segment[:rows], taken)


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
    result = []
    for run in runs:
        late = np.any(np.isfinite(run.measured), axis=1)
        plan = schedule(trace, run, shifts, longest, read=late)
        y = np.full((len(plan.segments), len(model.outputs)), np.nan)
        for k in range(len(model.outputs)):
            if k not in unread:
                taken = plan.read_segment[:, k] >= 0
                y[plan.read_segment[taken, k], k] = run.measured[taken, k]
                before = np.flatnonzero(np.isfinite(run.measured[: np.argmax(taken), k]))
                if len(before):  # what was read before the run begins is what it begins with
                    y[plan.row_segment[0], k] = run.measured[before[-1], k]
        y[~np.isfinite(y)] = np.nan
        result.append(LaidRun(run, np.ascontiguousarray(plan.segments), y, plan.row_segment, plan.read_segment))
    return result


LONGEST_GAP = 0.5
"""Gaps in an input up to this long are bridged, s; the filter starts anew behind longer ones."""


def guarded(recording: Recording, inputs: Sequence[str]) -> tuple[Recording, list[str]]:
    """The recording with glitches and short gaps of its inputs bridged by straight lines, and sentences on them."""
    signals, known = {}, []
    for name in inputs:
        if name not in recording:
            continue
        bridged, lost = _bridged(recording, recording[name])
        gaps = int(np.count_nonzero(~np.isfinite(recording[name]))) - lost
        there, rows = np.isfinite(bridged), np.arange(len(bridged))
        whole = np.interp(rows, rows[there], bridged[there]) if np.any(there) else np.zeros(len(bridged))
        finding = outlying(recording.with_signals(**{name: whole}), name)
        if finding is not None:
            without = bridged.copy()
            without[list(finding.where.rows)] = np.nan
            bridged, _ = _bridged(recording, without)
            known.append(f"{finding.sentence.removesuffix(' Leave such rows out.')} Taken as missing and bridged.")
        if gaps > 0:
            known.append(f"{name}: {gaps} missing values in gaps of up to {LONGEST_GAP:g} s were bridged.")
        if lost:
            known.append(f"{name}: {lost} values are missing in longer gaps, behind which the filter starts anew.")
        signals[name] = bridged
    return recording.with_signals(**signals), known


def _bridged(recording: Recording, values: Array) -> tuple[Array, int]:
    """Values with short gaps inside runs filled, and how many stay missing."""
    result = values.copy()
    for start, stop in recording.runs:
        value, time = values[start:stop], recording.time[start:stop]
        there = np.flatnonzero(np.isfinite(value))
        if len(there) == 0:
            continue
        after = np.searchsorted(there, np.arange(len(value)))
        inside = (after > 0) & (after < len(there))
        width = np.full(len(value), np.inf)
        width[inside] = time[there[after[inside]]] - time[there[after[inside] - 1]]
        fill = np.isnan(value) & (width <= LONGEST_GAP + recording.sample_time)
        result[start:stop][fill] = np.interp(time[fill], time[there], value[there])
    return result, int(np.count_nonzero(np.isnan(result)))
