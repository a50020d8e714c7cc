"""Measured and predicted over time, with the residual below."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

from ...parameter import Array
from ...scores.metrics import Prediction
from ..recordings import Seen, run_rows
from .style import MEASURED, PROTOCOL_LINES, canvas, label, legend_above, look, signal_label

SECONDS = 15.0
"""Length of the stretch that is shown."""
TALL, TALLEST, LOW = 2.1, 5.5, 1.35
"""Height of one output's panels, inches; of the whole figure, at most; of one output's panels then, at least."""
SMALL = 7.0
"""Size of the letters of labels where panels are low."""
GAP = 1.5
"""Lines break where the step between rows is more than so many times the usual one."""
DENSE = 0.5
"""What is read in a larger share of the rows is drawn as a line, with its gaps; else as dots."""


def traces(one: Seen) -> Figure:
    """Every output over a typical stretch of a recording: measured, predicted under each protocol, and residuals."""
    start, stop = typical_stretch(one)
    letters = {"fontsize": SMALL} if TALL * len(one.outputs) > TALLEST else {}
    with look():
        figure = canvas(max(min(TALL * len(one.outputs), TALLEST), LOW * len(one.outputs)) + 0.5)
        panels = figure.subplots(2 * len(one.outputs), 1, sharex=True, height_ratios=[2.4, 1.2] * len(one.outputs))
        time = one.recording.time[start:stop]
        for k, name in enumerate(one.outputs):
            above, below = panels[2 * k], panels[2 * k + 1]
            read = one.recording[name][start:stop]
            dots = {} if np.mean(np.isfinite(read)) > DENSE else {"linestyle": "", "marker": ".", "markersize": 3.0}
            above.plot(time, read, label=MEASURED.words, **(MEASURED.shape() | dots))
            below.axhline(0.0, color=MEASURED.colour, linewidth=0.6)
            for protocol, prediction in one.predicted.items():
                if protocol not in PROTOCOL_LINES or protocol == "published":  # the latter: the same but for the joins
                    continue
                line = PROTOCOL_LINES[protocol]
                inside = (prediction.rows >= start) & (prediction.rows < stop)
                rows, shown = prediction.rows[inside], prediction.predicted[inside, k]
                at = one.recording.time[rows]
                above.plot(*_with_gaps(rows, at, shown), label=line.words, **line.shape())
                error = shown - prediction.measured[inside, k]
                below.plot(*_with_gaps(rows, at, error), **(line.shape() | dots))
            reach = 1.15 * (max(_farthest(np.asarray(line.get_ydata(), dtype=float)) for line in below.lines) or 1.0)
            below.set_ylim(-reach, reach)
            above.set_ylabel(signal_label(one.recording, name), **letters)
            below.set_ylabel(label("error", one.recording.unit(name)), **letters)
            above.margins(x=0)
        figure.align_ylabels()
        panels[-1].set_xlabel("time [s]")
        legend_above(figure, panels[0])
    return figure


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
