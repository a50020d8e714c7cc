"""Files as tables of named columns, with the row numbers a person sees in the file."""

from __future__ import annotations

import csv
import gzip
import io
import re
import warnings
import zlib
from collections import Counter
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq

from ..errors import BadInput
from ..recording import Array

_LINE_END = re.compile(rb"\r\n|\r|\n")
_DECIMAL_COMMA = re.compile(r"[+-]?\d+,\d+")


@dataclass(frozen=True)
class Table:
    """Columns of a file.

    Attributes
    ----------
    where : the file as the user named it.
    names : column names, in the file's order.
    columns : the values, one series each.
    first_row : number of the first row of values as a person counts: 2 below a header line, else 1.
    """

    where: str
    names: tuple[str, ...]
    columns: tuple[pd.Series[Any], ...]
    first_row: int

    def __len__(self) -> int:
        return len(self.columns[0]) if self.columns else 0

    def numbers(self, name: str) -> Array:
        """(n,) values of a column; NaN where a cell is empty.

        Raises
        ------
        BadInput
            A cell holds something that is no number: names the row and the cell.
        """
        column = self.columns[self.names.index(name)]
        if pd.api.types.is_numeric_dtype(column.dtype) and not pd.api.types.is_bool_dtype(column.dtype):
            return column.to_numpy(dtype=float, na_value=np.nan)
        text = column.astype("string").str.strip()
        values = pd.to_numeric(text, errors="coerce").to_numpy(dtype=float, na_value=np.nan)
        strange = np.isnan(values) & text.notna().to_numpy() & (text != "").fillna(False).to_numpy(dtype=bool)
        if strange.any():
            row = int(np.argmax(strange))
            found = str(text.iloc[row])
            advice = (
                'Set decimal = "," and separator = ";" in the column map.'
                if _DECIMAL_COMMA.fullmatch(found)
                else "Mend the cell, or leave it empty if the value is missing."
            )
            raise BadInput(
                f'{self.where}: column "{name}", row {row + self.first_row}: {found!r:.60} is not a number. {advice}'
            )
        return values

    def labels(self, name: str) -> list[str]:
        """(n,) values of a column as text, for telling rows apart."""
        return [str(value) for value in self.columns[self.names.index(name)].tolist()]


def load_bytes(file: Path) -> bytes:
    """The file's bytes, or a sentence why there are none."""
    try:
        if file.is_dir():
            raise BadInput(f"{file} is a folder; name a file in it.")
        data = file.read_bytes()
    except FileNotFoundError as error:
        raise BadInput(f"{file}: there is no such file. Check the path.") from error
    except PermissionError as error:
        raise BadInput(f"{file} may not be read: permission denied. Change its permissions.") from error
    except (OSError, ValueError) as error:  # ValueError: a null byte in the path
        reason = error.strerror if isinstance(error, OSError) and error.strerror else "no valid path"
        raise BadInput(f"{file} cannot be read ({reason}). Check the path.") from error
    if not data:
        raise BadInput(f"{file} is empty (0 bytes). Name a file with a recording in it.")
    return data


