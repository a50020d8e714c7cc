"""Findings: what a check reports about a recording."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from enum import Enum

import numpy as np

from ...base.condition import LONGEST
from ..recording import Recording

MEANINGLESS = ("stuck", "asleep", "outlier", "placeholder")
"""Kinds of findings whose rows should be left out."""
MOST = 0.5
"""Largest share of rows that may be left out."""


class Severity(Enum):
    """How much a finding matters, mildest first.

    Examples
    --------
    >>> import greybox_id as gb
    >>> [own.value for own in gb.datasets.checks.Severity]
    ['note', 'warning', 'distrust']
    """

    NOTE = "note"
    """Information; nothing needs to be done."""
    WARNING = "warning"
    """A fit is possible, but should take it into account: a join, an offset, a held channel."""
    DISTRUST = "distrust"
    """Results from this recording are meaningless until it is corrected."""


class FaultCause(Enum):
    """Category of a column map fault, for other checks that take it into account."""

    SIGN = "wrong sign"
    TURN = "IMU turned by 90°"
    STRANGER = "another signal"


@dataclass(frozen=True)
class FoundAt:
    """The place of a finding.

    Attributes
    ----------
    channel : signal or channels concerned, "time" for the clock.
    run : number of the run, counted from 1; None for the whole recording.
    rows : rows of the recording concerned, counted from 0; empty if no particular rows are concerned.
    """

    channel: str
    run: int | None = None
    rows: tuple[int, ...] = ()


@dataclass(frozen=True)
class Finding:
    """One thing that is noteworthy or wrong in a recording.

    Attributes
    ----------
    kind : short slug, for programs: "join", "delay", "sign", ...
    severity : how much it matters.
    where : channel, run and rows.
    sentence : for people, with numbers and units.
    value, uncertainty, unit : the number on which the finding rests, its standard uncertainty (None if it has none,
        such as a count) and unit.
    repair : signal (or time) -> (signal whose column holds it, factor, offset in SI units added afterwards); empty if
        the column map cannot correct the fault.
    causes : possible causes in the column map.

    Examples
    --------
    >>> import greybox_id as gb
    >>> lap = gb.Recording("lap", time=[0.0, 0.1, 0.2, 0.9, 1.0], signals={"v_x": [3.0, 3.1, 3.2, 3.9, 4.0]})
    >>> [finding.severity.value for finding in gb.check(lap)][0]
    'distrust'
    """

    kind: str
    severity: Severity
    where: FoundAt
    sentence: str
    value: float | None = None
    uncertainty: float | None = None
    unit: str = "1"
    repair: Mapping[str, tuple[str, float, float]] = field(default_factory=dict)
    causes: frozenset[FaultCause] = frozenset()


def distrusted(findings: Iterable[Finding]) -> bool:
    """Whether one of the findings makes the recording unusable."""
    return any(finding.severity is Severity.DISTRUST for finding in findings)


def condition_without(recording: Recording, findings: Iterable[Finding]) -> str:
    """The condition for `Recording.where` that leaves out the rows of `MEANINGLESS` findings.

    Empty if there are no such rows, if time is not increasing or too few rows would remain, or if the condition would
    be too long.
    """
    rows = np.zeros(len(recording) + 2, dtype=int)
    for finding in findings:
        if finding.kind in MEANINGLESS:
            rows[np.array(finding.where.rows, dtype=int) + 1] = 1
    time = recording.time
    if not rows.any() or np.mean(rows) > MOST or not np.all(np.diff(time) > 0):
        return ""
    parts = []
    for first, after in np.flatnonzero(np.diff(rows)).reshape(-1, 2):
        before = f"time < {(time[first - 1] + time[first]) / 2:.9g}" if first > 0 else ""
        behind = f"time > {(time[after - 1] + time[after]) / 2:.9g}" if after < len(time) else ""
        parts.append(f"({before} or {behind})" if before and behind else before or behind)
    asked = [f"({recording.source.where})"] if recording.source.where else []
    result = " and ".join([*asked, *parts])
    return result if len(result) <= LONGEST else ""


@dataclass(frozen=True)
class Explanation:
    """A fault with a size.

    Attributes
    ----------
    sentence : the fault, and what to do about it.
    channel : signal concerned, or signals: "a_x, a_y".
    value, error, unit : size of the fault and its standard error.
    gain : how much of the conflict it explains, in squared standard errors.
    witnessed : whether another channel confirms it; if not, the recording may be used with this doubt.
    sign, offset : correction of the channel: factor, then offset in its SI unit; an offset of None means that the map
        cannot correct it.
    """

    sentence: str
    channel: str
    value: float
    error: float
    unit: str
    gain: float
    witnessed: bool = True
    offset: float | None = None
    sign: int = 1


def file_row(recording: Recording, row: int) -> str:
    """A row of the recording as a row of its file: "row 700 of the file", counting the header line."""
    source = recording.source
    return f"row {row + (source.first_row or 1)} of the file" if source.path else f"row {row}, counted from 0"


def listed(items: Iterable[str], at_most: int = 6) -> str:
    """A list in words, shortened: "a, b, c and 4 more"."""
    words = list(items)
    if len(words) > at_most:
        return f"{', '.join(words[:at_most])} and {len(words) - at_most} more"
    return " and ".join(filter(None, [", ".join(words[:-1]), *words[-1:]]))


def file_rows(recording: Recording, rows: Iterable[int]) -> str:
    """Rows of the recording as rows of its file: "rows 700 and 2084 of the file"."""
    numbers = [int(row) for row in rows]
    if len(numbers) == 1:
        return file_row(recording, numbers[0])
    first = file_row(recording, 0)
    start = int(first.split()[1].rstrip(","))
    return f"rows {listed(str(n + start) for n in numbers)}{first.removeprefix(f'row {start}')}"


def runs_words(numbers: Iterable[int]) -> str:
    """Run numbers as words: "run 3", "runs 2, 5 and 7"."""
    runs = [str(n) for n in numbers]
    return f"run {runs[0]}" if len(runs) == 1 else f"runs {listed(runs, 12)}"
