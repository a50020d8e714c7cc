"""Signals recorded on different clocks, resampled to one clock.

That is the clock of the column which the map names as time, else the most regular of the fast ones. If its steps are
regular, its time stamps are kept; otherwise an even grid of its usual step replaces them. Measurements are interpolated
linearly, commands are held, neither across a gap. The resampling error is estimated from the readings.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from ..base.errors import BadInput
from ..base.numbers import quoted
from ..base.shorthands import Array
from ..base.signals import ANGLES_AROUND, COMMANDS
from ..base.statistics import moving_mean
from .recording import Recording, Resampled

REGULAR = 0.05
"""Largest scatter of steps, as a share of the usual step, at which time stamps are kept."""
LINEAR_GAP = 3.0
"""Usual steps without a reading beyond which values are not interpolated."""
HELD_GAP = 5.0
"""Usual steps without a command beyond which the last one is no longer held ..."""
HELD_SECONDS = 0.5
"""... but at least this many seconds: commands are often sent only when they change."""
MOST_ROWS = 50_000_000
"""Largest number of resampled rows; more indicate a faulty clock."""


@dataclass(frozen=True)
class Readings:
    """Signals that share a clock.

    Attributes
    ----------
    name : of the group in the file.
    time : (n,) s, from an origin common to all groups of a file.
    signals : name -> (n,) in SI units.
    """

    name: str
    time: Array
    signals: Mapping[str, Array]


@dataclass(frozen=True)
class Joined:
    """Signals on one clock: time (n,) in s, signals (n,) each, how they were resampled, and notes on other changes."""

    time: Array
    signals: Mapping[str, Array]
    resampled: Mapping[str, Resampled]
    notes: tuple[str, ...]


def on_one_clock(groups: Sequence[Readings], named: str | None, hold: str, where: str, kind: str = "") -> Joined:
    """Resample all groups to the clock of one of them.

    Parameters
    ----------
    groups : two or more.
    named : name of the group whose clock is used; None takes the most regular of the fast ones.
    hold : "zero" holds commands, "linear" interpolates them as measurements.
    where : the file, for sentences.
    kind : "the recording" if each group is a recording; for sentences.

    Raises
    ------
    BadInput
        A group has fewer than two readings, or the groups have no time in common.
    """
    notes: list[str] = []
    ordered = [_ordered(group, where, notes) for group in groups]
    steps = {group.name: float(np.median(np.diff(group.time))) for group in ordered}
    clock = next((g for g in ordered if g.name == named), None) or _most_regular(ordered, steps)
    time, even = _instants(clock.time, where)
    start = max(group.time[0] for group in ordered)
    stop = min(group.time[-1] + (_reach(group, steps, hold) if group is not clock else 0.0) for group in ordered)
    inside = time[(time >= start) & (time <= stop)]
    if not inside.size:
        spans = "; ".join(f"{g.name} {g.time[0]:.3f} to {g.time[-1]:.3f} s" for g in ordered)
        raise BadInput(f"{where}: the groups that the column map names have no time in common: {spans}.")
    whose = f"{kind} {quoted([clock.name])[0]}" if kind else clock.name
    kept = f"the clock of {whose}, at an even step" if even else f"the time stamps of {whose}"
    notes.insert(0, f"the signals have {len(ordered)} clocks; all were resampled to {kept}.")
    cut = len(time) - len(inside)
    if cut:
        notes.append(f"{cut} of {len(time)} instants were left out, since not all signals were recorded there.")
    signals: dict[str, Array] = {}
    resampled: dict[str, Resampled] = {}
    for group in ordered:
        for name, values in group.signals.items():
            if group is clock and not even:
                signals[name] = values[(time >= start) & (time <= stop)]
            else:
                method = _method(name, hold)
                signals[name], costs = (held if method == "held" else linear)(group.time, values, inside, name)
                resampled[name] = Resampled(method, group.name, 1 / steps[group.name], *costs)
    return Joined(inside, signals, resampled, tuple(notes))


def at_rate(recording: Recording, rate: float) -> Recording:
    """A recording resampled to an even rate: measurements interpolated linearly, commands as `Recording.hold` states.

    For a rate below the recording's, measurements are first averaged over the new step, to avoid aliasing.

    Parameters
    ----------
    rate : rows per second, Hz.

    Raises
    ------
    BadInput
        No run is as long as two of the new rows, or there would be too many rows.
    """
    by = int(1 / (rate * recording.sample_time))
    spans = [(a, b) for a, b in recording.runs if np.all(np.diff(recording.time[a:b]) > 0)]
    grids = [
        recording.time[a] + np.arange(1 + int((np.ptp(recording.time[a:b]) + 1e-9) * rate)) / rate for a, b in spans
    ]
    kept = [(*span, grid) for span, grid in zip(spans, grids, strict=True) if len(grid) > 1]
    if not kept or sum(map(len, grids)) > MOST_ROWS:
        raise BadInput(f"{recording.name} cannot be resampled at {rate:g} Hz: its runs are too short, or far too long.")
    signals, resampled = dict[str, Array](), dict(recording.resampled)
    for name, values in recording.signals.items():
        held_on = _method(name, recording.hold) == "held"
        mean = not held_on and by > 1 and name not in ANGLES_AROUND
        parts, costs = [], (0.0, 0.0)
        for a, b, grid in kept:
            run = moving_mean(values[a:b], 2 * (by // 2) + 1) if mean else values[a:b]
            part, cost = (held if held_on else linear)(recording.time[a:b], run, grid, name)
            parts.append(part)
            costs = max(costs, cost)
        signals[name] = np.concatenate(parts)
        how: Literal["linear", "held"] = "held" if held_on else "linear"
        resampled[name] = Resampled(how, "the recording", 1 / recording.sample_time, *costs)
    edges = np.cumsum([0, *(len(grid) for *_, grid in kept)]).tolist()
    return replace(
        recording,
        time=np.concatenate([grid for *_, grid in kept]),
        signals=signals,
        runs=tuple(zip(edges, edges[1:], strict=False)),
        resampled=resampled,
    )


def _most_regular(groups: Sequence[Readings], steps: Mapping[str, float]) -> Readings:
    """The group with the least scatter of steps, among those at least half as fast as the fastest."""
    fast = [group for group in groups if steps[group.name] <= 2 * min(steps.values())]

    def scatter(group: Readings) -> float:
        step = np.diff(group.time)
        running = step[step <= LINEAR_GAP * steps[group.name]]
        return round(float(np.std(running)) / steps[group.name], 2)

    return min(fast, key=lambda group: (scatter(group), steps[group.name]))


def _method(name: str, hold: str) -> Literal["linear", "held"]:
    return "held" if name in COMMANDS and hold == "zero" else "linear"


def _reach(group: Readings, steps: Mapping[str, float], hold: str) -> float:
    """How long after its last reading a group still has values, s: commands are held, measurements end at once."""
    all_held = all(_method(name, hold) == "held" for name in group.signals)
    return max(HELD_GAP * steps[group.name], HELD_SECONDS) if all_held else 0.0


def _ordered(group: Readings, where: str, notes: list[str]) -> Readings:
    order = np.argsort(group.time, kind="stable")
    order = order[np.isfinite(group.time[order])]
    times = group.time[order]
    last = np.append(np.diff(times) > 0, True) if len(times) else np.empty(0, bool)  # of equal times the last row
    if np.count_nonzero(last) < 2:
        raise BadInput(f"{where}: {group.name} has fewer than two readings; leave its columns out of the column map.")
    lost = len(group.time) - int(np.count_nonzero(last))
    if lost:
        notes.append(
            f"{group.name}: {lost} of {len(group.time)} readings have no time, or the same time as another one; left "
            "out."
        )
    if np.any(np.diff(group.time) < 0):
        notes.append(f"{group.name}: readings were not in the order of their times, and were sorted.")
    order = order[last]
    return Readings(group.name, group.time[order], {name: values[order] for name, values in group.signals.items()})


def _instants(time: Array, where: str) -> tuple[Array, bool]:
    """The clock's time stamps if they are regular, else an even grid between gaps; whether it is a grid."""
    steps = np.diff(time)
    usual = float(np.median(steps))
    running = steps <= LINEAR_GAP * usual
    if np.std(steps[running]) <= REGULAR * usual:
        return time, False
    edges = [0, *(np.flatnonzero(~running) + 1).tolist(), len(time)]
    counts = [1 + int((time[b - 1] - time[a]) / usual * (1 + 1e-12)) for a, b in zip(edges, edges[1:], strict=False)]
    if sum(counts) > MOST_ROWS:
        raise BadInput(
            f"{where}: resampled to the even step of its clock, the recording would have {sum(counts)} "
            "rows; name another clock as time."
        )
    return np.concatenate([time[a] + usual * np.arange(n) for a, n in zip(edges, counts, strict=False)]), True


