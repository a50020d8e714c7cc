"""Columns of time: numbers, counts of nanoseconds since 1970, or dates.

Nanoseconds since 1970 do not fit a float: the start is subtracted in whole numbers first.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from fractions import Fraction
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from ..base.errors import BadInput
from ..base.shorthands import Array
from .column_map import Column
from .formats.contents import RawTable

EPOCH = 1e8
"""Times beyond this many seconds (three years) count from 1970, not from the start of a recording."""

LATEST = 9e9
"""Seconds since 1970 whose nanoseconds a whole number of 64 bits holds."""

EPOCHS = (("ns", 1e17), ("us", 1e14), ("ms", 1e11), ("s", 1e8))
"""Counts since 1970, by unit: today's are larger than this."""
_DATE = re.compile(r"\s*\d{4}-\d\d-\d\d[T ]\d\d:\d\d")
_CLOCK = re.compile(r"\s*(?:(\d+):)?(\d+):(\d\d(?:[.,]\d+)?)\s*")
"""Minutes and seconds, or hours as well."""


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

    def since(self, origin: Fraction) -> Array:
        """(n,) seconds since an instant, s."""
        count = origin / self.exact_second
        whole = np.issubdtype(self.counts.dtype, np.integer) and count.denominator == 1
        return np.asarray((self.counts - (int(count) if whole else float(count))) * self.second, dtype=float)

    @property
    def exact_second(self) -> Fraction:
        """Seconds in one count, without the digits that a float of it lacks."""
        return Fraction(self.second).limit_denominator(10**12)

    @property
    def first(self) -> int | float:
        """The earliest count; 0 where there is none."""
        finite = self.counts[np.isfinite(self.counts)]
        return finite.min().item() if finite.size else 0


def instants(table: RawTable, column: Column) -> Instants:
    """The times in a column.

    Raises
    ------
    BadInput
        A cell is neither a number nor a date.
    """
    series = _dates(table.column(column.column), table.where, column.column)
    if _on_a_clock(series):
        return Instants(_of_clock(series, table.where, column.column), 1.0)
    if pd.api.types.is_datetime64_any_dtype(series.dtype):
        naive = series.dt.tz_convert(None) if series.dt.tz is not None else series
        dates = naive.to_numpy(dtype="datetime64[ns]")
        counts = dates.astype(np.int64)
        missing = np.isnat(dates)
        return Instants(np.where(missing, np.nan, counts) if missing.any() else counts, 1e-9)
    if column.nanoseconds:
        return _split(table, column)
    second = float(column.convert(np.ones(1))[0] - column.convert(np.zeros(1))[0])
    whole = pd.api.types.is_integer_dtype(series.dtype) and not series.isna().any()
    if whole and len(series) and series.max() < 2**63:
        return Instants(series.to_numpy(dtype=np.int64), second)
    return Instants(table.numbers(column.column), second)


def is_instants(series: pd.Series[Any]) -> bool:
    """Whether a column holds dates, or times of a clock, as text."""
    if pd.api.types.is_datetime64_any_dtype(series.dtype):
        return True
    text = not pd.api.types.is_numeric_dtype(series.dtype) and len(series) > 0
    return (text and bool(_DATE.match(str(series.iloc[0])))) or _on_a_clock(series)


def count_unit(series: pd.Series[Any]) -> str:
    """The unit of counts since 1970, by their size; "s" for any other."""
    if not pd.api.types.is_numeric_dtype(series.dtype) or not len(series):
        return "s"
    largest = float(series.abs().max())
    return next((unit for unit, size in EPOCHS if largest > size), "s")


def _on_a_clock(series: pd.Series[Any]) -> bool:
    """Whether a column begins as 10:01:45.25 or 1:45.25."""
    return (
        len(series) > 0
        and not pd.api.types.is_numeric_dtype(series.dtype)
        and not pd.api.types.is_datetime64_any_dtype(series.dtype)
        and bool(_CLOCK.fullmatch(str(series.iloc[0])))
    )


def _of_clock(series: pd.Series[Any], where: str, name: str) -> Array:
    """Seconds of a clock's readings; NaN where a cell is empty."""
    parts = series.astype("string").str.extract(_CLOCK.pattern + "$")
    strange = parts[2].isna().to_numpy() & series.notna().to_numpy()
    if strange.any():
        cell = str(series.iloc[int(np.argmax(strange))])
        raise BadInput(f'{where}: column "{name}" begins with clock times, but {cell!r:.40} is not one. Mend it.')
    hours, minutes, seconds = (
        pd.to_numeric(parts[k].str.replace(",", "."), errors="coerce").to_numpy(dtype=float, na_value=np.nan)
        for k in range(3)
    )
    return np.asarray(3600 * np.nan_to_num(hours) + 60 * minutes + seconds)


def _split(table: RawTable, column: Column) -> Instants:
    """Seconds and nanoseconds in columns of their own, as whole nanoseconds."""
    whole, rest = table.numbers(column.column), table.numbers(column.nanoseconds)
    known = np.isfinite(whole) & np.isfinite(rest) & (np.abs(whole) < LATEST) & (np.abs(rest) < LATEST)
    seconds = np.where(known, whole, 0.0).astype(np.int64)
    counts = seconds * 10**9 + np.where(known, rest, 0.0).astype(np.int64)
    return Instants(counts if known.all() else np.where(known, counts, np.nan), 1e-9)


def origin_of(clocks: Sequence[Instants]) -> tuple[Fraction, str]:
    """The instant that time is taken from, s, and a sentence where that is not the file's own zero."""
    origin = min(Fraction(clock.first) * clock.exact_second for clock in clocks)
    seconds = float(origin)
    if not abs(seconds) > EPOCH:
        return Fraction(0), ""
    try:
        began = f"{datetime.fromtimestamp(seconds, UTC):%Y-%m-%d %H:%M:%S} UTC"
    except (ValueError, OverflowError, OSError):  # a year beyond the calendar
        began = f"{seconds:.6g} s"
    return origin, f"time is counted from the file's first instant, {began}."


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
