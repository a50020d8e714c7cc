"""One filter over the runs of a recording: initial states, filtering, and smoothing backwards.

Recordings are prepared first: glitches of their inputs bridged, their runs cut into segments with readings.

A filter trusts its inputs. A glitch of one sample in the steering angle would act as a kick of the vehicle, and
smoothing the input would hide it and delay everything else: glitches are found by comparison with their neighbours,
reported, and bridged. Glitches in readings need no treatment; the filter compares each reading with its prediction.
"""

from __future__ import annotations

import os
from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np

from ..base.shorthands import Array, Index
from ..datasets.checks.values import outlying
from ..datasets.recording import Recording
from ..engine.compiler import CannotCompile, warn_slow
from ..engine.motion.schedule import MotionRun, longest_segment, motion_runs, schedule
from .kernel import CompiledFilter, History, Kept, Kind, SigmaPoints
from .plain import PlainFilter
from .state_space import StateSpace

PART = 50_000
"""Segments per part of a filter's history: eight minutes at 100 Hz."""


@dataclass(frozen=True)
class LaidRun:
    """One unbroken run (S segments, m outputs, n rows).

    Attributes
    ----------
    run : the run, as the model gets it.
    segments : (S, numbers) of each segment.
    readings : (S, m) at the segments' starts; NaN where missing.
    row_segment : (n,) segment that starts at a row.
    read_segment : (n, m) segment at whose start a row's reading was taken; -1 for none.
    """

    run: MotionRun
    segments: Array
    readings: Array
    row_segment: Index
    read_segment: Index

    def filtered_alone(self) -> LaidRun:
        """The run without data that a filter no longer needs: inputs after the start, and readings by row."""
        run = replace(self.run, inputs=self.run.inputs[:1].copy(), measured=self.run.measured[:0].copy())
        return replace(self, run=run)

    def first(self, seconds: float) -> LaidRun:
        """The first seconds of the run."""
        rows = max(2, int(np.searchsorted(self.run.time, self.run.time[0] + seconds)))
        if rows >= len(self.row_segment):
            return self
        stop = int(self.row_segment[rows])
        read_segment = np.where(self.read_segment[:rows] < stop, self.read_segment[:rows], -1)
        return LaidRun(self.run, self.segments[:stop], self.readings[:stop], self.row_segment[:rows], read_segment)


def laid(space: StateSpace, recording: Recording, p: Array, read: Collection[str]) -> list[LaidRun]:
    """The runs of a recording.

    Parameters
    ----------
    space : the model.
    recording : the recording.
    p : (parameters,) of the model, for its delays and its stiffness.
    read : outputs whose readings are used; others are ignored even if recorded.

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
        any_reading = np.any(np.isfinite(run.measured), axis=1)
        plan = schedule(trace, run, shifts, longest, read=any_reading)
        y = np.full((len(plan.segments), len(model.outputs)), np.nan)
        for k in range(len(model.outputs)):
            if k not in unread:
                has_segment = plan.read_segment[:, k] >= 0
                y[plan.read_segment[has_segment, k], k] = run.measured[has_segment, k]
                before = np.flatnonzero(np.isfinite(run.measured[: np.argmax(has_segment), k]))
                if len(before):  # readings from before the run's first segment belong to that segment
                    y[plan.row_segment[0], k] = run.measured[before[-1], k]
        y[~np.isfinite(y)] = np.nan
        result.append(LaidRun(run, np.ascontiguousarray(plan.segments), y, plan.row_segment, plan.read_segment))
    return result


LONGEST_GAP = 0.5
"""Longest gap of an input that is bridged, s; after longer ones the filter starts again."""


def guarded(recording: Recording, inputs: Sequence[str]) -> tuple[Recording, list[str]]:
    """The recording with glitches and short gaps of its inputs interpolated linearly, and sentences on them."""
    signals, sentences = {}, []
    for name in inputs:
        if name not in recording:
            continue
        bridged, missing = _bridged(recording, recording[name])
        gaps = int(np.count_nonzero(~np.isfinite(recording[name]))) - missing
        finite, rows = np.isfinite(bridged), np.arange(len(bridged))
        interpolated = np.interp(rows, rows[finite], bridged[finite]) if np.any(finite) else np.zeros(len(bridged))
        finding = outlying(recording.with_signals(**{name: interpolated}), name)
        if finding is not None:
            without = bridged.copy()
            without[list(finding.where.rows)] = np.nan
            bridged, _ = _bridged(recording, without)
            sentences.append(
                f"{finding.sentence.removesuffix(' Leave such rows out.')} "
                "These values are treated as missing and are bridged."
            )
        if gaps > 0:
            sentences.append(f"{name}: {gaps} missing values in gaps of up to {LONGEST_GAP:g} s were bridged.")
        if missing:
            sentences.append(
                f"{name}: {missing} values are missing in longer gaps, after which the filter starts anew."
            )
        signals[name] = bridged
    return recording.with_signals(**signals), sentences


def _bridged(recording: Recording, values: Array) -> tuple[Array, int]:
    """Values with short gaps inside runs interpolated, and the number still missing."""
    result = values.copy()
    for start, stop in recording.runs:
        signal, time = values[start:stop], recording.time[start:stop]
        finite = np.flatnonzero(np.isfinite(signal))
        if len(finite) == 0:
            continue
        after = np.searchsorted(finite, np.arange(len(signal)))
        inside = (after > 0) & (after < len(finite))
        width = np.full(len(signal), np.inf)
        width[inside] = time[finite[after[inside]]] - time[finite[after[inside] - 1]]
        fill = np.isnan(signal) & (width <= LONGEST_GAP + recording.sample_time)
        result[start:stop][fill] = np.interp(time[fill], time[finite], signal[finite])
    return result, int(np.count_nonzero(np.isnan(result)))


GATE = 5.0
"""Innovation, in standard deviations, beyond which a reading's noise is raised."""
START = 3.0
"""Initial standard deviation of a state, relative to its reading's noise, or to its scale without a reading."""


