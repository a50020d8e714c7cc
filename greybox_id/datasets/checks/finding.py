"""What a check has to say about a recording."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from enum import Enum

import numpy as np

from ...base.condition import LONGEST
from ..recording import Recording

MEANINGLESS = ("stuck", "asleep", "outlier", "placeholder")
"""Findings whose rows are to be left out."""
MOST = 0.5
"""Share of rows that leaving some out may cost."""


class Severity(Enum):
    """How much a finding matters, mildest first.

    Examples
    --------
    >>> import greybox_id as gb
    >>> [own.value for own in gb.datasets.checks.Severity]
    ['note', 'warning', 'distrust']
    """

    NOTE = "note"
    """Good to know; nothing need be done."""
    WARNING = "warning"
    """A fit can live with it, but should be told: a join, an offset, a held channel."""
    DISTRUST = "distrust"
    """Results from this recording mean nothing until it is mended."""


class FaultCause(Enum):
    """What a column map may have wrong, as far as other checks take it into account."""

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
    rows : rows of the recording concerned, counted from 0; empty where the finding is about no row in particular.
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
    value, uncertainty, unit : the number the finding rests on, its standard uncertainty (None if it has none, as for
        a count) and unit.
    repair : signal (or time) -> the signal whose column holds it, and the factor and the offset (in SI units, added
        afterwards) that put that right; empty where the column map cannot mend what was found.
    causes : of a fault of the column map, what it may be.

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
    """Whether one of the findings forbids trusting the recording."""
    return any(finding.severity is Severity.DISTRUST for finding in findings)


def condition_without(recording: Recording, findings: Iterable[Finding]) -> str:
    """The condition of `Recording.where` that leaves out the rows that findings would have left out.

    It is empty where no finding would, where time does not run on or too little would be left, and where it would be
    too long.
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
    """A fault of some size.

    Attributes
    ----------
    sentence : what it is, and what to do.
    channel : signal concerned, or signals: "a_x, a_y".
    value, error, unit : its size.
    gain : how much of the conflict it explains, in squared standard errors.
    witnessed : whether another channel says so, too; else the recording may be used, with that doubt.
    sign, offset : what the channel is to be multiplied by, and what is then to be added, in its SI unit; an offset of
        None says that the map has no remedy.
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
    """A row of the recording in the words of its file: "row 700 of the file", header line counted."""
    source = recording.source
    return f"row {row + (source.first_row or 1)} of the file" if source.path else f"row {row}, counted from 0"


def listed(items: Iterable[str], at_most: int = 6) -> str:
    """Words in a row, cut short: "a, b, c and 4 more"."""
    words = list(items)
    if len(words) > at_most:
        return f"{', '.join(words[:at_most])} and {len(words) - at_most} more"
    return " and ".join(filter(None, [", ".join(words[:-1]), *words[-1:]]))


def file_rows(recording: Recording, rows: Iterable[int]) -> str:
    """Rows in the words of the file: "rows 700 and 2084 of the file"."""
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
