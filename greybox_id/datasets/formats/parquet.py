"""Parquet files."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq

from ..column_map import ColumnMap
from ..raw_table import RawTable
from . import Columns, Contents, Group, bounded, few_enough, sound, unique_names

UNIT = b"unit"
KIND = "Parquet"


def contents(file: Path, _: ColumnMap) -> Contents:
    """The table in a Parquet file; a field's metadata may state its unit.

    Raises
    ------
    BadInput
        The file is not a Parquet file, or is damaged.
    """
    where = str(file)

    def load(target: Sequence[str]) -> RawTable:
        with sound(where, KIND):
            chosen = list(dict.fromkeys(target))
            with pq.ParquetFile(file) as opened:
                bounded(max(8.0 * opened.metadata.num_rows * len(chosen), _bytes(opened.metadata, chosen)), where)
                table = opened.read(chosen)
            columns = tuple(_series(table.column(name)) for name in chosen)
        return RawTable(where, tuple(chosen), columns, 1)

    with sound(where, KIND):
        schema = pq.read_schema(file)
        names = tuple(str(name) for name in schema.names)
        few_enough(len(names), where)
        unique_names(names, where)
        units = {str(item.name): item.metadata[UNIT].decode() for item in schema if UNIT in (item.metadata or {})}
    return Contents(where, (Group("", names, load, units=units),), KIND)


def write(columns: Columns, path: Path) -> None:
    """Write columns, with their units as metadata of the fields."""
    fields = [
        pa.field(name, pa.from_numpy_dtype(values.dtype), metadata={UNIT: columns.units.get(name, "1").encode()})
        for name, values in columns.values.items()
    ]
    pq.write_table(pa.table(list(map(pa.array, columns.values.values())), schema=pa.schema(fields)), path)


def _bytes(file_meta_data: pq.FileMetaData, chosen: Sequence[str]) -> float:
    """Uncompressed size of columns, as stated in the file."""
    whole = set(chosen)
    result = 0.0
    for group in (file_meta_data.row_group(k) for k in range(file_meta_data.num_row_groups)):
        for item in (group.column(k) for k in range(group.num_columns)):
            path = item.path_in_schema
            if path in whole or path.partition(".")[0] in whole:
                result += item.total_uncompressed_size
    return result


def _series(column: pa.ChunkedArray) -> pd.Series[Any]:
    return pd.Series((column.cast(pa.float64()) if pa.types.is_decimal(column.type) else column).to_pandas())