def linear(time: Array, values: Array, instants: Array, name: str) -> tuple[Array, tuple[float, float]]:
    """Linear interpolation of readings, and its error (rms, largest): s (1 - s) / 2 times the local second difference.

    This is the error for a parabola through three readings; noise of the readings makes the estimate too large.
    """
    finite = np.isfinite(values)
    t, v = time[finite], values[finite]
    if len(t) < 2:
        return np.full(len(instants), np.nan), (np.nan, np.nan)
    lowest, around = float(np.min(v)), name in ANGLES_AROUND and np.ptp(v) <= 2 * np.pi
    if around:
        v = np.unwrap(v)
    before = np.clip(np.searchsorted(t, instants, side="right") - 1, 0, len(t) - 2)
    step = np.diff(t)
    share = (instants - t[before]) / step[before]
    interpolated = v[before] + share * (v[before + 1] - v[before])
    interpolated = np.where(share == 1, v[before + 1], interpolated)
    reached = (step[before] <= LINEAR_GAP * float(np.median(step)) * (1 + 1e-9)) | (share == 0) | (share == 1)
    interpolated[~reached | (share < 0) | (share > 1)] = np.nan
    if around:
        begins = -np.pi if lowest < 0 else 0.0
        interpolated = begins + np.mod(interpolated - begins, 2 * np.pi)
    if len(t) < 3:
        return interpolated, (np.nan, np.nan)
    bend = np.abs(2 * np.diff(np.diff(v) / step) / (step[1:] + step[:-1]))
    bend = np.concatenate([bend[:1], np.maximum(bend[:-1], bend[1:]), bend[-1:]])
    missed = (share * (1 - share) / 2 * step[before] ** 2 * bend[before])[np.isfinite(interpolated)]
    return interpolated, _costs(missed, len(missed))


