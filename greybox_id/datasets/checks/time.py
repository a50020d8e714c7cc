"""Is the clock to be trusted: joins, gaps, time running backwards or standing still, irregular sampling."""

from __future__ import annotations

import numpy as np

from ...base.numbers import exact, number
from ..recording import Recording
from .finding import Finding, FoundAt, Severity, file_row, file_rows, runs_words

RESTART_SECONDS = 1.0
"""Time that falls by less than this, and by fewer than RESTART_SAMPLES, is no new recording: rows are out of order."""
RESTART_SAMPLES = 20
JITTER_SHARE = 0.05
"""Steps that scatter by more than 5 % of the usual step blur delays by as much."""
BROKEN_SHARE = 0.02
"""Joins at more than 2 % of the rows leave runs of under 50 rows: that is irregular sampling, not joined recordings."""

STEPS = (5e-5, 2.0)
"""s between rows of a vehicle's recording: 20 kHz to one reading in two seconds, from which no motion is told."""
UNITS = (("ms", 1e-3), ("us", 1e-6), ("ns", 1e-9), ("min", 60.0), ("h", 3600.0), ("day", 86_400.0))
"""What time may be in where it is called seconds, in s."""
USUAL_STEPS, MIDDLE_STEP = (0.5e-3, 1.0), 0.02
"""s; the unit that gives such a step is named, of several the one whose step is nearest to the middle."""


def sample_time_believable(step: float) -> bool:
    """Whether a vehicle's motion may have been recorded with such a step, s."""
    return bool(STEPS[0] <= step <= STEPS[1])


def check_time(recording: Recording) -> list[Finding]:
    """Findings about the time column."""
    time, dt = recording.time, recording.sample_time
    findings: list[Finding] = []
    missing = np.flatnonzero(~np.isfinite(time))
    if missing.size:
        sentence = f"time is missing or not finite in {missing.size} rows ({file_rows(recording, missing)})."
        findings.append(_clock("missing", Severity.DISTRUST, sentence, missing, float(missing.size)))
    if not np.isfinite(dt) or dt <= 0:
        sentence = "time never increases from one row to the next; check which column holds it."
        return [*findings, _clock("still", Severity.DISTRUST, sentence, np.arange(0))]
    if not sample_time_believable(dt):
        believable = {item: dt * size for item, size in UNITS if USUAL_STEPS[0] <= dt * size <= USUAL_STEPS[1]}
        likely = min(believable, key=lambda item: abs(np.log(believable[item] / MIDDLE_STEP)), default="")
        remedy = f'as if it were in {likely}: set unit = "{likely}"' if likely else "check its unit"
        sentence = (
            f"time steps by {exact(dt)} s from row to row ({exact(1 / dt)} Hz), a rate at which no vehicle's motion is "
            f"recorded; {remedy} under [time] in the column map."
        )
        findings.append(Finding("time_scale", Severity.DISTRUST, FoundAt("time"), sentence, dt, None, "s"))
    starts = [] if recording.source.where else [start for start, _ in recording.runs[1:]]  # a part's gaps are asked for
    steps = {row: float(time[row] - time[row - 1]) for row in starts if np.isfinite(time[row - 1 : row + 1]).all()}
    still = [row for row, step in steps.items() if step == 0]
    disordered = [r for r, s in steps.items() if s < 0 and -s < RESTART_SECONDS and -s < RESTART_SAMPLES * dt]
    gaps = [row for row, step in steps.items() if step > 1.5 * dt]
    joins = [row for row in steps if row not in {*still, *disordered, *gaps}]
    if still:
        severity = Severity.DISTRUST if len(still) > BROKEN_SHARE * len(recording) else Severity.WARNING
        sentence = f"time stands still at {file_rows(recording, still)}; remove the doubled rows."
        findings.append(_clock("still", severity, sentence, still, float(len(still))))
    if disordered:
        back = max(-steps[row] for row in disordered)
        sentence = (
            f"time runs backwards by up to {number(back)} s at {file_rows(recording, disordered)}, too little for a "
            "new recording: rows are out of order. Sort them, or write the file again."
        )
        findings.append(_clock("backwards", Severity.DISTRUST, sentence, disordered, back, "s"))
    if gaps and len(gaps) <= BROKEN_SHARE * len(recording):
        longest = max(gaps, key=lambda row: steps[row])
        sentence = (
            f"time jumps ahead at {file_rows(recording, gaps)}; the longest gap is {number(steps[longest])} s "
            f"(usual step {exact(dt)} s). Each begins a new run."
        )
        findings.append(_clock("gap", Severity.WARNING, sentence, gaps, steps[longest], "s"))
    if len(starts) > BROKEN_SHARE * len(recording):
        sentence = (
            f"sampling is irregular: {len(starts)} of {len(recording)} rows do not follow the one before in the usual "
            f"step of {exact(dt)} s. Export it again with its true clock, or resample it with greybox data convert."
        )
        findings.append(_clock("irregular", Severity.DISTRUST, sentence, starts, len(starts) / len(recording)))
    elif joins:
        findings.append(_joins(recording, joins, steps))
    return findings + _jitter(recording, dt)


def _joins(recording: Recording, joins: list[int], steps: dict[int, float]) -> Finding:
    restarts = [row for row in joins if steps[row] < 0]
    what = "time restarts" if restarts else "a new run begins"
    if len(joins) == 1:
        place = f"at {file_row(recording, joins[0])}"
    elif len(joins) <= 12:
        place = f"at {file_rows(recording, joins)}"
    else:
        place = f"at {len(joins)} places"
    sentence = f"several recordings are joined: {what} {place}. No window may run across a join."
    severity = Severity.WARNING if restarts else Severity.NOTE
    return _clock("join", severity, sentence, joins, float(len(joins)))


def _jitter(recording: Recording, dt: float) -> list[Finding]:
    result = {}
    for run, (start, stop) in enumerate(recording.runs, 1):
        if stop - start > 10:
            scatter = float(np.std(np.diff(recording.time[start:stop]))) / dt
            if scatter > JITTER_SHARE:
                result[run] = scatter
    if not result:
        return []
    worst = max(result, key=lambda run: result[run])
    sentence = (
        f"the step of time scatters by {100 * result[worst]:.0f} % of {exact(dt)} s in run {worst}"
        f"{f' (also in {runs_words(n for n in result if n != worst)})' if len(result) > 1 else ''}: "
        "delays cannot be told more finely than that."
    )
    return [Finding("jitter", Severity.WARNING, FoundAt("time", worst), sentence, result[worst])]


def _clock(
    kind: str, severity: Severity, sentence: str, rows: object, value: float | None = None, unit: str = "1"
) -> Finding:
    return Finding(
        kind, severity, FoundAt("time", rows=tuple(np.asarray(rows, dtype=int).tolist())), sentence, value, unit=unit
    )
