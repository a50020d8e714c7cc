"""All checks of a recording in order, and the successive repairs that they propose."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import replace
from weakref import ref

import numpy as np

from ...base.shorthands import Array
from ...base.signals import SD
from ..column_map import ColumnMap, column_map
from ..recording import Recording
from ..repair import repaired
from .consistency import check_consistency, check_duplicates, check_rest
from .delays import check_delays
from .drive import check_asleep, check_drive, check_spins
from .dropouts import check_dropouts
from .explanations import with_sizes
from .finding import FaultCause, Finding, Severity, distrusted
from .mapping_faults import check_mapping
from .pairs import pairs
from .repeats import check_repeats
from .values import check_placeholders, check_reading, check_time, check_values, sample_time_believable

MOST_REPAIRS = 4
"""Largest number of successive repairs."""

_last: tuple[ref[Recording], float | None, tuple[Finding, ...]] | None = None
"""Result of the last check, for a fit of the same recording; recordings are immutable."""


def check(recording: Recording, wheelbase: float | None = None) -> list[Finding]:
    """All findings about a recording, most severe first.

    Parameters
    ----------
    recording : signals in SI units, ISO 8855 signs.
    wheelbase : in m, if known: the steering's unit is then checked more strictly.

    Returns
    -------
    list of Finding
        Empty without findings. `distrusted(findings)` is True if the recording cannot be used as it is.
    """
    global _last
    if _last is not None and _last[0]() is recording and _last[1] == wheelbase:
        return list(_last[2])
    result = _checked(recording, wheelbase)
    _last = ref(recording), wheelbase, tuple(result)
    return result


def doubts(recordings: Iterable[Recording]) -> tuple[str, ...]:
    """What makes recordings unusable, in sentences that begin with their names."""
    return tuple(
        f"{recording.name}: {finding.sentence}"
        for recording in recordings
        for finding in check(recording)
        if finding.severity is Severity.DISTRUST
    )


def mended(
    read: Callable[[ColumnMap], Iterable[Recording]], columns: str, wheelbase: float | None
) -> tuple[ColumnMap, tuple[str, ...]]:
    """The column map after applying the repairs that checks of the recordings propose, one at a time; and the changes.

    Parameters
    ----------
    read : returns the recordings read through a column map.
    columns : the initial column map.
    wheelbase : m, as in `check`.
    """
    mapping, changes = column_map(columns), tuple[str, ...]()
    for _ in range(MOST_REPAIRS):
        result = (repaired(mapping, check(recording, wheelbase)) for recording in read(mapping))
        better = next(filter(None, result), None)
        if better is None:
            break
        mapping, changes = better.mapping, (*changes, *better.changes)
    return mapping, changes


def _checked(recording: Recording, wheelbase: float | None) -> list[Finding]:
    measured = {name: values for name, values in recording.signals.items() if not name.startswith(SD)}
    recording = replace(recording, signals=measured)
    findings = [*check_reading(recording), *check_time(recording), *check_repeats(recording)]
    blank: set[str] = set()
    for finding in (*check_placeholders(recording), *check_dropouts(recording), *check_asleep(recording)):
        names = finding.where.channel.split(", ")
        blanked = {name: recording[name].copy() for name in names}
        for values in blanked.values():
            values[list(finding.where.rows)] = np.nan
        recording, findings, blank = recording.with_signals(**blanked), [*findings, finding], blank | {*names}
    findings += [item for item in check_values(recording) if item.kind != "missing" or item.where.channel not in blank]
    recording = _bridged(recording, findings)
    if sample_time_believable(recording.sample_time):  # False also if no two rows are consecutive
        findings += check_drive(recording)
        faults = check_mapping(recording)
        result = pairs(recording)
        findings += [*faults, *check_duplicates(recording), *check_rest(recording)]
        against = check_consistency(recording, result, wheelbase)
        findings += [*_left(recording, faults, against, wheelbase), *check_delays(recording, result)]
        findings = with_sizes(recording, findings)
        if not distrusted(findings):  # readings of the wrong sign or unit would look like a spin
            findings += check_spins(recording)
    if any(item.kind == "short" for item in findings):  # it already says why nothing could be checked
        findings = [item for item in findings if item.kind != "unchecked"]
    gravest = list(Severity)[::-1]
    return sorted(findings, key=lambda finding: gravest.index(finding.severity))


def _bridged(recording: Recording, findings: list[Finding]) -> Recording:
    """The recording with outlying values replaced by linear interpolation between their neighbours."""
    rows, signals = np.arange(len(recording)), dict[str, Array]()
    for finding in (item for item in findings if item.kind == "outlier"):
        values = signals.get(finding.where.channel, recording[finding.where.channel])
        sound = np.isfinite(values)
        sound[list(finding.where.rows)] = False
        signals[finding.where.channel] = np.where(
            np.isin(rows, finding.where.rows), np.interp(rows, rows[sound], values[sound]), values
        )
    return recording.with_signals(**signals)


def _left(
    recording: Recording, faults: list[Finding], findings: list[Finding], wheelbase: float | None
) -> list[Finding]:
    """Consistency findings that remain after undoing a fault of the map, if they presuppose what the fault puts in
    doubt.

    That is the sign of v_x, or one of several equally likely signs: a finding that blames another sign would contradict
    it.
    """
    fault = next((item for item in faults if item.kind == "mapping" and item.severity is Severity.DISTRUST), None)
    if fault is None or not findings:
        return findings
    repair = fault.repair if fault.repair.get("v_x", ("", 1.0, 0.0))[1] < 0 else {}
    if not fault.repair and FaultCause.SIGN in fault.causes:  # any of them makes the signs agree
        repair = {name: (name, -1.0, 0.0) for name in fault.where.channel.split(", ")}
    if not repair:
        return findings
    undone = recording.with_signals(
        **{name: factor * recording[source] for name, (source, factor, _) in repair.items()}
    )
    left = {(item.kind, item.where) for item in check_consistency(undone, pairs(undone), wheelbase)}
    return [item for item in findings if (item.kind, item.where) in left]
