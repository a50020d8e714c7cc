"""Measured and predicted over time, with the residual below."""

from __future__ import annotations

import numpy as np

from ...parameter import Array
from ...scores.metrics import Prediction
from ..plot.figure import Figure, Panel
from ..plot.marks import Curve, Mark, Rule
from ..plot.scale import Axis
from ..recordings import Seen, run_rows
from .style import MEASURED, PROTOCOL_LINES, label, signal_label

SECONDS = 15.0
"""Length of the stretch that is shown."""
TALL, TALLEST, LOW = 130.0, 400.0, 62.0
"""Height of one output's panels, points; of all panels, at most; of one output's panels then, at least."""
GAP = 1.5
"""Lines break where the step between rows is more than so many times the usual one."""
DENSE = 0.5
"""What is read in a larger share of the rows is drawn as a line, with its gaps; else as dots."""


def traces(one: Seen, tallest: float = TALLEST) -> Figure:
    """Every output over a typical stretch of a recording: measured, predicted under each protocol, and residuals.

    Parameters
    ----------
    one : the recording.
    tallest : height of all panels together, points, if letters leave room for it.
    """
    start, stop = typical_stretch(one)
    time = one.recording.time
    x = Axis("time [s]", float(time[start]), float(time[stop - 1]))
    rows: list[tuple[Panel]] = []
    for k, name in enumerate(one.outputs):
        above, below = _marks(one, k, start, stop)
        reach = 1.15 * (max(_farthest(mark.reach[1]) for mark in below) or 1.0)
        rows.append((Panel(tuple(above), x, Axis(_stacked(signal_label(one.recording, name)))),))
        rows.append((Panel(tuple(below), x, Axis(_stacked(label("error", one.recording.unit(name))), -reach, reach)),))
    each = max(min(TALL, tallest / len(one.outputs)), LOW)
    return Figure(tuple(rows), (0.64 * each, 0.36 * each) * len(one.outputs), joined=True)


def _stacked(words: str) -> str:
    """A label with its unit on a line of its own: panels are low."""
    return words.replace(" [", "\n[")


def _marks(one: Seen, k: int, start: int, stop: int) -> tuple[list[Mark], list[Mark]]:
    """What was read and predicted of one output, and the errors."""
    read = one.recording[one.outputs[k]][start:stop]
    dense = bool(np.mean(np.isfinite(read)) > DENSE)
    dots = 0.0 if dense else 1.2
    above: list[Mark] = [Curve(one.recording.time[start:stop], read, MEASURED, dots, joined=dense)]
    below: list[Mark] = [Rule(0.0)]
    for protocol, prediction in one.predicted.items():
        if protocol not in PROTOCOL_LINES or protocol == "published":  # the latter: the same but for the joins
            continue
        line = PROTOCOL_LINES[protocol]
        inside = (prediction.rows >= start) & (prediction.rows < stop)
        rows, shown = prediction.rows[inside], prediction.predicted[inside, k]
        at = one.recording.time[rows]
        above.append(Curve(*_with_gaps(rows, at, shown), line))
        error = shown - prediction.measured[inside, k]
        below.append(Curve(*_with_gaps(rows, at, error), line, dots, joined=dense))
    return above, below


def typical_stretch(one: Seen) -> tuple[int, int]:
    """The rows of the stretch whose error is nearest to that of the whole recording: neither its best nor its worst.

    The error is the mean over the outputs of the mean square, each relative to its own over the recording.
    """
    whole = one.predicted[one.main]
    average = _mean_squares(whole, len(whole.rows))
    length = max(2, round(SECONDS / one.recording.sample_time))
    best, least = (int(whole.rows[0]), int(whole.rows[-1]) + 1), np.inf
    parts = [part for _, part in run_rows(one, one.main)]
    length = min(length, max(len(part.rows) for part in parts))
    for part in (part for part in parts if len(part.rows) >= length):
        means = _mean_squares(part, length)
        distance = np.abs(np.log(np.maximum(np.mean(means / np.maximum(average, 1e-300), axis=1), 1e-12)))
        k = int(np.argmin(distance))
        if distance[k] < least:
            best, least = (int(part.rows[k]), int(part.rows[k + length - 1]) + 1), float(distance[k])
    return best


def _mean_squares(part: Prediction, length: int) -> Array:
    """(windows, outputs) mean square of the residuals over every stretch of so many rows, those that were read."""
    residual = part.predicted - part.measured
    known = np.isfinite(residual)

    def sums(values: Array) -> Array:
        total = np.cumsum(np.vstack([np.zeros(values.shape[1]), values]), axis=0)
        return np.asarray(total[length:] - total[:-length])

    squares = np.where(known, residual, 0.0) ** 2
    return np.asarray(sums(squares) / np.maximum(sums(known.astype(float)), 1.0))


def _with_gaps(rows: Array, at: Array, values: Array) -> tuple[Array, Array]:
    """Times and values with a gap where rows are left out that usually are there."""
    steps = np.diff(rows)
    gaps = np.flatnonzero(steps > GAP * np.median(steps)) + 1 if len(steps) else np.empty(0, dtype=np.intp)
    return np.insert(at, gaps, np.nan), np.insert(values, gaps, np.nan)


def _farthest(values: Array) -> float:
    """The largest size of what is finite."""
    return float(np.max(np.abs(values[np.isfinite(values)]), initial=0.0))
