"""Measured and predicted over time, with the residual below."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

from ...fit import Fit
from ...metrics import Prediction
from ..recordings import Seen, run_rows
from .style import MEASURED, PROTOCOL_LINES, canvas, label, legend_above, look, signal_label

SECONDS = 15.0
"""Length of the stretch that is shown."""


def traces(fit: Fit, one: Seen) -> Figure:
    """Every output over a typical stretch of a recording: measured, one sample ahead, closed loop, and residuals."""
    start, stop = typical_stretch(one)
    outputs = fit.model.outputs
    with look():
        figure = canvas(2.1 * len(outputs) + 0.5)
        panels = figure.subplots(2 * len(outputs), 1, sharex=True, height_ratios=[2.4, 1.2] * len(outputs))
        time = one.recording.time[start:stop]
        for k, name in enumerate(outputs):
            above, below = panels[2 * k], panels[2 * k + 1]
            above.plot(time, one.recording[name][start:stop], label=MEASURED.words, **MEASURED.shape())
            below.axhline(0.0, color=MEASURED.colour, linewidth=0.6)
            for protocol, prediction in one.predicted.items():
                if protocol == "published":  # the same predictions as one sample ahead, but for the joins
                    continue
                line = PROTOCOL_LINES[protocol]
                inside = (prediction.rows >= start) & (prediction.rows < stop)
                at, shown = one.recording.time[prediction.rows[inside]], prediction.predicted[inside, k]
                above.plot(at, shown, label=line.words, **line.shape())
                below.plot(at, shown - prediction.measured[inside, k], **line.shape())
            reach = 1.15 * max(np.max(np.abs(line.get_ydata())) for line in below.lines)
            below.set_ylim(-reach, reach)
            above.set_ylabel(signal_label(one.recording, name))
            below.set_ylabel(label("error", one.recording.unit(name)))
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
    average = np.mean((whole.predicted - whole.measured) ** 2, axis=0)
    length = max(2, round(SECONDS / one.recording.sample_time))
    best, least = (int(whole.rows[0]), int(whole.rows[-1]) + 1), np.inf
    parts = [part for _, part in run_rows(one, one.main)]
    length = min(length, max(len(part.rows) for part in parts))
    for part in (part for part in parts if len(part.rows) >= length):
        sums = np.cumsum(np.vstack([np.zeros(len(average)), _squares(part)]), axis=0)
        means = (sums[length:] - sums[:-length]) / length
        distance = np.abs(np.log(np.maximum(np.mean(means / np.maximum(average, 1e-300), axis=1), 1e-12)))
        k = int(np.argmin(distance))
        if distance[k] < least:
            best, least = (int(part.rows[k]), int(part.rows[k + length - 1]) + 1), float(distance[k])
    return best


def _squares(part: Prediction) -> np.ndarray[tuple[int, ...], np.dtype[np.float64]]:
    squares: np.ndarray[tuple[int, ...], np.dtype[np.float64]] = (part.predicted - part.measured) ** 2
    return squares
