"""Sections of a report on the data: how the files were read, findings of the checks, and range of the samples."""

from __future__ import annotations

import re
from collections.abc import Sequence

import numpy as np

from ..base.errors import BadInput
from ..base.numbers import counted, number, percent, pretty_unit, raised, signal_words
from ..base.shorthands import Array
from ..base.signals import unit_of
from ..datasets.checks import Finding, check
from ..datasets.column_map import Column, carried_map, column_map
from ..datasets.recording import Recording
from .document import Drawing, Part, Points, Table, Text, titled
from .figures.characteristics import excitation
from .recordings import Seen, of_role

MOST_FINDINGS = 6
"""Most findings that are listed per recording; the others are counted."""
MOST_ROWS = 12_000
"""Rows of a recording that are checked; of a longer one, those up to the end of the run that contains this row."""
WITHIN = (0.005, 0.995)
"""Quantiles that bound the range in which a model counts as trained."""


def data_parts(recordings: Sequence[Seen], signals: Sequence[str]) -> tuple[Part, ...]:
    """The section on the data.

    Parameters
    ----------
    recordings : those of a fit.
    signals : inputs and outputs of its model.
    """
    data = [one.recording for one in recordings]
    where = Drawing(
        "excitation",
        excitation(recordings),
        "Distribution of the samples over speed and lateral acceleration. In regions without samples, the model "
        "extrapolates.",
        "Maps of the samples over speed and lateral acceleration, training and validation.",
    )
    return titled("Data", applied(data, signals), *_findings(data), where)


def limits(recordings: Sequence[Seen], signals: Sequence[str]) -> tuple[Part, ...]:
    """Where the model is valid: range of each signal in training, and share of the validation samples outside it."""
    rows = []
    for name in signals:
        trained, judged = (_values(of_role(recordings, role), name) for role in ("train", "validate"))
        if not len(trained):
            continue
        low, high = np.quantile(trained, WITHIN)
        beyond = float(np.mean((judged < low) | (judged > high))) if len(judged) else float("nan")
        cells = [
            f"{number(float(np.min(item)))} to {number(float(np.max(item)))}" if len(item) else "–"
            for item in (trained, judged)
        ]
        unit = pretty_unit(unit_of(name))
        rows.append(
            (signal_words(name), unit, f"{number(float(low))} to {number(float(high))}", *cells, percent(beyond))
        )
    head = ("signal", "unit", "99 % of training", "all of training", "all of validation", "beyond")
    words = (
        "Ranges hold 99 % of each training signal. Outside these ranges the model extrapolates, and its intervals do "
        "not hold. Even inside the ranges, a combination of signals may not have been driven: see the map of the "
        "data. Beyond: share of the validation samples outside the range."
    )
    return titled("Limits of validity", Table(head, tuple(rows), "Llrrrr"), Text(words if rows else ""))


def applied(recordings: Sequence[Recording], signals: Sequence[str]) -> Table:
    """The signal of each column, with unit, scale, sign and offset."""
    rows: dict[tuple[str, ...], None] = {}
    for recording in recordings:
        for column in _columns(recording):
            if column.signal in recording and column.signal in signals:
                rows[_row(column)] = None
    head = ("signal", "column", "unit in the file", "scale", "sign", "offset", "unit here")
    return Table(head, tuple(rows), "lLlrrrl")


def _row(column: Column) -> tuple[str, ...]:
    offset = f"{number(column.offset)} {pretty_unit(column.si_unit)}" if column.offset else "0"
    return (
        signal_words(column.signal), column.column, pretty_unit(column.unit), number(column.scale, 4),
        "−" if column.sign < 0 else "+", offset, pretty_unit(column.si_unit),
    )  # fmt: skip


def _columns(recording: Recording) -> tuple[Column, ...]:
    """The column map that a recording was read with; empty if it no longer exists."""
    try:
        source = recording.source
        return column_map(carried_map(source.columns, source.column_map)).channels if source.columns else ()
    except BadInput:
        return ()


def _findings(recordings: Sequence[Recording]) -> list[Part]:
    """Findings of the data checks, a list per recording."""
    parts: list[Part] = []
    for recording in recordings:
        stop = next((end for _, end in recording.runs if end >= MOST_ROWS), len(recording))
        complete = stop == len(recording)
        findings = check(recording if complete else recording.rows(0, stop))
        part = "" if complete else f" (checked up to row {stop})"
        if not findings:
            parts.append(Text("nothing noteworthy was found.", lead=f"{recording.name}{part}:"))
            continue
        more = len(findings) - MOST_FINDINGS
        items = [_said(item) for item in findings[:MOST_FINDINGS]]
        if more > 0:
            items.append(f"and {counted(more, 'finding')} more; greybox data check lists all.")
        parts += [Text("", lead=f"Findings in recording {recording.name}{part}"), Points(tuple(items))]
    return parts


def _said(finding: Finding) -> str:
    words = {"distrust": "Not to be trusted: ", "warning": "", "note": ""}[finding.severity.value]
    return words + re.sub(r"(?<![\w.])-(?=\d)", "−", raised(finding.sentence))


def _values(recordings: Sequence[Seen], name: str) -> Array:
    parts = [one.recording[name] for one in recordings if name in one.recording]
    values = np.concatenate([np.empty(0), *parts])
    return np.asarray(values[np.isfinite(values)])
