"""Spectra of the errors before and after."""

from __future__ import annotations

import numpy as np

from ....gap import Strip
from ...figures.style import PALE, symbol
from .looks import AFTER, BEFORE, Sheet, nothing, row_of, ticks

LEAST = 3.0
"""The axis reaches from one over this to this at least."""


def spectra(sheet: Sheet, strip: Strip, applied: bool) -> None:
    """A panel for each channel: spectral density of the errors over that of the noise."""
    channels = list(strip.spectrum_before)
    known = strip.frequency > 0
    if not channels or not np.any(known):
        nothing(sheet.subplots(), "no spectra of the errors were kept")
        return
    for channel, axes in zip(channels, row_of(sheet, channels, sharey=True), strict=True):
        axes.axhline(1.0, color=PALE, linewidth=0.8)
        axes.loglog(strip.frequency[known], strip.spectrum_before[channel][known], **BEFORE.shape())
        if applied and channel in strip.spectrum_after:
            axes.loglog(strip.frequency[known], strip.spectrum_after[channel][known], **AFTER.shape())
        axes.set_title(symbol(channel))
        axes.set_xlabel("frequency [Hz]")
        low, high = axes.get_ylim()
        axes.set_ylim(min(low, 1.0 / LEAST), max(high, LEAST))
        ticks(axes.xaxis, 1.0, 1e3)
        ticks(axes.yaxis, *axes.get_ylim())
        if channel == channels[0]:
            axes.set_ylabel("spectral density of\nerrors over noise [–]")