class Filter(Protocol):
    """A Kalman filter: compiled, or in plain Python."""

    def run(
        self, x: Array, P: Array, s: Array, y: Array, p: Array, gate: float, kept: Kept
    ) -> tuple[Array, History | None]:
        """As `CompiledFilter.run`."""


@dataclass(frozen=True)
class Filtering:
    """A state space with its filter.

    Attributes
    ----------
    space : the model.
    filter : EKF or UKF.
    gate : in standard deviations.
    """

    space: StateSpace
    filter: Filter
    gate: float = GATE

    def _begun(self, runs: Sequence[LaidRun], p: Array) -> Iterator[tuple[LaidRun, Array, Array]]:
        """Each run with states and covariances at its start, which the caller moves to its end, in place."""
        before = None
        for run in runs:
            before = self.begin(run, p, before)
            yield run, *before

    def _through(self, runs: Sequence[LaidRun], p: Array, kept: Kept) -> Iterator[tuple[Array, History | None]]:
        """Cost and history of each run."""
        for run, x, P in self._begun(runs, p):
            yield self.filter.run(x, P, run.segments, run.readings, p, self.gate, kept)

    def costs(self, runs: Sequence[LaidRun], p: Array) -> Array:
        """(L,) negative log-likelihood for parameters (L, parameters), up to a constant."""
        return np.asarray(sum(cost for cost, _ in self._through(runs, p, "nothing")))

    def histories(self, runs: Sequence[LaidRun], p: Array, kept: Kept = "filtered") -> list[History]:
        """Histories of the filter for parameters (parameters,), run by run."""
        return [history for _, history in self._through(runs, p[None], kept) if history is not None]

    def in_parts(self, runs: Sequence[LaidRun], p: Array) -> Iterator[tuple[LaidRun, int, LaidRun, History]]:
        """As `histories`, in parts: the run, first segment of the part in it, the part as a run, and its history.

        The history of hours is large; the next part needs only the end of the last one, as predicted for the next
        part's first segment.
        """
        for run, x, P in self._begun(runs, p[None]):
            for first in range(0, len(run.segments), PART):
                stop = min(first + PART, len(run.segments))
                with_next = slice(first, stop + (stop < len(run.segments)))
                kept: Kept = "filtered" if with_next.stop == stop else "both ways"
                s, y = run.segments[with_next], run.readings[with_next]
                _, history = self.filter.run(x, P, s, y, p[None], self.gate, kept)
                assert history is not None
                if with_next.stop > stop:
                    x[:], P[:] = history.predicted[-1:], history.predicted_P[-1:]
                low, high = np.searchsorted(run.row_segment, (first, stop))
                rows = slice(int(low), int(high))
                part = LaidRun(run.run, s[: stop - first], y[: stop - first], run.row_segment[rows] - first,
                               run.read_segment[rows])  # fmt: skip
                names = ("filtered", "filtered_P", "off", "spread")
                yield run, first, part, replace(history, **{n: getattr(history, n)[: stop - first] for n in names})

    def innovations(self, runs: Sequence[LaidRun], p: Array) -> list[tuple[Array, Array]]:
        """Innovations of filters with parameters (L, parameters), run by run: (L, S, m), and their variance."""
        return [(one.off, one.spread) for _, one in self._through(runs, p, "innovations") if one is not None]

    def begin(self, laid_run: LaidRun, p: Array, before: tuple[Array, Array] | None = None) -> tuple[Array, Array]:
        """States and covariances at a run's start, (L, n) and (L, n, n).

        Parameters
        ----------
        laid_run : the run.
        p : (L, parameters) model and noise.
        before : those at the end of the previous run, from which tracked parameters are carried over.
        """
        space, model = self.space, self.space.model
        noise = dict(zip(space.noises, p.T[model.size :], strict=True))
        first = {name: laid_run.readings[0, k] for k, name in enumerate(model.outputs)}
        read = tuple(name for name in space.trace.names if np.isfinite(first.get(name, np.nan)))
        readings = np.array([first[name] for name in read])
        x, sd = np.zeros((len(p), space.size)), np.zeros((len(p), space.size))
        end_of_tracked = space.trace.size + len(space.tracked)
        parameters = np.ascontiguousarray(p[:, : model.size])
        x[:, : space.trace.size] = space.start(read)(readings, laid_run.run.inputs[0], parameters)
        for k, state in enumerate(model.states):
            sd[:, k] = START * noise[f"noise_{state.name}"] if state.name in read else START * state.scale
        beyond_states = slice(len(space.trace.names), space.trace.size)
        sd[:, beyond_states] = 0.1 * np.abs(x[:, beyond_states]) + 1e-3
        x[:, space.trace.size : end_of_tracked] = [one.start for one in space.tracked]
        sd[:, space.trace.size : end_of_tracked] = [one.start_sd for one in space.tracked]
        for k, name in enumerate(space.coloured):
            sd[:, end_of_tracked + k] = noise[f"colour_{name}"]
        P = sd[:, :, None] ** 2 * np.eye(space.size)
        if before is not None:
            of_tracked = slice(space.trace.size, end_of_tracked)
            x[:, of_tracked], P[:, of_tracked, of_tracked] = (
                before[0][:, of_tracked],
                before[1][:, of_tracked, of_tracked],
            )
        return x, P


