"""Power spectral densities: the measured signal, the residual, and the sensors' noise where it can be heard alone."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes

from ...parameter import Array
from ...scores.metrics import Prediction
from ...statistics import welch
from ..noise import Noise
from ..numbers import pretty_unit
from ..recordings import Seen
from .sheet import Sheet, sheet_of
from .style import MEASURED, NOISE, PROTOCOL_LINES, Look, symbol

LONGEST = 256
"""Samples of a Hamming window, as in the papers; shorter where the runs are."""
SHORTEST = 16
"""Samples without a gap that a spectrum takes at least."""
ONE_ROW, COLUMNS = 4, 3
"""So many panels stand in one row; of more, so many do."""
BELOW = 0.01
"""How far below the median of the lowest curve the axis reaches: a filtered channel falls without end."""


def spectrum(one: Seen, noise: Noise | None) -> Sheet | None:
    """Spectra of every output of one recording, and of its noise where there is any to be heard.

    Welch's method within unbroken stretches of readings, Hamming windows that overlap by half; no window crosses a
    gap. None where no stretch is long enough.
    """
    rate = 1.0 / one.recording.sample_time
    main = one.predicted[one.main]
    shown = [k for k in range(len(one.outputs)) if _unbroken(main, main.measured[:, k])]
    if not shown:
        return None
    columns = len(shown) if len(shown) <= ONE_ROW else COLUMNS
    sheet, axes = sheet_of(len(shown), columns, 130.0 if len(shown) < COLUMNS else 105.0)
    for ax, k in zip(axes, shown, strict=True):
        _draw(ax, one, k, noise, rate)
    return sheet


def _draw(ax: Axes, one: Seen, k: int, noise: Noise | None, rate: float) -> None:
    lowest = np.inf
    for line, parts in _curves(one, k, noise):
        frequency, density = psd(parts, rate)
        ax.plot(frequency[1:], density[1:], **line)
        lowest = min(lowest, float(np.median(density[1:])))
    unit = pretty_unit(one.recording.unit(one.outputs[k]))
    ax.set(
        xlabel="frequency [Hz]", ylabel=f"PSD of {symbol(one.outputs[k])} [({unit})²/Hz]", xscale="log", yscale="log"
    )
    ax.set_xlim(right=round(rate / 2, 6))  # a tick at its end is within
    ax.set_ylim(bottom=lowest * BELOW)


def _curves(one: Seen, k: int, noise: Noise | None) -> list[tuple[Look, Sequence[Array]]]:
    """The curves of one output: look, and unbroken stretches of values."""
    first = one.predicted[one.main] if "honest" not in one.predicted else one.predicted["honest"]
    curves: list[tuple[Look, Sequence[Array]]] = [(MEASURED, _unbroken(first, first.measured[:, k]))]
    for protocol, found in one.predicted.items():
        if protocol in PROTOCOL_LINES and protocol != "published":
            line = PROTOCOL_LINES[protocol]
            errors = _unbroken(found, found.predicted[:, k] - found.measured[:, k])
            curves.append((line | {"label": f"residual, {line['label']}"}, errors))
    if noise is not None and noise.of(one.outputs[k]):
        curves.append((NOISE | {"label": f"noise, {noise.where}"}, noise.of(one.outputs[k])))
    return [curve for curve in curves if curve[1]]


def _unbroken(of: Prediction, values: Array) -> list[Array]:
    """Stretches of finite values in neighbouring rows of one run, those long enough."""
    known = np.flatnonzero(np.isfinite(values))
    edges = np.flatnonzero((np.diff(of.rows[known]) != 1) | (np.diff(of.run[known]) != 0)) + 1
    return [values[part] for part in np.split(known, edges) if len(part) >= SHORTEST]


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
            frequency, density = welch(part, rate, length)
            total, weight = total + segments * density, weight + segments
    return frequency, np.maximum(total / weight, np.finfo(float).tiny)
