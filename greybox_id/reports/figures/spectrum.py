"""Power spectral densities: the measured signal, the residual, and the sensors' noise where it can be heard alone."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.figure import Figure
from scipy.signal import welch

from ...fit import Fit
from ...parameter import Array
from ..noise import Noise
from ..numbers import pretty_unit
from ..recordings import Seen, run_rows
from .style import MEASURED, NOISE, PROTOCOL_LINES, Line, canvas, legend_above, look, symbol

LONGEST = 256
"""Samples of a Hamming window, as in the papers; shorter where the runs are."""
BELOW = 0.01
"""How far below the median of the lowest curve the axis reaches: a filtered channel falls without end."""


def spectrum(fit: Fit, one: Seen, noise: Noise | None) -> Figure:
    """Spectra of every output of one recording, and of its noise where there is any to be heard.

    Welch's method within unbroken runs, Hamming windows that overlap by half; no window crosses a join.
    """
    rate = 1.0 / one.recording.sample_time
    outputs = fit.model.outputs
    with look():
        figure = canvas(2.8)
        panels = figure.subplots(1, len(outputs), squeeze=False)[0]
        for k, (name, axes) in enumerate(zip(outputs, panels, strict=True)):
            measured = [part.measured[:, k] for _, part in run_rows(one, "honest")]
            curves: list[tuple[Line, str, Sequence[Array]]] = [(MEASURED, MEASURED.words, measured)]
            for protocol in one.predicted:
                if protocol != "published":
                    line = PROTOCOL_LINES[protocol]
                    errors = [part.predicted[:, k] - part.measured[:, k] for _, part in run_rows(one, protocol)]
                    curves.append((line, f"residual, {line.words}", errors))
            if noise is not None and noise.of(name):
                curves.append((NOISE, f"noise, {noise.where}", noise.of(name)))
            for line, words, parts in curves:
                frequency, density = psd(parts, rate)
                axes.loglog(frequency[1:], density[1:], label=words, **line.shape())
            lowest = min(float(np.median(curve.get_ydata())) for curve in axes.lines)
            axes.set_ylim(bottom=lowest * BELOW)
            unit = pretty_unit(one.recording.unit(name))
            axes.set_ylabel(f"PSD of {symbol(name)} [({unit})²/Hz]")
            axes.set_xlabel("frequency [Hz]")
            axes.set_xlim(right=rate / 2)
        legend_above(figure, panels[0])
    return figure


def psd(parts: Sequence[Array], rate: float) -> tuple[Array, Array]:
    """Welch's spectrum averaged over unbroken parts: frequency in Hz, one-sided density per Hz.

    The window is the longest power of two that half the parts' samples can fill; shorter parts are left out.
    """
    lengths = np.sort([len(part) for part in parts])[::-1]
    filled = lengths[np.searchsorted(np.cumsum(lengths), lengths.sum() / 2)]
    length = min(LONGEST, 2 ** int(np.log2(filled)))
    total, weight, frequency = np.zeros(length // 2 + 1), 0, np.zeros(length // 2 + 1)
    for part in parts:
        if len(part) >= length:
            segments = (len(part) - length // 2) // (length - length // 2)
            frequency, density = welch(part, rate, "hamming", length, length // 2, detrend="constant")
            total, weight = total + segments * density, weight + segments
    return frequency, np.maximum(total / weight, np.finfo(float).tiny)