def held(time: Array, values: Array, instants: Array, name: str) -> tuple[Array, tuple[float, float]]:
    """The last reading before each instant, and the error (rms, largest) of steps that appear up to one row late."""
    finite = np.isfinite(values)
    t, v = time[finite], values[finite]
    if not len(t):
        return np.full(len(instants), np.nan), (np.nan, np.nan)
    before = np.searchsorted(t, instants, side="right") - 1
    usual = float(np.median(np.diff(t))) if len(t) > 1 else 0.0
    age = instants - t[np.maximum(before, 0)]
    last = np.where((before >= 0) & (age <= max(HELD_GAP * usual, HELD_SECONDS)), v[np.maximum(before, 0)], np.nan)
    inside = (t[1:] > instants[0]) & (t[1:] <= instants[-1])
    jumps = np.diff(v)[inside]
    late = instants[np.searchsorted(instants, t[1:][inside])] - t[1:][inside]
    span = float(instants[-1] - instants[0])
    return last, _costs(jumps * np.sqrt(late), span, np.abs(jumps[late > 0]))


def _costs(missed: Array, over: float, sizes: Array | None = None) -> tuple[float, float]:
    """Root mean square and largest of errors."""
    if not over:
        return 0.0, 0.0
    sizes = missed if sizes is None else sizes
    return float(np.sqrt(np.sum(missed**2) / over)), float(np.max(sizes, initial=0.0))
