"""A file's further channels that repeat a signal: do they say the same?"""

from __future__ import annotations

import numpy as np

from ...base.numbers import number, pretty_unit
from ...base.signals import SIGNALS
from ..recording import Recording
from .finding import Finding, FoundAt, Severity, runs_words
from .pairs import agreement, run_agreements

SAME = 0.9
"""From this correlation on, in one run at least, a channel of the same unit is taken for a copy of the signal."""
DIFFERENT = 0.7
"""Below this correlation a run of the copy does not follow the signal."""
GAIN_RANGE = (0.7, 1.4)
"""A copy in the same unit has gain 1; sensors at two places of a vehicle differ by some per cent."""
LEAST_SAMPLES = 5
"""Independent samples below which a run tells nothing."""
LEAST_SPREAD = 0.2
"""Runs in which the signal spreads less than this share of its spread over all runs tell nothing."""


def check_duplicates(recording: Recording) -> list[Finding]:
    """Findings about extra channels that are copies of a signal."""
    findings: list[Finding] = []
    for extra in recording.signals:
        if extra in SIGNALS:
            continue
        for signal in recording.signals:
            if signal in SIGNALS and recording.unit(signal) == recording.unit(extra):
                findings += _compare(recording, extra, signal)
    return findings


def _compare(recording: Recording, extra: str, signal: str) -> list[Finding]:
    spread = _spread(recording, signal, recording.runs)
    parts = run_agreements(recording, recording[extra], recording[signal], 0.2)
    each = {
        number: part
        for number, part in parts.items()
        if part.independent >= LEAST_SAMPLES
        and _spread(recording, signal, (recording.runs[number - 1],)) > LEAST_SPREAD * spread
    }
    whole = agreement(recording, recording[extra], recording[signal], 0.2)
    copies = [a.correlation for a in [*each.values(), whole] if a.beyond_chance and abs(a.correlation) > SAME]
    if not copies:
        return []
    unit = recording.unit(extra)
    findings = []
    turned = [n for n, a in each.items() if a.beyond_chance and a.correlation < 0]
    if whole.beyond_chance and whole.correlation < 0:
        by = number(whole.correlation, 2)
        sentence = f"{extra} is {signal} with the opposite sign (correlation {by}); set its sign = -1."
        findings.append(Finding("sign", Severity.WARNING, FoundAt(extra), sentence, whole.correlation))
    elif turned:
        sentence = f"{extra} has the opposite sign of {signal} in {runs_words(turned)}."
        findings.append(Finding("sign", Severity.WARNING, FoundAt(extra), sentence, float(len(turned))))
    off = [n for n, a in each.items() if abs(a.correlation) < DIFFERENT]
    if off:
        low = min(each[n].correlation for n in off)
        sentence = (
            f"{extra} does not follow {signal} in {runs_words(off)} (correlation down to {number(low, 2)}), "
            "though it does elsewhere: use one of them, not both."
        )
        findings.append(
            Finding("duplicate", Severity.WARNING, FoundAt(extra, off[0] if len(off) == 1 else None), sentence, low)
        )
    scales = {
        n: abs(a.gain) for n, a in each.items() if a.beyond_chance and not GAIN_RANGE[0] < abs(a.gain) < GAIN_RANGE[1]
    }
    if scales:
        worst = max(scales, key=lambda n: abs(np.log(scales[n])))
        sentence = (
            f"{extra} is {number(scales[worst])} times {signal} in {runs_words(scales)}, where 1 is expected: "
            f"check its unit (the column map says {pretty_unit(unit)}) or its calibration."
        )
        findings.append(Finding("unit", Severity.WARNING, FoundAt(extra), sentence, scales[worst]))
    return findings


def _spread(recording: Recording, name: str, runs: tuple[tuple[int, int], ...]) -> float:
    values = np.concatenate([recording[name][start:stop] for start, stop in runs])
    values = values[np.isfinite(values)]
    return float(np.subtract(*np.quantile(values, [0.95, 0.05]))) if values.size else 0.0
