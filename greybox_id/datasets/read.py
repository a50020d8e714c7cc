"""Reading a recording from a file of any kind that `formats` knows, through a column map."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from ..errors import BadInput, near
from ..recording import Array, Recording, Source, split_runs
from .clocks import Joined, Readings, on_one_clock
from .column_map import Column, ColumnMap, column_map, shipped_maps
from .formats import SUFFIXES, Contents, Group, bare_name, contents, hash_of
from .formats.contents import TIME
from .instants import Instants, instants, origin_of
from .table import Table, one_column

__all__ = ["SUFFIXES", "read"]

LARGEST = 1e30
"""Numbers beyond this are no measurement: they become NaN, since products and squares of them would overflow."""
RUN = "run"


def read(path: str | Path, columns: str | Path | ColumnMap = "canonical") -> Recording:
    """Read a recording and turn it into SI units and ISO 8855 signs.

    Parameters
    ----------
    path : a file of a kind in `formats.SUFFIXES`, or the folder of a ROS 2 bag.
    columns : a column map: the name of a shipped one, the path of a TOML file, or the map itself.

    Returns
    -------
    Recording
        Signals (n,) for n rows. Empty cells and numbers that are not finite are NaN. Runs end where time stops running
        on in its usual step, and where the map's run column changes. Where the mapped columns lie on several clocks,
        all are brought onto one (`clocks`), and `Recording.resampled` says what that costs.

    Raises
    ------
    BadInput
        The file or the map cannot be read, a column is missing or holds text: the sentence says where.
    """
    mapping = column_map(columns)
    named = mapping.name if isinstance(columns, ColumnMap) else str(columns)
    file = Path(path)
    found = contents(file, mapping)
    _check_columns(found, mapping)
    groups = _groups(found, mapping)
    joined, rows = _one_table(groups, mapping) if len(groups) == 1 else _several(groups, found, mapping)
    if not len(joined.time):
        raise BadInput(f"{file} has column names but no rows; record something, or name another file.")
    return Recording(
        name=bare_name(file),
        time=joined.time,
        signals={name: values for name, values in joined.signals.items() if name != RUN},
        runs=_runs(joined.time, rows),
        source=Source(path=str(path), sha256=hash_of(file), columns=named),
        extra_units={name: column.si_unit for name, column in mapping.extra.items() if name in joined.signals},
        hold=mapping.hold,
        resampled=joined.resampled,
        notes=(*found.notes, *joined.notes),
    )


def _groups(found: Contents, mapping: ColumnMap) -> list[tuple[Group, list[Column]]]:
    """The groups that hold mapped columns, with those columns under their full names."""
    used: dict[str, tuple[Group, list[Column]]] = {}
    for column in mapping.channels:
        place = found.find(column.column)
        if place:
            group, name = place
            used.setdefault(group.names[0], (group, []))[1].append(replace(column, column=name))
    return list(used.values())


def _one_table(groups: Sequence[tuple[Group, list[Column]]], mapping: ColumnMap) -> tuple[Joined, list[str]]:
    (group, channels), *_ = groups
    time = _time_column(group, mapping, alone=True)
    run = group.full(mapping.run_column, alone=True) if mapping.run_column else None
    table = group.load([time.column, *(c.column for c in channels), *([run] if run else [])])
    clock = instants(table, time)
    origin, note = origin_of([clock])
    signals = {channel.signal: _converted(table, channel) for channel in channels}
    joined = Joined(_sized(clock.since(origin)), signals, {}, (note,) if note else ())
    return joined, table.labels(run) if run else []


def _several(
    groups: Sequence[tuple[Group, list[Column]]], found: Contents, mapping: ColumnMap
) -> tuple[Joined, list[str]]:
    clocks: list[Instants] = []
    signals: list[Mapping[str, Array]] = []
    names = [group.name or group.clock for group, _ in groups]
    run = found.find(mapping.run_column) if mapping.run_column else None
    for group, channels in groups:
        time = _time_column(group, mapping, alone=False)
        own = [Column(RUN, run[1], "1", "1")] if run and run[0] is group else []
        table = group.load([time.column, *(c.column for c in (*channels, *own))])
        clocks.append(instants(table, time))
        signals.append({column.signal: _converted(table, column) for column in (*channels, *own)})
    origin, note = origin_of(clocks)
    named = found.find(mapping.time.column) if mapping.time.column != TIME else None
    readings = [
        Readings(name, _sized(clock.since(origin)), own)
        for name, clock, own in zip(names, clocks, signals, strict=True)
    ]
    joined = on_one_clock(readings, named[0].name or named[0].clock if named else None, mapping.hold, found.where)
    runs = [str(label) for label in joined.signals.get(RUN, np.empty(0))]
    return replace(joined, notes=(*joined.notes, note) if note else joined.notes), runs


def _time_column(group: Group, mapping: ColumnMap, alone: bool) -> Column:
    """The column with the time of a group: what the map names if it lies here, else the group's own clock."""
    name = group.full(mapping.time.column, alone) or group.clock
    if not name:
        raise BadInput(
            f"The columns {', '.join(group.names[:4])} have no time beside them, and the column map takes others on a "
            "clock of their own; leave them out, or write the file with a time beside each."
        )
    if name == group.clock and group.clock_unit:
        return Column("time", name, group.clock_unit, "s")
    return replace(mapping.time, column=name)


def _converted(table: Table, column: Column) -> Array:
    with np.errstate(over="ignore", invalid="ignore"):
        return _sized(column.convert(table.numbers(column.column)))


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


def _check_columns(found: Contents, mapping: ColumnMap) -> None:
    clocked = any(group.clock for group in found.groups)
    needed = [c.column for c in mapping.channels if not c.optional]
    if not (clocked and mapping.time.column == TIME):
        needed.insert(0, mapping.time.column)
    if mapping.run_column and not mapping.run_column_optional:
        needed.append(mapping.run_column)
    for name in needed:
        if not found.find(name):
            raise BadInput(
                f'{found.where}: there is no column "{name}", which the column map "{mapping.name}" needs.'
                f"{near(name, found.names)} {_what_there_is(found.names)}{_other_map(found, mapping)}"
            )
    if not any(found.find(c.column) for c in mapping.channels):
        raise BadInput(
            f'{found.where}: the column map "{mapping.name}" finds none of its signals in this file. '
            f"{_what_there_is(found.names)}{_other_map(found, mapping)}"
        )


def _what_there_is(names: Sequence[str]) -> str:
    if one_column(tuple(names)):
        return one_column(tuple(names))
    if not names:
        return "The file has no columns of numbers."
    listed = ", ".join(names[:40])
    return f"The file has {listed}{f' and {len(names) - 40} more' if len(names) > 40 else ''}."


def _other_map(found: Contents, tried: ColumnMap) -> str:
    for name in shipped_maps():
        other = column_map(name)
        needed = [c.column for c in (other.time, *other.channels) if not c.optional]
        if other.name != tried.name and len(needed) > 1 and all(found.find(column) for column in needed):
            return f' The shipped column map "{name}" fits this file: columns = "{name}", or --columns {name}.'
    return " Map the file's own names in a column map of your own (--columns my_map.toml)."
