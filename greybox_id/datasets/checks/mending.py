"""Repairs that checks propose, taken one after the other."""

from __future__ import annotations

from collections.abc import Callable, Iterable

from ..column_map import ColumnMap, column_map
from ..recording import Recording
from ..repair import repaired
from . import check

MOST_REPAIRS = 4
"""Repairs that are taken one after the other."""


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
