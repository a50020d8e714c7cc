"""Duplicated rows: a file that was appended to itself, or training rows that are also held out.

Noisy readings never repeat in all channels, so a repeated stretch of rows was copied.
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
"""Resolution of the comparison, as a share of a channel's spread: rounding in files must not hide a repetition."""
LARGEST = 2.0**52
"""Largest number of steps that is an exact integer."""
MOST = 0.5
"""Share of a stretch's rows that must repeat: rounding to a key separates a few equal rows."""


def check_repeats(recording: Recording) -> list[Finding]:
    """A finding about stretches of rows that repeat earlier ones."""
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
    """Share of a recording's rows that also occur in another recording, whatever the clocks."""
    found = np.zeros(len(recording), dtype=bool)
    for begin, end, _ in _stretches(recording, before, _compared(recording, before)):
        found[begin:end] = True
    return float(np.mean(found)) if len(found) else 0.0


def _compared(recording: Recording, before: Recording) -> list[str]:
    """Channels by which rows are compared: measured ones that vary."""
    return [
        name
        for name, values in before.signals.items()
        if name in recording and name not in COMMANDS and not name.startswith(SD) and _spread(values) > 0.0
    ]


def _spread(values: Array) -> float:
    """Standard deviation of the finite readings; zero if there is none or it overflows."""
    known = values[np.isfinite(values)]
    with np.errstate(over="ignore", invalid="ignore"):
        result = float(np.std(known)) if known.size else 0.0
    return result if np.isfinite(result) else 0.0


def _stretches(
    recording: Recording, before: Recording, names: list[str], least: int | None = None
) -> Iterator[tuple[int, int, int]]:
    """(first row, row after the last, lag) of stretches that repeat rows of `before`, each matched to its first
    occurrence.

    With `least`, only lags of at least that many rows count, as needed within a single recording.
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
    # a stretch ends at FEWEST_ROWS rows without a repetition
    cuts = np.flatnonzero((np.diff(lags) != 0) | (np.diff(rows) > FEWEST_ROWS)) + 1
    edges = np.concatenate([[0], cuts, [len(rows)]])
    for a in np.flatnonzero(np.diff(edges) >= FEWEST_ROWS):
        piece = rows[edges[a] : edges[a + 1]]
        begin, end = int(piece[0]), int(piece[-1]) + 1
        if len(piece) >= MOST * (end - begin):
            yield begin, end, int(lags[edges[a]])


def _keys(recording: Recording, units: Mapping[str, float]) -> tuple[Index, Mask]:
    """(N,) an integer key for each row, equal for equal rows; and whether all readings of the row are valid."""
    odd = np.random.default_rng(0)
    keys, whole = np.zeros(len(recording), dtype=np.int64), np.ones(len(recording), dtype=bool)
    for name, unit in units.items():
        steps = recording[name] / unit
        here = np.abs(steps) < LARGEST
        keys += np.round(np.where(here, steps, 0.0)).astype(np.int64) * odd.integers(2**62, dtype=np.int64)
        whole &= here
    return keys, whole
