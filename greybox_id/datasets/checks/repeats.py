"""Rows that were recorded once and are there twice: a file that was appended to itself, or that was held out as well.

Readings scatter: no two rows of a drive are alike in all channels, and no stretch of rows comes again. Where one does,
it was copied.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import numpy as np

from ...base.shorthands import Array, Index, Mask
from ...base.signals import COMMANDS, SD
from ..recording import Recording
from .drive import FEWEST_ROWS
from .finding import Finding, FoundAt, Severity, file_row

ALIKE = 1e-3
"""Of a channel's spread, to which readings are compared: digits that a file has not kept tell no rows apart."""
LARGEST = 2.0**52
"""A number of steps that is counted exactly."""
MOST = 0.5
"""Share of a stretch's rows that must come again: a few lie where rounding makes two of one."""


def check_repeats(recording: Recording) -> list[Finding]:
    """Stretches of rows that came before."""
    names = _compared(recording, recording)
    stretches = sorted(_stretches(recording, recording, names, least=FEWEST_ROWS))
    if not stretches:
        return []
    begin, _, lag = stretches[0]
    rows = np.unique(np.concatenate([np.arange(a, b) for a, b, _ in stretches]))
    sentence = (
        f"{rows.size} of {len(recording)} rows repeat earlier ones; the first is {file_row(recording, begin)}, which "
        f"equals the row {lag} rows before it. Noise never repeats exactly, so the rows were copied: leave the "
        "repeated rows out."
    )
    where = FoundAt(", ".join(names), rows=tuple(rows.tolist()))
    return [Finding("repeated", Severity.WARNING, where, sentence, float(rows.size))]


def seen(recording: Recording, before: Recording) -> float:
    """Share of a recording's rows that are rows of another, whatever both clocks say."""
    found = np.zeros(len(recording), dtype=bool)
    for begin, end, _ in _stretches(recording, before, _compared(recording, before)):
        found[begin:end] = True
    return float(np.mean(found)) if len(found) else 0.0


def _compared(recording: Recording, before: Recording) -> list[str]:
    """Channels that tell rows apart: measured, and moving."""
    return [
        name
        for name, values in before.signals.items()
        if name in recording and name not in COMMANDS and not name.startswith(SD) and _spread(values) > 0.0
    ]


def _spread(values: Array) -> float:
    """Standard deviation of the readings that are finite; zero where there is none, or numbers do not hold it."""
    known = values[np.isfinite(values)]
    with np.errstate(over="ignore", invalid="ignore"):
        result = float(np.std(known)) if known.size else 0.0
    return result if np.isfinite(result) else 0.0


def _stretches(
    recording: Recording, before: Recording, names: list[str], least: int | None = None
) -> Iterator[tuple[int, int, int]]:
    """First row, row after the last, and how many rows later they come than in the other, or than before in their own.

    A row is looked for where the other has it first; `least` rows later at least, if that is said.
    """
    if len(names) < 2 or min(len(recording), len(before)) < FEWEST_ROWS:
        return
    units = {name: ALIKE * _spread(before[name]) for name in names}
    known, wanted = (_keys(one, units) for one in (before, recording))
    keys, first = np.unique(known[0], return_index=True)
    place = np.minimum(np.searchsorted(keys, wanted[0]), len(keys) - 1)
    alike = (keys[place] == wanted[0]) & wanted[1] & known[1][first[place]]
    rows = np.flatnonzero(alike)
    lags = rows - first[place[rows]]
    if least is not None:
        rows, lags = rows[lags >= least], lags[lags >= least]
    order = np.lexsort((rows, lags))
    rows, lags = rows[order], lags[order]
    # a stretch ends where as many rows as make one do not come again
    cuts = np.flatnonzero((np.diff(lags) != 0) | (np.diff(rows) > FEWEST_ROWS)) + 1
    edges = np.concatenate([[0], cuts, [len(rows)]])
    for a in np.flatnonzero(np.diff(edges) >= FEWEST_ROWS):
        piece = rows[edges[a] : edges[a + 1]]
        begin, end = int(piece[0]), int(piece[-1]) + 1
        if len(piece) >= MOST * (end - begin):
            yield begin, end, int(lags[edges[a]])


def _keys(recording: Recording, units: Mapping[str, float]) -> tuple[Index, Mask]:
    """(N,) an integer for each row, the same for rows alike; and whether the row has all its readings."""
    odd = np.random.default_rng(0)
    keys, whole = np.zeros(len(recording), dtype=np.int64), np.ones(len(recording), dtype=bool)
    for name, unit in units.items():
        steps = recording[name] / unit
        here = np.abs(steps) < LARGEST
        keys += np.round(np.where(here, steps, 0.0)).astype(np.int64) * odd.integers(2**62, dtype=np.int64)
        whole &= here
    return keys, whole
