"""Readings that are exactly zero for a row or two because a message was lost."""

from __future__ import annotations

import numpy as np

from ...base.signals import COMMANDS, SD
from ..recording import Recording
from .finding import Finding, FoundAt, Severity, file_rows

LONGEST = 2
"""Largest number of rows of a lost reading; longer zeros are reported by other checks."""
BEYOND, STEPS, LEVELS = 2.0, 3.0, 5.0
"""Readings before and after a gap exceed `BEYOND` times their difference, `STEPS` usual steps and `LEVELS` times the
distance between the channel's levels: noise of a coarsely quantised channel flickers by one or two levels."""
FEWEST, SHARE = 8, 0.1
"""Fewest gaps, and their smallest share of all rows that are exactly zero: a dead zone has other zeros."""


def check_dropouts(recording: Recording) -> list[Finding]:
    """Channels that repeatedly drop to zero for a row or two."""
    findings = []
    run = np.searchsorted([start for start, _ in recording.runs], np.arange(len(recording)), side="right")
    for name, values in recording.signals.items():
        zero = values == 0.0
        if name in COMMANDS or name.startswith(SD) or np.count_nonzero(zero) < FEWEST:
            continue
        levels = np.unique(values[np.isfinite(values)])
        if len(levels) < 2:
            continue
        usual = float(np.nanmedian(np.abs(np.diff(values))))
        least = max(STEPS * usual, LEVELS * float(np.median(np.diff(levels))))
        edges = np.flatnonzero(np.diff(np.concatenate([[0], zero.astype(int), [0]])))
        begins, ends = edges[::2], edges[1::2]
        within = (begins > 0) & (ends < len(values)) & (ends - begins <= LONGEST)
        begins, ends = begins[within], ends[within]
        before, after = values[begins - 1], values[ends]
        falls = (before * after > 0.0) & (run[begins - 1] == run[ends])
        falls &= np.minimum(np.abs(before), np.abs(after)) > np.maximum(least, BEYOND * np.abs(after - before))
        rows = [row for a, b in zip(begins[falls], ends[falls], strict=True) for row in range(a, b)]
        gaps = int(np.count_nonzero(falls))
        if gaps < FEWEST or len(rows) < SHARE * np.count_nonzero(zero):
            continue
        sentence = (
            f"{name} falls to exactly 0 for a row or two {gaps} times, far from what it reads before and after: "
            "probably a code for a missing reading. Leave these rows out, or empty these cells "
            f"({file_rows(recording, rows)})."
        )
        findings.append(
            Finding(
                "placeholder", Severity.DISTRUST, FoundAt(name, rows=tuple(int(row) for row in rows)), sentence, 0.0
            )
        )
    return findings