def filtering(
    space: StateSpace, kind: Kind, points: SigmaPoints, gate: float = GATE, *, many: bool = False
) -> Filtering:
    """A compiled filter if there is a compiler, else one in plain Python, which is a thousand times slower.

    The compiled code for `many` EKFs side by side differs from that for one. The environment variable GREYBOX_COMPILE=1
    makes a missing compiler an error, 0 requests plain Python.
    """
    stated = os.environ.get("GREYBOX_COMPILE")
    if stated != "0":
        try:
            return Filtering(space, CompiledFilter(space, kind, points, many=many), gate)
        except CannotCompile as error:
            if stated:
                raise
            warn_slow("The filter", "a thousand", error)
    return Filtering(space, PlainFilter(space, kind, points), gate)


LEAST_VARIANCE = 1e-12
"""Ridge of a predicted covariance, relative to its diagonal, so that it can be inverted."""


def smoothed(history: History) -> tuple[Array, Array]:
    """States (S, n) and their covariance (S, n, n), given all readings of the run.

    The Rauch-Tung-Striebel smoother goes backwards through a filter's history,

        G = forward predicted_P^-1,   x_s = x + G (x_s' - x'),   P_s = P + G (P_s' - P') G^T

    with ' for the next segment, x' and P' predicted for it and `forward` the covariance of x with x'. It serves EKF
    and UKF alike. Source: Sarkka, Bayesian Filtering and Smoothing, 2013, Sec. 9.1 and 9.3.
    """
    x, P = history.filtered.copy(), history.filtered_P.copy()
    ahead = history.predicted_P[1:]
    scale = np.sqrt(np.maximum(np.einsum("kii->ki", ahead), 1e-300))
    scaled = ahead / (scale[:, :, None] * scale[:, None, :]) + LEAST_VARIANCE * np.eye(x.shape[1])
    back = np.linalg.solve(scaled, history.forward[:-1].swapaxes(1, 2) / scale[:, :, None]) / scale[:, :, None]
    for k in range(len(x) - 2, -1, -1):
        G = back[k].T
        x[k] += G @ (x[k + 1] - history.predicted[k + 1])
        P[k] += G @ (P[k + 1] - history.predicted_P[k + 1]) @ G.T
    return x, P
