"""Spectra of the errors before and after."""

from __future__ import annotations

import numpy as np

from ....gap import Strip
from ...figures.sheet import Sheet, notice_sheet
from ...figures.style import PALE, look, symbol
from .looks import AFTER, BEFORE, row_of

LEAST = 3.0
"""The axis reaches from one over this to this at least."""


def spectra(strip: Strip, applied: bool) -> Sheet:
    """A panel for each channel: spectral density of the errors over that of the noise."""
    known = strip.frequency > 0
    if not strip.spectrum_before or not np.any(known):
        return notice_sheet("no spectra of the errors were kept")
    shown = [*strip.spectrum_before.values(), *(strip.spectrum_after.values() if applied else ())]
    every = np.concatenate([own[known] for own in shown])
    every = every[np.isfinite(every) & (every > 0)]
    low, high = (float(every.min()), float(every.max())) if len(every) else (1.0, 1.0)
    low, high = min(low, 1.0 / LEAST), max(high, LEAST)
    sheet, axes = row_of(len(strip.spectrum_before), 80.0)
    for ax, (channel, before) in zip(axes, strip.spectrum_before.items(), strict=True):
        ax.axhline(1.0, **look(PALE, 0.8))
        ax.plot(strip.frequency[known], before[known], **BEFORE)
        if applied and channel in strip.spectrum_after:
            ax.plot(strip.frequency[known], strip.spectrum_after[channel][known], **AFTER)
        ax.set(xlabel="frequency [Hz]", xscale="log", yscale="log", ylim=(low, high), title=symbol(channel))
    axes[0].set_ylabel("errors over noise [1]")
    return sheet
