"""Where a vehicle spins: it slides more sideways than forwards, and no model of handling describes it.

A simulation that loses the vehicle there does not find it again: rows from the beginning of a spin until the vehicle
drives straight are not of its handling.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from ..base.numbers import number
from ..base.shorthands import Array, Index, Mask
from .recording import Recording

FASTER = 1.0
"""m/s: slower vehicles do not spin, and errors of an accelerometer are as large as sideways speed."""
STEP, GAIN, FORGETS = 0.02, 2.0, 1.0
"""Of the observer of sideways speed: step in s; its poles over the yaw rate, within those that its authors compare;
and s in which errors decay while the vehicle does not turn, several times what tyres need."""
LASTS = 0.1
"""Shortest s of a spin: shorter ones are single readings that are off."""
BEGINS = 0.25
"""Tangent of the sideslip angle, 14 degrees, at which a spin begins: tyres that grip have half of it."""
STRAIGHT, FOR = 1.0, 1.0
"""m/s^2 and s: below such a lateral acceleration, for as long, a vehicle drives straight."""
LEAST = 2.0
"""Shortest s of a run between spins: prediction errors are evaluated up to two seconds ahead."""


def spins(recording: Recording) -> list[tuple[int, int]]:
    """Rows [a, b) in which the vehicle spins, from where its sideslip angle grows until it drives straight again."""
    if not recording.has("v_x", "yaw_rate") or not (recording.has("v_y") or recording.has("a_y")):
        return []
    if not recording.sample_time > 0:  # nan if no two rows are consecutive
        return []
    result = list[tuple[int, int]]()
    for start, stop in recording.runs:
        rows = np.arange(start, stop, max(1, round(STEP / recording.sample_time)))
        time = recording.time[rows]
        read = {name: _filled(recording, name, rows) for name in ("v_x", "v_y", "yaw_rate", "a_x", "a_y")
                if recording.has(name)}  # fmt: skip
        forwards, sideways = read["v_x"], read["v_y"] if "v_y" in read else _sideways(time, read)
        slides = np.abs(sideways) > BEGINS * np.abs(forwards)
        lost = (np.abs(sideways) > np.abs(forwards)) & (np.hypot(sideways, forwards) > FASTER)
        straight = _lasting(~slides & (forwards > FASTER) & (np.abs(forwards * read["yaw_rate"]) < STRAIGHT), time)
        at = 0
        while np.any(lost[at:]):
            first = at + int(np.argmax(lost[at:]))
            before, later = np.flatnonzero(~slides[at:first]), np.flatnonzero(straight[first:])
            begin = int(rows[at + int(before[-1])]) + 1 if len(before) else int(rows[at])
            at = first + int(later[0]) if len(later) else len(rows)
            if np.ptp(time[first:at][lost[first:at]]) > LASTS:
                result.append((begin, int(rows[at]) if at < len(rows) else stop))
    return result


def span(recording: Recording, a: int, b: int) -> str:
    """When rows [a, b) are, for a sentence."""
    return f"from t = {number(float(recording.time[a]), 4)} to {number(float(recording.time[b - 1]), 4)} s"


def without_spins(recording: Recording) -> Recording:
    """The recording in runs that leave out its spins; as it is where nothing else is left."""
    out = spins(recording)
    if not out:
        return recording
    pieces = list[tuple[int, int]]()
    for start, stop in recording.runs:
        inside = [(a, b) for a, b in out if start <= a < stop]
        begins, ends = [start, *(b for _, b in inside)], [*(a for a, _ in inside), stop]
        pieces += [
            (a, b) for a, b in zip(begins, ends, strict=True)
            if b - a > 1 and recording.time[b - 1] - recording.time[a] >= LEAST
        ]  # fmt: skip
    if not pieces:
        return recording
    rows = np.concatenate([np.arange(a, b) for a, b in pieces])
    edges = np.cumsum([0, *(b - a for a, b in pieces)]).tolist()
    return recording.taken(rows, zip(edges[:-1], edges[1:], strict=True))


def _sideways(time: Array, read: Mapping[str, Array]) -> Array:
    """Sideways speed, m/s: accelerations, integrated in the rotating frame and corrected by the forward speed.

    The faster the vehicle turns, the better forward speed shows it (Farrelly & Wellstead, IEEE Conference on Control
    Applications, 1996); while the vehicle does not turn, it decays.
    """
    columns = [read[name].tolist() for name in ("v_x", "yaw_rate", "a_y")]
    a_x = read["a_x"].tolist() if "a_x" in read else None
    x, y, result = columns[0][0], 0.0, [0.0]
    for k, h in enumerate(np.diff(time).tolist()):
        forwards, turning, a_y = (column[k] for column in columns)
        off = forwards - x
        if a_x is None:
            x, off = forwards, 0.0
        else:
            x += h * (turning * y + a_x[k] + 2 * GAIN * abs(turning) * off + off / FORGETS)
        y += h * (a_y - turning * x + (GAIN**2 - 1) * turning * off - y / FORGETS)
        result.append(y)
    return np.array(result)


def _filled(recording: Recording, name: str, rows: Index) -> Array:
    """Readings in these rows, interpolated over gaps; zero without any."""
    time, values = recording.time[rows], recording[name][rows]
    there = np.isfinite(values)
    return np.interp(time, time[there], values[there]) if np.any(there) else np.zeros(len(values))


def _lasting(holds: Mask, time: Array) -> Mask:
    """(N,) whether a condition holds in a row, and for `FOR` s from it on."""
    broken = np.flatnonzero(~holds)
    until = np.append(time[broken], time[-1])[np.searchsorted(broken, np.arange(len(holds)))]
    return np.asarray(holds & (until - time >= FOR))
