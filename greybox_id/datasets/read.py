"""Reading a recording from a file: CSV (also gzipped) or Parquet, through a column map."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from ..errors import BadInput
from ..recording import Array, Recording, Source, split_runs
from .column_map import Column, ColumnMap, column_map, did_you_mean, shipped_maps
from .table import Table, csv_table, load_bytes, one_column, parquet_table

LARGEST = 1e30
"""Numbers beyond this are no measurement: they become NaN, since products and squares of them would overflow."""

SUFFIXES = (".csv", ".csv.gz", ".parquet")


def read(path: str | Path, columns: str | Path | ColumnMap = "canonical") -> Recording:
    """Read a recording and turn it into SI units and ISO 8855 signs.

    Parameters
    ----------
    path : a .csv, .csv.gz or .parquet file.
    columns : a column map: the name of a shipped one, the path of a TOML file, or the map itself.

    Returns
    -------
    Recording
        Signals (n,) for n rows. Empty cells and numbers that are not finite are NaN. Runs end where time stops running
        on in its usual step, and where the map's run column changes.

    Raises
    ------
    BadInput
        The file or the map cannot be read, a column is missing or holds text: the sentence says where.
    """
    mapping = column_map(columns)
    file = Path(path)
    suffix = next((s for s in SUFFIXES if file.name.lower().endswith(s)), None)
    data = load_bytes(file)  # a missing file is the better complaint than its suffix
    if suffix is None:
        raise BadInput(f"{file}: cannot tell the kind of file from its name; {', '.join(SUFFIXES)} can be read.")
    if suffix == ".parquet":
        table = parquet_table(data, str(file))
    else:
        table = csv_table(data, str(file), mapping.separator, mapping.decimal, zipped=suffix == ".csv.gz")
    _check_columns(table, mapping)
    if len(table) == 0:
        raise BadInput(f"{file} has column names but no rows; record something, or name another file.")
    time = _converted(table, mapping.time)
    channels = [c for c in mapping.channels if c.column in table.names]
    extra = [c for c in channels if c.signal in mapping.extra]
    return Recording(
        name=file.name[: -len(suffix)] or file.name,
        time=time,
        signals={channel.signal: _converted(table, channel) for channel in channels},
        runs=_runs(time, table, mapping),
        source=Source(path=str(path), sha256=hashlib.sha256(data).hexdigest(), columns=mapping.name),
        extra_units={channel.signal: channel.si_unit for channel in extra},
        hold=mapping.hold,
    )


def _converted(table: Table, column: Column) -> Array:
    with np.errstate(over="ignore", invalid="ignore"):
        values = column.convert(table.numbers(column.column))
        return np.where(np.abs(values) < LARGEST, values, np.nan)


def _runs(time: Array, table: Table, mapping: ColumnMap) -> tuple[tuple[int, int], ...]:
    runs = split_runs(time)
    if mapping.run_column not in table.names:
        return runs
    labels = table.labels(mapping.run_column)
    edges = {start for start, _ in runs} | {k for k in range(1, len(labels)) if labels[k] != labels[k - 1]}
    starts = sorted(edges)
    return tuple(zip(starts, [*starts[1:], len(time)], strict=True))


def _check_columns(table: Table, mapping: ColumnMap) -> None:
    needed = [c.column for c in (mapping.time, *mapping.channels) if not c.optional]
    if mapping.run_column and not mapping.run_column_optional:
        needed.append(mapping.run_column)
    for name in needed:
        if name not in table.names:
            raise BadInput(
                f'{table.where}: there is no column "{name}", which the column map "{mapping.name}" needs.'
                f"{did_you_mean(name, table.names)} {_what_there_is(table.names)}{_other_map(table.names, mapping)}"
            )
    if not any(c.column in table.names for c in mapping.channels):
        raise BadInput(
            f'{table.where}: the column map "{mapping.name}" finds none of its signals in this file. '
            f"{_what_there_is(table.names)}{_other_map(table.names, mapping)}"
        )


def _what_there_is(names: Sequence[str]) -> str:
    if one_column(tuple(names)):
        return one_column(tuple(names))
    listed = ", ".join(names[:40])
    return f"The file has {listed}{f' and {len(names) - 40} more' if len(names) > 40 else ''}."


def _other_map(names: Sequence[str], tried: ColumnMap) -> str:
    for name in shipped_maps():
        other = column_map(name)
        needed = [c.column for c in (other.time, *other.channels) if not c.optional]
        if other.name != tried.name and len(needed) > 1 and all(column in names for column in needed):
            return f' The shipped column map "{name}" fits this file: columns = "{name}", or --columns {name}.'
    return " Map the file's own names in a column map of your own (--columns my_map.toml)."
