"""Time columns: numbers, counts of nanoseconds since 1970, or dates; and true times of rows with uneven stamps.

Nanoseconds since 1970 do not fit a float, so the start is subtracted in integers first. Rows that were sampled evenly
but stamped on receipt get times from a regression on the row number; rows with true stamps are resampled to an even
grid.

Many loggers stamp rows on receipt: alternating 8 and 2 ms apart, or eight rows of one USB packet at once, although the
rows were sampled evenly. Others write a row whenever one of several sensors has a reading; their stamps are true. The
values decide between the two: if a stamp is d ahead of the row's place in an even grid, a value read at its stamp
deviates from its smoothed neighbours by slope · d, a value sampled evenly does not.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from fractions import Fraction
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from ..base.errors import BadInput
from ..base.numbers import exact
from ..base.shorthands import Array, Mask
from ..base.signals import COMMANDS
from .clocks import LINEAR_GAP, REGULAR, held, linear
from .column_map import Column
from .raw_table import RawTable
from .recording import JITTER_TOLERANCE, Resampled

EPOCH = 1e8
"""Times beyond this many seconds (three years) count from 1970, not from the start of a recording."""

LATEST = 9e9
"""Seconds since 1970 up to which nanoseconds fit an integer of 64 bits."""

EPOCHS = (("ns", 1e17), ("us", 1e14), ("ms", 1e11), ("s", 1e8))
"""(unit, size): counts since 1970 in this unit are larger than this size today."""
_ISO = re.compile(r"\s*\d{4}-\d\d-\d\d[T ]\d\d:\d\d")
_DATE = re.compile(
    r"\s*(?:\d{4}[-/.]\d\d?[-/.]\d\d?|\d\d?[-/.]\d\d?[-/.]\d{4}|\d\d?[- ][A-Za-z]{3}[- ]\d{4}|\d{8})[T ,]+\d\d?:?\d\d"
)
_CLOCK = re.compile(r"\s*(?:(\d+) days? )?(?:(\d+):)?(\d+):(\d\d(?:[.,]\d+)?)(?::(\d{3}))?\s*([AaPp][Mm])?\s*")
"""Clock time: minutes and seconds, optionally hours, days, milliseconds after a colon, am or pm."""
DAY = 86_400.0
SERIAL, SERIAL_1970 = (2e4, 8e4), 25_569.0
"""Range of spreadsheet dates (days since 1899-12-30) of recordings (1954 to 2119), and the first day of 1970."""
COUNTERS = (8, 10, 12, 16, 20, 24, 32)
"""Bits of counters at whose overflow time may wrap, and ..."""
CLOCKS = (1.0, 60.0, 3600.0, DAY, 7 * DAY)
"""... periods in s after which clocks wrap."""
MISSED = 5.0
"""Usual steps that may be missing where a clock wraps."""
REST = {"ns": 1, "us": 1_000, "ms": 1_000_000}
"""Units of the fraction of a second in a separate column: nanoseconds in one."""


@dataclass(frozen=True)
class Instants:
    """Times of the rows of a table.

    Attributes
    ----------
    counts : (n,) as in the file; integers if the file has integers.
    second : seconds per count.
    note : how the times were interpreted, as a sentence; empty if there is nothing to report.
    """

    counts: NDArray[np.int64] | Array
    second: float
    note: str = ""

    def since(self, origin: Fraction) -> Array:
        """(n,) seconds since an instant, s."""
        count = origin / self.exact_second
        whole = np.issubdtype(self.counts.dtype, np.integer) and count.denominator == 1
        return np.asarray((self.counts - (int(count) if whole else float(count))) * self.second, dtype=float)

    @property
    def exact_second(self) -> Fraction:
        """Seconds per count as a fraction, without the rounding error of the float."""
        return Fraction(self.second).limit_denominator(10**12)

    @property
    def first(self) -> int | float:
        """The earliest count; 0 if there is none."""
        finite = self.counts[np.isfinite(self.counts)]
        return finite.min().item() if finite.size else 0


def instants(table: RawTable, column: Column, labels: Sequence[str] = ()) -> Instants:
    """The times in a column; `labels` state the run of every row, if known.

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
    if column.rest:
        return _split(table, column)
    second = float(column.convert(np.ones(1))[0] - column.convert(np.zeros(1))[0])
    whole = pd.api.types.is_integer_dtype(series.dtype) and not series.isna().any()
    if whole and len(series) and series.max() < 2**63:
        return _run_on(series.to_numpy(dtype=np.int64), second, labels)
    return _run_on(table.numbers(column.column), second, labels)


