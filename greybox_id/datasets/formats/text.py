"""CSV files, also gzipped: one header line, then rows."""

from __future__ import annotations

import codecs
import csv
import gzip
import io
import re
import warnings
import zlib
from pathlib import Path

import numpy as np
import pandas as pd

from ...base.errors import BadInput
from ..column_map import ColumnMap
from .contents import LARGEST, Columns, Contents, RawTable, bounded, few_enough, one_column, unique_names, whole

_LINE_END = re.compile(rb"\r\n|\r|\n")


KIND = "CSV"
GZIP = b"\x1f\x8b"


def contents(file: Path, mapping: ColumnMap) -> Contents:
    """The table in a CSV file with one header line, zipped or not.

    Raises
    ------
    BadInput
        The bytes are not UTF-8 text, the header line or the rows do not form a table.
    """
    bounded(file.stat().st_size, str(file))
    data = file.read_bytes()
    if data.startswith(GZIP) or file.name.lower().endswith(".gz"):
        try:
            with gzip.open(io.BytesIO(data)) as opened:
                data = opened.read(LARGEST + 1)
        except (OSError, EOFError, zlib.error) as error:
            raise BadInput(f"{file} is damaged: it cannot be unzipped ({error}). Fetch it again.") from error
        if len(data) > LARGEST:
            raise BadInput(
                f"{file} holds more than {LARGEST / 1e9:g} GB of text once it is unzipped, which is the most that is "
                "read. Cut it into parts, or leave columns out."
            )
    if data.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)):
        try:
            data = data.decode("utf-16").encode()
        except UnicodeDecodeError as error:
            raise BadInput(f"{file} begins as UTF-16 text, but is none ({error.reason}). Save it as UTF-8.") from error
    return whole(csv_table(data, str(file), mapping.separator, mapping.decimal), KIND)


def write(columns: Columns, path: Path) -> None:
    """Write columns as numbers that read back exactly; a missing value is an empty cell."""
    pd.DataFrame(dict(columns.values)).to_csv(path, index=False)


def csv_table(data: bytes, where: str, separator: str = ",", decimal: str = ".") -> RawTable:
    """The table in the bytes of a CSV file. Raises `BadInput` where they form none."""
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
    few_enough(len(names), where)
    if not body.strip():
        return RawTable(where, names, tuple(pd.Series([], dtype=float) for _ in names), 2)
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
    return RawTable(where, names, tuple(frame[k] for k in range(len(names))), 2)


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
    unique_names(tuple(names), where)
    return tuple(names)


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
