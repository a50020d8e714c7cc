"""Spectra of the errors before and after."""

from __future__ import annotations

import numpy as np

from ....gap import Strip
from ...figures.style import symbol
from ...plot.figure import Figure, Panel, nothing
from ...plot.marks import Curve, Mark, Rule
from ...plot.palette import PALE, Line
from ...plot.scale import Axis
from .looks import AFTER, BEFORE, row_of

LEAST = 3.0
"""The axis reaches from one over this to this at least."""


def spectra(strip: Strip, applied: bool) -> Figure:
    """A panel for each channel: spectral density of the errors over that of the noise."""
    known = strip.frequency > 0
    if not strip.spectrum_before or not np.any(known):
        return Figure(((nothing("no spectra of the errors were kept"),),), (40.0,))
    shown = [*strip.spectrum_before.values(), *(strip.spectrum_after.values() if applied else ())]
    every = np.concatenate([own[known] for own in shown])
    every = every[np.isfinite(every) & (every > 0)]
    low, high = (float(every.min()), float(every.max())) if len(every) else (1.0, 1.0)
    low, high = min(low, 1.0 / LEAST), max(high, LEAST)
    panels: list[Panel] = []
    for channel, before in strip.spectrum_before.items():
        frequency = strip.frequency[known]
        marks: list[Mark] = [Rule(1.0, Line(PALE, width=0.8)), Curve(frequency, before[known], BEFORE)]
        if applied and channel in strip.spectrum_after:
            marks.append(Curve(frequency, strip.spectrum_after[channel][known], AFTER))
        words = "errors over noise [1]" if not panels else ""
        panels.append(
            Panel(tuple(marks), Axis("frequency [Hz]", log=True), Axis(words, low, high, log=True), symbol(channel))
        )
    return row_of(panels, 80.0)