def _run_on(counts: NDArray[Any], second: float, labels: Sequence[str]) -> Instants:
    """Numeric times: HHMMSS converted to seconds, spreadsheet dates to days since 1970, wrapped counters continued."""
    if len(counts) < 2 or not np.all(counts >= 0) or not np.all(counts < LATEST / second):
        return Instants(counts, second)
    if second == DAY and SERIAL[0] < counts[0] < SERIAL[1]:
        return Instants(counts - SERIAL_1970, second)
    steps, notes = np.diff(counts), []
    usual = float(np.median(steps[steps > 0])) if np.any(steps > 0) else np.inf
    minutes = np.flatnonzero(np.diff(counts // 100) > 0)
    skipped = np.where(np.diff(counts // 10_000)[minutes] > 0, 4040.0, 40.0)
    reads = np.max(counts) < 240_000 and max(np.max(counts % 100), np.max(counts // 100 % 100)) < 60
    if second == 1.0 and reads and minutes.size and np.all(np.abs(steps[minutes] - skipped) <= MISSED * usual):
        counts = 3600 * (counts // 10_000) + 60 * (counts // 100 % 100) + counts % 100
        steps, notes = np.diff(counts), ["time is written as HHMMSS."]
    back = steps < 0
    if labels and any(
        labels[row] != labels[row + 1] for row in np.flatnonzero(back).tolist()
    ):  # a restart of time at the start of a run is no wrap
        return Instants(counts, second, " ".join(notes))
    whole = [float(2**bits) for bits in COUNTERS] if np.all(counts % 1 == 0) else []
    clocks = [seconds / second for seconds in CLOCKS] if counts[0] > MISSED * usual else []  # else concatenated files
    for wrap in (*whole, *clocks) if back.any() else ():
        if np.max(counts) < wrap and np.all((steps[back] + wrap > 0) & (steps[back] + wrap <= MISSED * usual)):
            counts = counts + np.concatenate([[0], np.cumsum(back)]) * int(wrap)
            notes.append(f"the counter of time wraps at {wrap:.10g}; time is continued across the wrap.")
            break
    return Instants(counts, second, " ".join(notes))


def newest_first(times: NDArray[Any]) -> bool:
    """Whether times decrease from the first row to the last: some loggers write the newest row first."""
    finite = times[np.isfinite(times)]
    steps = np.diff(finite)
    return bool(len(finite) > FEWEST_STAMPS and np.all(steps <= 0) and np.mean(steps < 0) > 0.5)


def is_instants(series: pd.Series[Any]) -> bool:
    """Whether a column holds dates with times, or times of a clock, as text."""
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
    """Whether the first cell is a clock time such as 10:01:45.25 or 1:45.25."""
    return (
        len(series) > 0
        and not pd.api.types.is_numeric_dtype(series.dtype)
        and not pd.api.types.is_datetime64_any_dtype(series.dtype)
        and bool(_CLOCK.fullmatch(str(series.iloc[0])))
    )


def _of_clock(series: pd.Series[Any], where: str, name: str) -> Array:
    """Clock times in seconds, continued past midnight; NaN for empty cells."""
    parts = series.astype("string").str.extract(_CLOCK.pattern + "$")
    strange = parts[3].isna().to_numpy() & series.notna().to_numpy()
    if strange.any():
        cell = str(series.iloc[int(np.argmax(strange))])
        raise BadInput(f'{where}: column "{name}" begins with clock times, but {cell!r:.40} is not one. Mend it.')
    days, hours, minutes, seconds, thousandths = (
        pd.to_numeric(parts[k].str.replace(",", "."), errors="coerce").to_numpy(dtype=float, na_value=np.nan)
        for k in range(5)
    )
    half = parts[5].str.lower()
    afternoon, morning = ((half == word).fillna(False).to_numpy(dtype=bool) for word in ("pm", "am"))
    hours = np.nan_to_num(hours)
    hours = np.where((afternoon | morning) & (hours == 12), 0.0, hours) + 12.0 * afternoon
    since_midnight = (
        DAY * np.nan_to_num(days) + 3600 * hours + 60 * minutes + seconds + 1e-3 * np.nan_to_num(thousandths)
    )
    finite = np.isfinite(since_midnight)
    midnights = np.cumsum(np.diff(since_midnight[finite], prepend=since_midnight[finite][:1]) < -DAY / 2)
    since_midnight[finite] += DAY * midnights
    return np.asarray(since_midnight)


def _split(table: RawTable, column: Column) -> Instants:
    """Whole seconds and their fraction from two columns, as integer nanoseconds."""
    whole, rest = table.numbers(column.column), table.numbers(column.rest)
    valid = np.isfinite(whole) & np.isfinite(rest) & (np.abs(whole) < LATEST) & (np.abs(rest) < LATEST)
    seconds = np.where(valid, whole, 0.0).astype(np.int64)
    counts = seconds * 10**9 + np.round(np.where(valid, rest, 0.0) * REST[column.rest_unit]).astype(np.int64)
    return Instants(counts if valid.all() else np.where(valid, counts, np.nan), 1e-9)


def origin_of(clocks: Sequence[Instants]) -> tuple[Fraction, str]:
    """The origin of time, s, and a sentence about it if it is not the file's zero."""
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
    """A text column that begins with a date, parsed as dates; any other column unchanged."""
    if pd.api.types.is_numeric_dtype(series.dtype) or not len(series) or not _DATE.match(str(series.iloc[0])):
        return series
    if pd.api.types.is_datetime64_any_dtype(series.dtype):
        return series
    try:
        text = series.astype("string").str.replace(r"(:\d\d),(\d)", r"\1.\2", regex=True)
        if _ISO.match(str(series.iloc[0])):
            return pd.Series(pd.to_datetime(text, format="ISO8601", utc=True))
        return _in_either_order(text)
    except (ValueError, OverflowError, TypeError) as error:
        reason = str(error).splitlines()[0]
        raise BadInput(f'{where}: column "{name}" begins with a date, but not all of it is one: {reason:.120}.') from (
            error
        )


def _in_either_order(series: pd.Series[Any]) -> pd.Series[Any]:
    """Dates not in ISO 8601; if day and month could be swapped, the order for which the recording is shorter.

    Raises
    ------
    ValueError
        A cell is not such a date.
    """
    readings: list[pd.Series[Any]] = []
    failure = ValueError()
    for day_first in (True, False) if re.match(r"\s*\d\d?[./-]\d\d?[./-]\d{4}", str(series.iloc[0])) else (False,):
        try:
            readings.append(pd.Series(pd.to_datetime(series, format="mixed", dayfirst=day_first, utc=True)))
        except (ValueError, OverflowError) as error:
            failure = ValueError(str(error))
    if not readings:
        raise failure
    return min(readings, key=lambda dates: dates.max() - dates.min())


BROKEN = 0.02
"""Share of irregular steps above which a clock is uneven; fewer are gaps and new runs."""
WINDOW = 32
"""Rows over which steps are averaged; the usual step is the median of these means."""
SHORTEST = 50
"""Fewest rows of a stretch from which its step is estimated."""
GAP = 10.0
"""A step is a gap (rows are lost) above this many usual steps, and above three times the 99th percentile of steps."""
BOUNDED = 3.0
"""Largest deviation of a receipt stamp from the even clock, in usual steps or 99th percentiles of steps."""
SURE = 2.0
"""Standard deviations of the stamps' weight at which a decision is significant."""
ROUNDING = 1e-3
"""Share of the usual step below which stamps are equal."""
FEWEST_STAMPS = 5
EVEN_COUNTS = 0.05
"""Relative deviation allowed in the number of rows with the same stamp."""
ROUNDED = 1.0
"""Largest deviation from an even clock, in units of the stamps' last digit, that rounding alone explains."""
IN_ONE_PACKET = 0.2
"""Share of the usual step below which consecutive rows came in one packet."""


@dataclass(frozen=True)
class Evened:
    """Rows with evenly spaced times.

    Attributes
    ----------
    time : (m,) s.
    signals : name -> (m,).
    rows : (m,) the row of the file that each row is, or that precedes it.
    resampled : resampling of signals, if rows were not kept.
    note : how times were changed.
    """

    time: Array
    signals: Mapping[str, Array]
    rows: np.ndarray[tuple[int], np.dtype[np.int64]]
    resampled: Mapping[str, Resampled]
    note: str


def evened(time: Array, signals: Mapping[str, Array], hold: str, keep_rows: bool = False) -> Evened | None:
    """Rows of an uneven clock with even times; None if the clock is even enough, or too little is known to decide.

    Parameters
    ----------
    time : (n,) s, as stamped.
    signals : name -> (n,) values of the rows.
    hold : "zero" holds commands between rows, "linear" interpolates them as measurements.
    keep_rows : True allows only regression; None is returned where a grid would be needed.
    """
    if len(time) < 2 * SHORTEST or not np.isfinite(time).all():
        return None
    steps = np.diff(time)
    ahead = steps[steps >= 0]
    if not ahead.size:
        return None
    step, recurring = float(np.median((time[WINDOW:] - time[:-WINDOW]) / WINDOW)), float(np.quantile(ahead, 0.99))
    if coarse := step <= 0:
        step, recurring = _of_coarse(time)
    if step <= 0:
        return None
    gap = max(GAP * step, 3 * recurring)
    inside = (steps >= -ROUNDING * step) & (steps < gap)
    usual = float(np.median(steps))
    runs_on = np.mean((np.abs(steps - usual) > JITTER_TOLERANCE * max(usual, 0.0)) & inside) <= BROKEN
    if runs_on and np.std(steps[inside]) <= REGULAR * step:
        return None
    edges = [0, *(np.flatnonzero(~inside) + 1).tolist(), len(time)]
    parts = [(a, b) for a, b in zip(edges, edges[1:], strict=False) if b - a >= SHORTEST]
    if sum(b - a for a, b in parts) < (1 - BROKEN) * len(time):
        return None
    telling = [np.flatnonzero(steps[a : b - 1] > 0) + 1 if coarse else np.arange(b - a) for a, b in parts]  # new stamps
    lines = [np.polyfit(rows, time[a:b][rows], 1) for (a, b), rows in zip(parts, telling, strict=True)]
    behind = np.concatenate(
        [time[a:b] - np.polyval(line, np.arange(b - a)) for (a, b), line in zip(parts, lines, strict=True)]
    )
    bounded = float(np.quantile(np.abs(behind), 0.999)) <= BOUNDED * max(step, recurring)
    share, sd = _share_of_stamps(time, signals, parts, step, max(3, int(np.ceil(2 * recurring / step))))
    packets = bool(np.mean(steps[inside] < IN_ONE_PACKET * step) > 0.5 or np.any(steps[inside] <= ROUNDING * step))
    of_receipt = share + SURE * sd < 0.5 or (packets and not share - SURE * sd > 0.5)
    if bounded and of_receipt:
        why = (
            f"signals follow the row number, not the time stamp (weight of the stamp {share:.2f} ± {sd:.2f}; true "
            f"stamps have weight 1)"
        )
        return _regressed(time, parts, lines, signals, "rows arrived in packets" if packets else why)
    rounded = runs_on and np.max(np.abs(behind)) <= ROUNDED * _resolution(time, step)
    if rounded and bounded and not share - SURE * sd > 0.5:
        return _regressed(time, parts, lines, signals, "their rounding alone explains it")
    if runs_on or keep_rows or bool(np.any(steps[inside] <= ROUNDING * step)):
        return None
    whole_steps = np.round(steps / usual)
    if (
        np.mean(np.abs(steps - whole_steps * usual)[inside] > REGULAR * usual) <= BROKEN
        and np.min(whole_steps[inside]) >= 1
    ):
        return _with_lost_rows(time, signals, whole_steps, inside & (whole_steps <= LINEAR_GAP))
    note = (
        f"rows are uneven in time ({_span(time)}): interpolated to an even grid of {exact(step)} s ({1 / step:.4g} Hz)."
    )
    return _on_a_grid(time, signals, parts, step, hold, note)


def _share_of_stamps(
    time: Array, signals: Mapping[str, Array], parts: list[tuple[int, int]], step: float, half: int
) -> tuple[float, float]:
    """Least-squares factor on slope · (stamp - even place) and its sd: 1 for true stamps, 0 for evenly sampled rows."""
    from scipy.signal import savgol_filter  # imported here: it takes longer to load than most files to read

    moments = np.zeros(2)
    for values in signals.values():
        sums, count = np.zeros(3), 0
        for a, b in parts:
            run = values[a:b]
            if b - a <= 2 * half + 1 or not np.isfinite(run).all() or np.ptp(run) == 0:
                continue
            scaled = (run - np.mean(run)) / np.std(run)
            smooth, slope = (savgol_filter(scaled, 2 * half + 1, 2, deriv=item) for item in (0, 1))
            ahead = (time[a:b] - savgol_filter(time[a:b], 2 * half + 1, 2)) / step
            left, due = (scaled - smooth)[half:-half], (slope * ahead)[half:-half]
            sums += [left @ due, due @ due, left @ left]
            count += len(left)
        if count and sums[1] > 0 and sums[2] > 0:
            noise = max(sums[2] - sums[0] ** 2 / sums[1], 1e-12 * count) / count
            moments += sums[:2] / noise
    if moments[1] <= 0:
        return 0.5, np.inf
    return float(moments[0] / moments[1]), float(1 / np.sqrt(moments[1]))


def _of_coarse(time: Array) -> tuple[float, float]:
    """Time per row and per stamp if equally many rows share each stamp, as with whole seconds; zeros otherwise."""
    stamps, counts = np.unique(time, return_counts=True)
    if len(stamps) < FEWEST_STAMPS or np.any(np.diff(time) < 0):
        return 0.0, 0.0
    usual, apart = float(np.median(counts[1:-1])), float(np.median(np.diff(stamps)))
    even = np.abs(counts[1:-1] - usual) <= max(1.0, EVEN_COUNTS * usual)
    return (apart / usual, apart) if np.mean(even) > 1 - BROKEN else (0.0, 0.0)


def _resolution(time: Array, step: float) -> float:
    """Resolution of the stamps in s, a power of ten below the step; 0 if they are finer."""
    since = time - time[0]
    for power in range(int(np.floor(np.log10(step))), int(np.floor(np.log10(step))) - 3, -1):
        digit = 10.0**power
        if np.all(np.abs(since / digit - np.round(since / digit)) < ROUNDING):
            return digit
    return 0.0


def _regressed(
    time: Array, parts: list[tuple[int, int]], lines: list[Array], signals: Mapping[str, Array], why: str
) -> Evened:
    """Even times by regression in each stretch; rows outside the stretches are left out."""
    rows = np.concatenate([np.arange(a, b) for a, b in parts])
    even = np.concatenate([np.polyval(line, np.arange(b - a)) for (a, b), line in zip(parts, lines, strict=True)])
    step = float(np.median([line[0] for line in lines]))
    note = (
        f"stamps are uneven ({_span(time)}), and {why}: time is regressed on the row, {exact(step)} s a row "
        f"({1 / step:.4g} Hz)."
    )
    return Evened(even, {name: values[rows] for name, values in signals.items()}, rows, {}, note)


def _with_lost_rows(time: Array, signals: Mapping[str, Array], whole: Array, running: Mask) -> Evened:
    """An even clock with lost rows: short losses are interpolated, at longer ones a run ends.

    Parameters
    ----------
    whole : (n - 1,) number of clock steps from row to row.
    running : (n - 1,) mask of steps to interpolate.
    """
    edges = [0, *(np.flatnonzero(~running) + 1).tolist(), len(time)]
    parts = [(a, b) for a, b in zip(edges, edges[1:], strict=False) if b - a > 2]
    counts = np.concatenate([[0.0], np.cumsum(np.where(running, whole, 0.0))])
    step = float(np.sum(np.diff(time)[running]) / np.sum(whole[running]))
    even = time.copy()
    for a, b in parts:
        count = counts[a:b] - counts[a]
        even[a:b] = np.mean(time[a:b] - step * count) + step * count
    note = (
        f"{int(np.sum(whole[running] - 1))} rows of the clock ({exact(step)} s, {1 / step:.4g} Hz) are missing: gaps "
        f"of up to {LINEAR_GAP - 1:g} rows are interpolated; at longer ones a new run begins."
    )
    return _on_a_grid(even, signals, parts, step, "linear", note)  # a lost command may equal the previous or next one


def _on_a_grid(
    time: Array, signals: Mapping[str, Array], parts: list[tuple[int, int]], step: float, hold: str, note: str
) -> Evened:
    """Values at true stamps, interpolated to an even grid of the mean step."""
    grids, rows, columns = [], [], {name: list[Array]() for name in signals}
    costs: dict[str, tuple[float, float]] = {}
    for a, b in parts:
        grid = time[a] + step * np.arange(1 + int((time[b - 1] - time[a]) / step * (1 + 1e-12)))
        grids.append(grid)
        rows.append(a + np.clip(np.searchsorted(time[a:b], grid, side="right") - 1, 0, b - a - 1))
        for name, values in signals.items():
            join = held if name in COMMANDS and hold == "zero" else linear
            result, cost = join(time[a:b], values[a:b], grid, name)
            columns[name].append(result)
            costs[name] = max(costs.get(name, (0.0, 0.0)), cost)
    how = {
        name: Resampled("held" if name in COMMANDS and hold == "zero" else "linear", "its own stamps", 1 / step, *cost)
        for name, cost in costs.items()
    }
    return Evened(
        np.concatenate(grids),
        {name: np.concatenate(column) for name, column in columns.items()},
        np.concatenate(rows),
        how,
        note,
    )


def _span(time: Array) -> str:
    low, high, longest = np.quantile(np.diff(time), (0.05, 0.95, 0.999))
    high = longest if high == low else high  # many rows share a stamp
    return f"steps of {1e3 * low:.3g} to {1e3 * high:.3g} ms"
