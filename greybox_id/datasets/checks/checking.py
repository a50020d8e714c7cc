"""All checks of a recording in their order, and the repairs that they propose, taken one after the other."""

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
from .drive import check_asleep, check_drive
from .dropouts import check_dropouts
from .explanations import with_sizes
from .finding import FaultCause, Finding, Severity
from .mapping_faults import check_mapping
from .pairs import pairs
from .repeats import check_repeats
from .values import check_placeholders, check_reading, check_time, check_values, sample_time_believable

MOST_REPAIRS = 4
"""Repairs that are taken one after the other."""

_last: tuple[ref[Recording], float | None, tuple[Finding, ...]] | None = None
"""What was checked last, which a fit of it asks for again; recordings do not change."""


def check(recording: Recording, wheelbase: float | None = None) -> list[Finding]:
    """All that is noteworthy or wrong in a recording, gravest first.

    Parameters
    ----------
    recording : signals in SI units, ISO 8855 signs.
    wheelbase : in m, if known: the steering's unit can then be checked more sharply.

    Returns
    -------
    list of Finding
        Empty if nothing is noteworthy. `distrusted(findings)` tells whether the recording can be used as it is.
    """
    global _last
    if _last is not None and _last[0]() is recording and _last[1] == wheelbase:
        return list(_last[2])
    result = _checked(recording, wheelbase)
    _last = ref(recording), wheelbase, tuple(result)
    return result


def mended(
    read: Callable[[ColumnMap], Iterable[Recording]], columns: str, wheelbase: float | None
) -> tuple[ColumnMap, tuple[str, ...]]:
    """The column map with what checks of some recordings would have changed, one finding after the other, and the
    changes.

    Parameters
    ----------
    read : the recordings as a column map reads them.
    columns : the column map to begin with.
    wheelbase : m, as of `check`.
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
    if sample_time_believable(recording.sample_time):  # false also where no two rows follow each other
        findings += check_drive(recording)
        faults = check_mapping(recording)
        result = pairs(recording)
        findings += [*faults, *check_duplicates(recording), *check_rest(recording)]
        against = check_consistency(recording, result, wheelbase)
        findings += [*_left(recording, faults, against, wheelbase), *check_delays(recording, result)]
        findings = with_sizes(recording, findings)
    if any(item.kind == "short" for item in findings):  # which says why nothing could be checked
        findings = [item for item in findings if item.kind != "unchecked"]
    gravest = list(Severity)[::-1]
    return sorted(findings, key=lambda finding: gravest.index(finding.severity))


def _bridged(recording: Recording, findings: list[Finding]) -> Recording:
    """The recording with values that stand out from their neighbours on straight lines between those."""
    rows, signals = np.arange(len(recording)), dict[str, Array]()
    for finding in (item for item in findings if item.kind == "outlier"):
        values = signals.get(finding.where.channel, recording[finding.where.channel])
        kept = np.isfinite(values)
        kept[list(finding.where.rows)] = False
        signals[finding.where.channel] = np.where(
            np.isin(rows, finding.where.rows), np.interp(rows, rows[kept], values[kept]), values
        )
    return recording.with_signals(**signals)


def _left(
    recording: Recording, faults: list[Finding], findings: list[Finding], wheelbase: float | None
) -> list[Finding]:
    """Findings that are left with the map's fault undone, where others take for granted what it doubts.

    That is the sign of v_x, or a sign of several that are as likely: what names another one beside it would contradict.
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
