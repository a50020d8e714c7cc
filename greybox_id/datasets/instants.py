"""Columns of time: numbers, counts of nanoseconds since 1970, or dates.

Nanoseconds since 1970 do not fit a float: the start is subtracted in whole numbers first.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from ..errors import BadInput
from ..recording import Array
from .column_map import Column
from .table import Table

EPOCH = 1e8
"""Times beyond this many seconds (three years) count from 1970, not from the start of a recording."""

_DATE = re.compile(r"\s*\d{4}-\d\d-\d\d[T ]\d\d:\d\d")


@dataclass(frozen=True)
class Instants:
    """Times of the rows of a table.

    Attributes
    ----------
    counts : (n,) as the file holds them, whole numbers where it holds such.
    second : seconds in one count.
    """

    counts: NDArray[np.int64] | Array
    second: float

    def since(self, origin: float) -> Array:
        """(n,) seconds since an instant, which is given in counts."""
        return np.asarray((self.counts - origin) * self.second, dtype=float)

    @property
    def first(self) -> int | float:
        """The earliest count; 0 where there is none."""
        finite = self.counts[np.isfinite(self.counts)]
        return finite.min().item() if finite.size else 0


def instants(table: Table, column: Column) -> Instants:
    """The times in a column.

    Raises
    ------
    BadInput
        A cell is neither a number nor a date.
    """
    series = _dates(table.column(column.column), table.where, column.column)
    if pd.api.types.is_datetime64_any_dtype(series.dtype):
        naive = series.dt.tz_convert(None) if series.dt.tz is not None else series
        dates = naive.to_numpy(dtype="datetime64[ns]")
        counts = dates.astype(np.int64)
        missing = np.isnat(dates)
        return Instants(np.where(missing, np.nan, counts) if missing.any() else counts, 1e-9)
    second = float(column.convert(np.ones(1))[0] - column.convert(np.zeros(1))[0])
    whole = pd.api.types.is_integer_dtype(series.dtype) and not series.isna().any()
    if whole and len(series) and series.max() < 2**63:
        return Instants(series.to_numpy(dtype=np.int64), second)
    return Instants(table.numbers(column.column), second)


def origin_of(clocks: Sequence[Instants]) -> tuple[float, str]:
    """The count that time is taken from, and a sentence where that is not the file's own zero."""
    first = min(clock.first for clock in clocks)
    seconds = first * clocks[0].second
    if not abs(seconds) > EPOCH:
        return 0, ""
    try:
        began = f"{datetime.fromtimestamp(seconds, UTC):%Y-%m-%d %H:%M:%S} UTC"
    except (ValueError, OverflowError, OSError):  # a year beyond the calendar
        began = f"{seconds:.6g} s"
    return first, f"time is counted from the file's first instant, {began}."


def _dates(series: pd.Series[Any], where: str, name: str) -> pd.Series[Any]:
    """Text that begins like a date as dates; anything else as it is."""
    if pd.api.types.is_numeric_dtype(series.dtype) or not len(series) or not _DATE.match(str(series.iloc[0])):
        return series
    if pd.api.types.is_datetime64_any_dtype(series.dtype):
        return series
    try:
        return pd.Series(pd.to_datetime(series, format="ISO8601", utc=True))
    except (ValueError, OverflowError, TypeError) as error:
        reason = str(error).splitlines()[0]
        raise BadInput(f'{where}: column "{name}" begins with a date, but not all of it is one: {reason:.120}.') from (
            error
        )