def csv_table(data: bytes, where: str, separator: str = ",", decimal: str = ".", zipped: bool = False) -> Table:
    """The table in a CSV file with one header line.

    Raises
    ------
    BadInput
        The bytes are not UTF-8 text, the header line or the rows do not form a table.
    """
    if zipped:
        try:
            data = gzip.decompress(data)
        except (OSError, EOFError, zlib.error) as error:
            raise BadInput(f"{where} is damaged: it cannot be unzipped ({error}). Fetch it again.") from error
    data = data.removeprefix(b"\xef\xbb\xbf")
    if b"\0" in data:
        raise BadInput(f"{where} is no text file: it holds null bytes. Name a CSV file in UTF-8, or a .parquet file.")
    try:
        data.decode("utf-8")
    except UnicodeDecodeError as error:
        row = len(_LINE_END.findall(data[: error.start])) + 1
        strange = f"byte 0x{data[error.start]:02x} in row {row}"
        raise BadInput(f"{where} is not UTF-8 text ({strange}). Save it as UTF-8, or name another file.") from error
    head, *rest = _LINE_END.split(data, maxsplit=1)
    body = rest[0] if rest else b""
    names = _header(head.decode("utf-8"), separator, where)
    if not body.strip():
        return Table(where, names, tuple(pd.Series([], dtype=float) for _ in names), 2)
    try:
        # One column more than the header names: a row that is too long shows itself there instead of shifting others.
        with warnings.catch_warnings():
            warnings.simplefilter("error", pd.errors.ParserWarning)
            frame = pd.read_csv(
                io.BytesIO(body),
                header=None,
                names=list(range(len(names) + 1)),
                index_col=False,
                sep=separator,
                decimal=decimal,
                skip_blank_lines=False,  # so that row numbers stay those of the file
                skipinitialspace=True,
                low_memory=False,
                encoding="utf-8",
            )
    except pd.errors.ParserError as error:
        raise BadInput(_not_a_table(str(error), where, names)) from error
    except pd.errors.ParserWarning as error:  # the first row is more than one cell too long
        raise BadInput(_too_long(where, 2, names)) from error
    except (pd.errors.EmptyDataError, ValueError, OverflowError, csv.Error) as error:
        raise BadInput(f"{where} cannot be read as a table ({error}). Save it as plain CSV.") from error
    filled = frame.notna().any(axis=1).to_numpy()
    frame = frame.iloc[: int(np.flatnonzero(filled)[-1]) + 1 if filled.any() else 0]
    overflow = frame[len(names)].notna().to_numpy()
    if overflow.any():
        raise BadInput(_too_long(where, int(np.argmax(overflow)) + 2, names))
    return Table(where, names, tuple(frame[k] for k in range(len(names))), 2)


def parquet_table(data: bytes, where: str) -> Table:
    """The table in a Parquet file.

    Raises
    ------
    BadInput
        The bytes are no undamaged Parquet file.
    """
    damaged = (pa.ArrowException, OSError, ValueError, KeyError, TypeError, OverflowError, MemoryError)
    try:
        table = pq.read_table(io.BytesIO(data))
        names = tuple(str(name) for name in table.column_names)
        _unique(names, where)
        columns = tuple(_series(table.column(k)) for k in range(table.num_columns))
    except damaged as error:
        reason = str(error).splitlines()[0] if str(error) else type(error).__name__
        raise BadInput(f"{where} is not a sound Parquet file ({reason:.120}). Write or fetch it again.") from error
    return Table(where, names, columns, 1)


def _series(column: pa.ChunkedArray) -> pd.Series[Any]:
    if pa.types.is_decimal(column.type):
        column = column.cast(pa.float64())
    return pd.Series(column.to_pandas())


def _header(line: str, separator: str, where: str) -> tuple[str, ...]:
    try:
        cells = next(csv.reader([line], delimiter=separator), [])
    except csv.Error as error:
        raise BadInput(f"{where}: the header line cannot be read ({error}). Name one column per cell.") from error
    names = [cell.strip() for cell in cells]
    while names and not names[-1]:  # a comma at the end of each line
        names.pop()
    if not names:
        raise BadInput(f"{where}: row 1 is empty; it must hold the column names.")
    _unique(tuple(names), where)
    return tuple(names)


def _unique(names: tuple[str, ...], where: str) -> None:
    twice = [name for name, count in Counter(names).items() if count > 1]
    if twice:
        raise BadInput(
            f'{where}: column name "{twice[0]}" stands there {names.count(twice[0])} times. Rename all but one.'
        )


def one_column(names: tuple[str, ...]) -> str:
    """A hint for a header line that was not split; empty if it was."""
    if len(names) > 1 or not any(separator in names[0] for separator in ";\t|"):
        return ""
    return f'The whole header line was read as one column, {names[0]!r:.80}; set separator = ";" in the column map.'


def _too_long(where: str, row: int, names: tuple[str, ...]) -> str:
    advice = one_column(names) or "Mend that row."
    return f"{where}: row {row} has more cells than the header line has names ({len(names)}). {advice}"


def _not_a_table(message: str, where: str, names: tuple[str, ...]) -> str:
    too_long = re.search(r"in line (\d+), saw (\d+)", message)
    if too_long:
        return _too_long(where, int(too_long.group(1)) + 1, names)
    unclosed = re.search(r"EOF inside string starting at row (\d+)", message)
    if unclosed:
        return f"{where}: row {int(unclosed.group(1)) + 2}: a quotation mark is opened and never closed. Mend that row."
    return f"{where} cannot be read as a table ({message.strip()}). Save it as plain CSV."
