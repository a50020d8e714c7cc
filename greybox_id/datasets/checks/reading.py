"""What reading did to the file: signals brought onto another clock, and what that costs."""

from __future__ import annotations

import re

import numpy as np

from ...base.numbers import exact, number, quantity
from ...base.signals import SIGNALS
from ..recording import Recording
from .finding import Finding, FoundAt, Severity, listed

SMALL = 0.05
"""An error beyond this share of the signal's own scatter is more than a note."""
QUESTION = re.compile(r'^\s*#\?\s*(\w+)\s*=\s*\{\s*column\s*=(?!\s*"\.\.\.")', re.MULTILINE)
"""A signal that a proposed map leaves open; one without a column is an offer, no question."""


def check_reading(recording: Recording) -> list[Finding]:
    """Findings about signals that were resampled, and the notes that reading left."""
    findings = [Finding("reading", Severity.NOTE, FoundAt("file"), note) for note in recording.notes]
    findings += _open_questions(recording)
    for name, how in recording.resampled.items():
        unit = recording.unit(name)
        what = "a straight line between readings" if how.method == "linear" else "held until the next"
        sentence = f"read at {exact(how.rate, 4)} Hz on the clock of {how.clock}, {what}; "
        if not np.isfinite(how.error):
            sentence += "too few readings to estimate the error."
            findings.append(Finding("resampled", Severity.WARNING, FoundAt(name), sentence))
            continue
        values = recording[name][np.isfinite(recording[name])]
        scatter = float(np.std(values)) if values.size else 0.0
        sentence += f"that adds an error of {quantity(how.error, unit, 2)} (root mean square, estimated), "
        sentence += f"{number(how.largest, 2)} at most; {name} itself scatters by {quantity(scatter, unit, 2)}."
        severity = Severity.NOTE if how.error <= SMALL * scatter else Severity.WARNING
        findings.append(Finding("resampled", severity, FoundAt(name), sentence, how.error, None, unit))
    return findings


def _open_questions(recording: Recording) -> list[Finding]:
    """Signals that the column map leaves open."""
    text = recording.source.column_map
    names = [name for name in dict.fromkeys(QUESTION.findall(text)) if name in SIGNALS and name not in recording]
    if not names:
        return []
    sentence = (
        f"the column map leaves {listed(names)} open (lines that begin with #?): remove the #? from the right line, or "
        "delete the question."
    )
    return [Finding("question", Severity.WARNING, FoundAt(names[0]), sentence, float(len(names)))]
