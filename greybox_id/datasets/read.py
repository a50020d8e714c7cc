"""Reading a recording through a column map, from a file of any kind in `formats`."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from fractions import Fraction
from pathlib import Path

import numpy as np
import pandas as pd

from ..base.errors import BadInput, near
from ..base.numbers import counted
from ..base.shorthands import Array
from ..base.signals import COMMANDS, SD, unit_of
from .alignment import ClockAlignment
from .clocks import Joined, Readings, held, linear, on_one_clock
from .column_map import Column, ColumnMap, Reference, column_map, shipped_maps
from .formats import SUFFIXES, TIME, Contents, Group, bare_name, contents, hash_of, one_column
from .instants import Instants, evened, instants, newest_first, origin_of
from .raw_table import RawTable
from .recording import Recording, Resampled, Source, split_runs

__all__ = ["SUFFIXES", "read"]

LARGEST = 1e30
"""Numbers beyond this are not measurements and become NaN: products and squares of them would overflow."""
RUN, START = "run", "start"
SAMPLED = 400
"""Rows checked first for decreasing time."""
FEWEST_CELLS = 20
"""Fewest readings of a column from which its rate is estimated."""


def read(path: str | Path, columns: str | Path | ColumnMap = "canonical") -> Recording:
    """Read a recording and convert it to SI units and ISO 8855 signs.

    Parameters
    ----------
    path : a file of a kind in `formats.SUFFIXES`, or the folder of a ROS 2 bag.
    columns : a column map: the name of a shipped one, the path of a TOML file, or the map itself.

    Returns
    -------
    Recording
        Signals (n,) for n rows. Empty cells and non-finite numbers are NaN. A run ends where the step of time differs
        from the usual one, and where the map's run column changes. If the mapped columns have several clocks, all are
        resampled to one (`clocks`), with the estimated error in `Recording.resampled`.

    Raises
    ------
    BadInput
        The file or the map cannot be read, a column is missing or holds text: the error names it.
    """
    mapping, file = column_map(columns), Path(path)
    result = contents(file, mapping)
    source = Source(path=str(path), sha256=hash_of(file), columns=_named(columns, mapping), column_map=mapping.text)
    return _recording(result, mapping, bare_name(file), source, {})


def read_together(
    paths: Sequence[str | Path],
    columns: str | Path | ColumnMap = "canonical",
    late: Mapping[str, ClockAlignment] | None = None,
) -> Recording:
    """Read several files of one drive, each with its own clock, as one recording.

    Parameters
    ----------
    paths : files, one topic or sensor each. The file's name without suffix qualifies its columns: `imu/time` is the
        column time of imu.csv. A plain name is the column of the first file that has it.
    columns : as in `read`. The map's time column is that of every file; a qualified one such as `imu/time` selects the
        clock to which all are resampled.
    late : file's name without suffix -> alignment of its clock, by which its times are corrected.

    Raises
    ------
    As in `read`; or two files have the same name, or no time in common.
        As in `read`; or two files have one name, or no time in common.
    """
    mapping = column_map(columns)
    result = contents_together(paths, mapping)
    name = "+".join(group.name for group in result.groups)
    return _recording(result, mapping, name, Source(columns=_named(columns, mapping)), late or {})


def contents_together(paths: Sequence[str | Path], mapping: ColumnMap) -> Contents:
    """Contents of several files of one drive. Raises `BadInput` as `as_parts` does."""
    parts = as_parts([Path(path) for path in paths], mapping)
    return Contents(" and ".join(str(path) for path in paths), tuple(parts.values()), "several files")


def as_parts(files: Sequence[Path], mapping: ColumnMap) -> dict[str, Part]:
    """Files as one group each, by their names without suffix. Raises `BadInput` if two have the same name."""
    parts: dict[str, Part] = {}
    for file in files:
        name, result = bare_name(file), contents(file, mapping)
        if name in parts:
            raise BadInput(f"Two files are called {name}; rename one of them, so that columns can be distinguished.")
        if len(result.groups) > 1:
            raise BadInput(f"The signals of {file} have several clocks; convert the file first: greybox data convert.")
        parts[name] = Part.of(name, result.groups[0])
    return parts


class Part(Group):
    """One of several files: its columns have qualified names such as `imu/time`, or plain ones."""

    @classmethod
    def of(cls, name: str, group: Group) -> Part:
        """The single group of a file, with qualified names."""
        prefix = f"{name}/"

        def load(target: Sequence[str]) -> RawTable:
            table = group.load([item.removeprefix(prefix) for item in target])
            return replace(table, names=tuple(prefix + name for name in table.names))

        units = {prefix + name: unit for name, unit in group.units.items()}
        clock = prefix + group.clock if group.clock else ""
        return cls(name, tuple(prefix + name for name in group.names), load, prefix, clock, group.clock_unit, units)

    def full(self, name: str, alone: bool = False) -> str | None:
        """The qualified name of a column of this file."""
        del alone
        return super().full(name, alone=True)


def one_signal(part: Part, column: Column, mapping: ColumnMap) -> tuple[Array, Array]:
    """A signal of one file on its own clock: increasing times in s, in the file's time base, and values in SI units.

    Rows without a time or a value, and repeated times, are left out.
    """
    time = _time_column(part, mapping, alone=True)
    table, _ = _oldest_first(part.load([*time.names, *column.names]), time)
    t, v = instants(table, time).since(Fraction(0)), _converted(table, column)
    finite = np.flatnonzero(np.isfinite(t) & np.isfinite(v))
    _, once = np.unique(t[finite], return_index=True)
    return t[finite[once]], v[finite[once]]


def _named(columns: str | Path | ColumnMap, mapping: ColumnMap) -> str:
    return mapping.where or mapping.name if isinstance(columns, ColumnMap) else str(columns)


def _recording(
    result: Contents, mapping: ColumnMap, name: str, source: Source, late: Mapping[str, ClockAlignment]
) -> Recording:
    mapping = _named_as_in(result, mapping)
    _check_columns(result, mapping)
    groups = _groups(result, mapping)
    first_row = 0
    if len(groups) == 1:
        joined, rows, first_row = _one_table(groups, mapping)
    else:
        joined, rows = _several(groups, result, mapping, late)
    if not len(joined.time):
        raise BadInput(f"{result.where} has column names but no rows; record something, or name another file.")
    joined, rows = _started(joined, rows, result.where, mapping)
    for reference in mapping.poses:
        if not reference.if_column or result.find(reference.if_column):
            joined = _moved(joined, result.where, reference)
            break
    further = {name: unit_of(name.removeprefix(SD)) for name in joined.signals if name.startswith(SD)}
    return Recording(
        name=name,
        time=joined.time,
        signals={name: values for name, values in joined.signals.items() if name not in (RUN, START)},
        runs=_runs(joined.time, rows),
        source=replace(source, first_row=first_row),
        extra_units={
            **{name: column.si_unit for name, column in mapping.extra.items() if name in joined.signals},
            **further,
        },
        hold=mapping.hold,
        hold_stated=mapping.hold_stated,
        resampled=joined.resampled,
        notes=(*result.notes, *joined.notes),
    )


def _named_as_in(result: Contents, mapping: ColumnMap) -> ColumnMap:
    """The map with each column under the first of its names that the file has."""
    return replace(
        mapping,
        time=mapping.time.among(result.find),
        signals={name: column.among(result.find) for name, column in mapping.signals.items()},
        extra={name: column.among(result.find) for name, column in mapping.extra.items()},
    )


def _started(joined: Joined, labels: list[str], where: str, mapping: ColumnMap) -> tuple[Joined, list[str]]:
    """Remove the rows before the start column first differs from zero."""
    if START not in joined.signals:
        return joined, labels
    count = joined.signals[START]
    under_way = np.flatnonzero(np.isfinite(count) & (count != 0))
    if not under_way.size:
        raise BadInput(
            f'{where}: "{mapping.start_column}" is zero in all rows, but the [start] table of the column map '
            "begins a recording at its first non-zero value; remove that table."
        )
    first = int(under_way[0])
    left_out = f'{first} rows before "{mapping.start_column}" first differs from zero were left out.'
    kept = {name: values[first:] for name, values in joined.signals.items()}
    notes = (*joined.notes, left_out) if first else joined.notes
    return replace(joined, time=joined.time[first:], signals=kept, notes=notes), labels[first:]


def _moved(joined: Joined, where: str, reference: Reference) -> Joined:
    """Add the motion estimated from poses."""
    from .poses import motion  # imported here: it loads Numba

    x, y, yaw = (joined.signals[name] for name in ("x", "y", "yaw"))
    result = motion(joined.time, x, y, yaw, reference, where)
    known = {**result.signals, **{f"{SD}{name}": values for name, values in result.sd.items()}}
    return replace(joined, time=result.time, signals={**joined.signals, **known}, notes=(*joined.notes, *result.notes))


def _groups(result: Contents, mapping: ColumnMap) -> list[tuple[Group, list[Column]]]:
    """The groups with mapped columns, and those columns under their names in the group."""
    used: dict[str, tuple[Group, list[Column]]] = {}
    start = [Column(START, mapping.start_column, "1", "1")] if mapping.start_column else []
    for column in (*mapping.channels, *start):
        place = result.find(column.column)
        if place:
            group, name = place
            column = replace(
                column, column=name, sign_column=group.full(column.sign_column, True) or column.sign_column
            )
            used.setdefault(f"{group.name} {group.names[0]}", (group, []))[1].append(column)
    return list(used.values())


def _one_table(groups: Sequence[tuple[Group, list[Column]]], mapping: ColumnMap) -> tuple[Joined, list[str], int]:
    (group, channels), *_ = groups
    time = _time_column(group, mapping, alone=True) if not mapping.rate else mapping.time
    run = group.full(mapping.run_column, alone=True) if mapping.run_column else None
    target = [name for column in (time, *channels) for name in column.names] + ([run] if run else [])
    table, order = _oldest_first(group.load(target), time) if not mapping.rate else (group.load(target), "")
    labels = table.labels(run) if run else []
    clock = instants(table, time, labels) if not mapping.rate else Instants(np.arange(len(table)), 1 / mapping.rate)
    origin, note = origin_of([clock])
    signals = {channel.signal: _converted(table, channel) for channel in channels}
    notes = tuple(filter(None, (order, clock.note, note)))
    rows: Sequence[int] = range(len(table))
    joined = Joined(_sized(clock.since(origin)), signals, {}, notes)
    if not mapping.rate:  # with a rate, every row counts as a clock step
        joined, rows = _once(joined)
    joined, spread = (joined, range(len(joined.time))) if mapping.poses else _between_cells(joined, mapping.hold)
    rows = [rows[row] for row in spread]
    labels = [labels[row] for row in rows] if labels else []
    first = table.first_row if len(rows) == len(table) and not order else 0
    even = evened(joined.time, joined.signals, mapping.hold) if not (mapping.poses or mapping.rate) else None
    if even is not None:
        joined = Joined(even.time, even.signals, {**joined.resampled, **even.resampled}, (*joined.notes, even.note))
        labels = [labels[row] for row in even.rows] if labels else []
    return joined, labels, first if even is None else 0


def _oldest_first(table: RawTable, time: Column) -> tuple[RawTable, str]:
    """A table reversed if its newest row comes first, with a sentence that says so; any other table unchanged."""
    step = max(1, len(table) // SAMPLED)
    few = replace(table, columns=tuple(column.iloc[::step] for column in table.columns))
    for part in (few, table):
        series = part.column(time.column)
        in_numbers = pd.api.types.is_numeric_dtype(series.dtype)
        if not newest_first(part.numbers(time.column) if in_numbers else instants(part, time).counts):
            return table, ""
    return table.turned(), "rows are written newest first: they were read from the last to the first."


def _between_cells(joined: Joined, hold: str) -> tuple[Joined, Sequence[int]]:
    """Resample columns that are blank in most rows, as those of slower sensors are, to all rows; and the rows kept.

    They are interpolated between their own readings; if time steps back anywhere, nothing is changed.
    """
    time, signals, resampled = joined.time, dict(joined.signals), dict(joined.resampled)
    if len(time) < 2 or not np.all(np.diff(time) > 0):
        return joined, range(len(time))
    for name, values in joined.signals.items():
        filled = np.flatnonzero(np.isfinite(values))
        if name in (RUN, START) or len(filled) < FEWEST_CELLS or np.median(np.diff(filled)) < 2:
            continue
        is_held = name in COMMANDS and hold == "zero"
        signals[name], cost = (held if is_held else linear)(time, values, time, name)
        rate = 1 / float(np.median(np.diff(time[filled])))
        resampled[name] = Resampled("held" if is_held else "linear", "its own cells", rate, *cost)
    spread = [name for name in resampled if name not in joined.resampled]
    if not spread:
        return joined, range(len(time))
    within = np.flatnonzero(np.all([np.isfinite(signals[name]) for name in spread], axis=0))
    rows = range(int(within[0]), int(within[-1]) + 1) if within.size else range(len(time))
    trimmed = {name: values[rows.start : rows.stop] for name, values in signals.items()}
    note = f"columns that are blank in most rows were interpolated between their filled cells: {', '.join(spread)}."
    return Joined(time[rows.start : rows.stop], trimmed, resampled, (*joined.notes, note)), rows


def _once(joined: Joined) -> tuple[Joined, Sequence[int]]:
    """Drop empty rows and rows that repeat the previous one, including its time; returns the kept rows as well.

    Rows of one packet may share a stamp: if more stamps than whole rows repeat, no row counts as a repetition.
    """
    columns = [joined.time, *joined.signals.values()]
    filled, same = np.zeros(len(joined.time), dtype=bool), np.ones(max(len(joined.time) - 1, 0), dtype=bool)
    for values in columns:  # one by one: a table of all columns of hours would be large
        missing = np.isnan(values)
        filled |= np.isfinite(values)
        same &= (values[1:] == values[:-1]) | (missing[1:] & missing[:-1])
    blank = ~filled
    doubled = np.concatenate([[False], same]) & filled
    if np.count_nonzero(np.diff(joined.time) == 0.0) > np.count_nonzero(doubled):
        doubled[:] = False
    kept = np.flatnonzero(~(blank | doubled))
    if len(kept) == len(blank):
        return joined, range(len(blank))
    notes = [f"left out: {counted(int(np.sum(blank)), 'empty row')}."] if blank.any() else []
    if doubled.any():
        notes.append(f"left out: {counted(int(np.sum(doubled)), 'repetition')} of the row before, its time included.")
    signals = {name: values[kept] for name, values in joined.signals.items()}
    return replace(joined, time=joined.time[kept], signals=signals, notes=(*joined.notes, *notes)), kept.tolist()


def _several(
    groups: Sequence[tuple[Group, list[Column]]],
    result: Contents,
    mapping: ColumnMap,
    late: Mapping[str, ClockAlignment],
) -> tuple[Joined, list[str]]:
    if mapping.rate:
        raise BadInput(
            f"{result.where}: rate is for a file with one table, but this file holds several; name the time column "
            "of each."
        )
    clocks: list[Instants] = []
    turned: list[str] = []
    signals: list[Mapping[str, Array]] = []
    names = [group.name or group.clock for group, _ in groups]
    run = result.find(mapping.run_column) if mapping.run_column else None
    for group, channels in groups:
        time = _time_column(group, mapping, alone=False)
        run_columns = [Column(RUN, run[1], "1", "1")] if run and run[0] is group else []
        table, order = _oldest_first(
            group.load([name for column in (time, *channels, *run_columns) for name in column.names]), time
        )
        turned += [f"{group.name or group.clock}: {order}"] if order else []
        clocks.append(instants(table, time))
        signals.append({column.signal: _converted(table, column) for column in (*channels, *run_columns)})
    origin, note = origin_of(clocks)
    plain = mapping.time.column == TIME or (isinstance(groups[0][0], Part) and "/" not in mapping.time.column)
    named = None if plain else result.find(mapping.time.column)
    if named is None and mapping.poses:  # resampled poses would not be readings: their clock is kept
        named = result.find(mapping.signals["x"].column)
    notes = [words for words in (*turned, *dict.fromkeys(clock.note for clock in clocks), note) if words]
    readings = []
    for name, clock, values in zip(names, clocks, signals, strict=True):
        stamps = _sized(clock.since(origin))
        even = evened(stamps, values, mapping.hold, keep_rows=True)
        if even is not None:
            notes.append(f"{name}: {even.note}")
        on_time, values = (stamps, values) if even is None else (even.time, even.signals)
        if name in late:  # alignments are in the file's time base
            on_time = late[name].corrected(on_time + float(origin)) - float(origin)
        readings.append(Readings(name, on_time, values))
    kind = "the recording" if isinstance(groups[0][0], Part) else ""
    taken = named[0].name or named[0].clock if named else None
    joined = on_one_clock(readings, taken, mapping.hold, result.where, kind)
    runs = [str(label) for label in joined.signals.get(RUN, np.empty(0))]
    return replace(joined, notes=(*joined.notes, *notes)), runs


def _time_column(group: Group, mapping: ColumnMap, alone: bool) -> Column:
    """The time column of a group: the map's if the group has it, else the group's clock."""
    names = [mapping.time.column, *mapping.time.otherwise]
    if isinstance(group, Part):  # `imu/time` selects the clock; in the other files the column is `time`
        names += [name.rpartition("/")[2] for name in names]
    known = next((name for name in names if group.full(name, alone)), "")
    name = (group.full(known, alone) if known else None) or group.clock
    rest = mapping.time.rest
    if rest and isinstance(group, Part):
        rest = next(filter(None, map(group.full, (rest, rest.rpartition("/")[2]))), "")
    if not name:
        raise BadInput(
            f"The columns {', '.join(group.names[:4])} have no time column, while other columns of the map have a "
            "clock of their own; leave them out, or write the file with a time for each."
        )
    if name == group.clock and group.clock_unit:
        return Column("time", name, group.clock_unit, "s")
    return replace(mapping.time.named(known or mapping.time.column), column=name, rest=rest)


def _converted(table: RawTable, column: Column) -> Array:
    with np.errstate(over="ignore", invalid="ignore"):
        values = table.numbers(column.column)
        if column.sign_column:
            labels = table.labels(column.sign_column)
            signs = {label: column.sign_of(label) for label in set(labels)}
            values = values * np.array([signs[label] for label in labels])
        return _sized(column.convert(values))


def _sized(values: Array) -> Array:
    with np.errstate(invalid="ignore"):
        return np.where(np.abs(values) < LARGEST, values, np.nan)


def _runs(time: Array, labels: Sequence[str]) -> tuple[tuple[int, int], ...]:
    runs = split_runs(time)
    if not labels:
        return runs
    edges = {start for start, _ in runs} | {k for k in range(1, len(labels)) if labels[k] != labels[k - 1]}
    starts = sorted(edges)
    return tuple(zip(starts, [*starts[1:], len(time)], strict=True))


def _check_columns(result: Contents, mapping: ColumnMap) -> None:
    clocked = any(group.clock for group in result.groups)
    needed = [name for c in mapping.channels if not c.optional for name in c.names]
    if not (clocked and mapping.time.column == TIME):
        needed[:0] = mapping.time.names
    if mapping.run_column and not mapping.run_column_optional:
        needed.append(mapping.run_column)
    if mapping.start_column and not mapping.start_column_optional:
        needed.append(mapping.start_column)
    for name in needed:
        if not result.find(name):
            raise BadInput(
                f'{result.where}: there is no column "{name}", which the column map "{mapping.name}" needs.'
                f"{near(name, result.names)} {_what_there_is(result.names)}"
                f"{_part_of(name, result)}{_other_map(result, mapping)}"
            )
    if not any(result.find(c.column) for c in mapping.channels):
        raise BadInput(
            f'{result.where}: the column map "{mapping.name}" finds none of its signals in this file. '
            f"{_what_there_is(result.names)}{_other_map(result, mapping)}"
        )


def _part_of(name: str, result: Contents) -> str:
    """Advice if a map for several files of one drive is used for one of them; else empty."""
    part, _, rest = name.partition("/")
    if not rest or any(known.partition("/")[0] == part for known in result.names):
        return ""
    return f" It means column {rest} of a file {part}: join the files of the drive first (greybox data join)."


def _what_there_is(names: Sequence[str]) -> str:
    if one_column(tuple(names)):
        return one_column(tuple(names))
    if not names:
        return "The file has no columns of numbers."
    listed = ", ".join(names[:40])
    return f"The file has {listed}{f' and {len(names) - 40} more' if len(names) > 40 else ''}."


def _other_map(result: Contents, tried: ColumnMap) -> str:
    for name in shipped_maps():
        other = column_map(name)
        needed = [c.column for c in (other.time, *other.channels) if not c.optional]
        if other.name != tried.name and len(needed) > 1 and all(result.find(column) for column in needed):
            return f' The shipped column map "{name}" fits this file: columns = "{name}", or ‹columns› {name}.'
    return " Map the file's own names in a column map of your own (‹columns› my_map.toml)."
