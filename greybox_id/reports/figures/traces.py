"""Measured and predicted over time, with the residual below."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes

from ...parameter import Array
from ..recordings import Seen, typical_stretch
from .sheet import Sheet
from .style import MEASURED, PROTOCOL_LINES, ZERO, Look, label, signal_label

TALL, TALLEST, LOW = 130.0, 400.0, 62.0
"""Height of one output's panels, points; of all panels, at most; of one output's panels then, at least."""
GAP = 1.5
"""Lines break where the step between rows is more than so many times the usual one."""
DENSE = 0.5
"""What is read in a larger share of the rows is drawn as a line, with its gaps; else as dots."""


def traces(one: Seen, tallest: float = TALLEST) -> Sheet:
    """Every output over a typical stretch of a recording: measured, predicted under each protocol, and residuals.

    Parameters
    ----------
    one : the recording.
    tallest : height of all panels together, points, if letters leave room for it.
    """
    start, stop = typical_stretch(one)
    each = max(min(TALL, tallest / len(one.outputs)), LOW)
    sheet = Sheet((0.64 * each, 0.36 * each) * len(one.outputs), joined=True)
    for k, name in enumerate(one.outputs):
        above, below = sheet.grid[2 * k : 2 * k + 2, 0]
        reach = 1.15 * (_draw(above, below, one, k, start, stop) or 1.0)
        above.set_ylabel(_stacked(signal_label(one.recording, name)))
        below.set(ylabel=_stacked(label("error", one.recording.unit(name))), ylim=(-reach, reach))
    sheet.grid[-1, 0].set(xlabel="time [s]", xlim=one.recording.time[[start, stop - 1]])
    return sheet


def _stacked(words: str) -> str:
    """A label with its unit on a line of its own: panels are low."""
    return words.replace(" [", "\n[")


def _draw(above: Axes, below: Axes, one: Seen, k: int, start: int, stop: int) -> float:
    """Draw what was read and predicted of one output, and the errors; the largest of these."""
    read = one.recording[one.outputs[k]][start:stop]
    above.plot(one.recording.time[start:stop], read, **MEASURED | _dotted(read))
    below.axhline(0.0, **ZERO)
    largest = 0.0
    for protocol, prediction in one.predicted.items():
        if protocol not in PROTOCOL_LINES or protocol == "published":  # the latter: the same but for the joins
            continue
        line = PROTOCOL_LINES[protocol]
        inside = (prediction.rows >= start) & (prediction.rows < stop)
        rows, shown = prediction.rows[inside], prediction.predicted[inside, k]
        at = one.recording.time[rows]
        above.plot(*_with_gaps(rows, at, shown), **line)
        error = shown - prediction.measured[inside, k]
        below.plot(*_with_gaps(rows, at, error), **line | _dotted(read))
        largest = max(largest, float(np.max(np.abs(error[np.isfinite(error)]), initial=0.0)))
    return largest


def _dotted(read: Array) -> Look:
    """Dots instead of a line for what was read now and then."""
    return (
        {}
        if np.mean(np.isfinite(read)) > DENSE
        else {"linestyle": "", "marker": "o", "markersize": 2.4, "markeredgewidth": 0}
    )


def _with_gaps(rows: Array, at: Array, values: Array) -> tuple[Array, Array]:
    """Times and values with a gap where rows are left out that usually are there."""
    steps = np.diff(rows)
    gaps = np.flatnonzero(steps > GAP * np.median(steps)) + 1 if len(steps) else np.empty(0, dtype=np.intp)
    return np.insert(at, gaps, np.nan), np.insert(values, gaps, np.nan)
