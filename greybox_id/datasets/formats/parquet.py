"""Parquet files."""

from __future__ import annotations

import io
from pathlib import Path
from typing import Any

import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq

from ..column_map import ColumnMap
from ..table import Table, unique_names
from .columns import Columns
from .contents import Contents, sound, whole

UNIT = b"unit"


KIND = "Parquet"


def contents(file: Path, _: ColumnMap) -> Contents:
    """The table in a Parquet file; a field's metadata may state its unit.

    Raises
    ------
    BadInput
        The bytes are no undamaged Parquet file.
    """
    with sound(str(file), KIND):
        table = pq.read_table(io.BytesIO(file.read_bytes()))
        names = tuple(str(name) for name in table.column_names)
        unique_names(names, str(file))
        columns = tuple(_series(table.column(k)) for k in range(table.num_columns))
        units = {
            str(field.name): field.metadata[UNIT].decode() for field in table.schema if UNIT in (field.metadata or {})
        }
    return whole(Table(str(file), names, columns, 1, units), KIND)


def write(columns: Columns, path: Path) -> None:
    """Write columns with their units as metadata of the fields."""
    fields = [
        pa.field(name, pa.from_numpy_dtype(values.dtype), metadata={UNIT: columns.units.get(name, "1").encode()})
        for name, values in columns.values.items()
    ]
    pq.write_table(pa.table(list(map(pa.array, columns.values.values())), schema=pa.schema(fields)), path)


def _series(column: pa.ChunkedArray) -> pd.Series[Any]:
    if pa.types.is_decimal(column.type):
        column = column.cast(pa.float64())
    return pd.Series(column.to_pandas())
