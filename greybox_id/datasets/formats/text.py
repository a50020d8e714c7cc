"""Text files of rows and columns, also gzipped: CSV and what loggers make of it, with preambles, units and sources.

Long tables (a row for every reading, its channel's name beside it) and lines of JSON become a group of columns for
each channel.
"""

from __future__ import annotations

import codecs
import csv
import gzip
import io
import re
import warnings
import zlib
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from ...base.errors import BadInput
from ..column_map import SEPARATORS, ColumnMap
from .contents import LARGEST, Columns, Contents, RawTable, bounded, few_enough, one_column, whole
from .layout import COMMENT, SPACE, TableLayout, layout_of
from .long_tables import apart_by_name

_LINE_END = re.compile(rb"\r\n|\r|\n")
_COMMENT_LINE = re.compile(rb"(?m)^[ \t]*(?:#|//)[^\r\n]*(?:\r\n|\r|\n|$)")
_OTHER_LETTERS = frozenset("°º²³µ·±–")
"""Beside letters, what is not ASCII in names and units that Windows wrote in its own code page."""
KIND = "CSV"
GZIP = b"\x1f\x8b"
HEAD = 65_536
"""Bytes in which the layout is looked for."""


def contents(file: Path, mapping: ColumnMap) -> Contents:
    """The table in a text file, zipped or not; of a long table a group for every channel.

    Raises
    ------
    BadInput
        The bytes are no text, or the line of names and the rows do not form a table.
    """
    table, layout = csv_table(text_of_file(file), str(file), mapping.separator, mapping.decimal)
    return apart_by_name(table, KIND) or whole(table, KIND, _notes(layout))


def text_of_file(file: Path) -> bytes:
    """The text of a file as UTF-8, unzipped. Raises `BadInput` where it is none, or too long."""
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
    return _utf_8(data.removeprefix(b"\xef\xbb\xbf"), str(file))


def _utf_8(data: bytes, where: str) -> bytes:
    """Text as UTF-8; names and units in the code page of Windows (a degree sign) are understood."""
    if b"\0" in data:
        raise BadInput(f"{where} is no text file: it holds null bytes. Name a CSV file in UTF-8, or a .parquet file.")
    try:
        data.decode("utf-8")
        return data
    except UnicodeDecodeError as error:
        try:
            text = data.decode("cp1252")
        except UnicodeDecodeError:
            text = "\x80"
        if all(c.isascii() or c.isalpha() or c in _OTHER_LETTERS for c in set(text)):
            return text.encode()
        row = len(_LINE_END.findall(data[: error.start])) + 1
        strange = f"byte 0x{data[error.start]:02x} in row {row}"
        raise BadInput(f"{where} is not UTF-8 text ({strange}). Save it as UTF-8, or name another file.") from error


def write(columns: Columns, path: Path) -> None:
    """Write columns as numbers that read back exactly; a missing value is an empty cell."""
    pd.DataFrame(dict(columns.values)).to_csv(path, index=False)


def csv_table(data: bytes, where: str, separator: str = "", decimal: str = "") -> tuple[RawTable, TableLayout]:
    """The table in the text of a CSV file, and how it lies there. Raises `BadInput` where it forms none."""
    head = _head(data, separator, where)
    try:
        layout = layout_of(head or [""], separator, decimal)
    except csv.Error as error:
        raise BadInput(f"{where}: the header line cannot be read ({error}). Name one column per cell.") from error
    names = layout.names
    if not names:
        raise BadInput(f"{where}: row {layout.header + 1} is empty; it must hold the column names.")
    few_enough(len(names), where)
    parts = _LINE_END.split(data, maxsplit=layout.first)
    body = parts[layout.first] if len(parts) > layout.first else b""
    body = _COMMENT_LINE.sub(b"", body) if any(mark.encode() in body for mark in COMMENT[::2]) else body
    first_row = layout.first + 1
    units = {name: unit for name, unit in zip(names, layout.units, strict=True) if unit}
    if not body.strip():
        return RawTable(where, names, tuple(pd.Series([], dtype=float) for _ in names), first_row, units), layout
    frame = _frame(body, layout, where)
    filled = frame.notna().any(axis=1).to_numpy()
    frame = frame.iloc[: int(np.flatnonzero(filled)[-1]) + 1 if filled.any() else 0]
    overflow = frame[len(names)].notna().to_numpy()
    if overflow.any():
        raise BadInput(_too_long(where, int(np.argmax(overflow)) + first_row, names))
    return RawTable(where, names, tuple(frame[k] for k in range(len(names))), first_row, units), layout


def _head(data: bytes, separator: str, where: str) -> list[str]:
    """The first lines, two whole ones at least."""
    ends = [match.end() for _, match in zip(range(2), _LINE_END.finditer(data), strict=False)]
    cut = max(HEAD, *ends, 0) if len(ends) == 2 else len(data)
    head = data[:cut].decode("utf-8", "ignore").splitlines()
    if len(data) > cut and len(head) > 2 and not data[:cut].endswith((b"\n", b"\r")):
        head.pop()  # cut off
    for item in [separator] if separator else SEPARATORS:
        few_enough(max((line.count(item) + 1 for line in head[:2]), default=0), where)
    return head


def _frame(body: bytes, layout: TableLayout, where: str) -> pd.DataFrame:
    """The rows of values, one column more than there are names."""
    names, options = layout.names, dict[str, Any](sep=layout.separator, skipinitialspace=True)
    if layout.separator == SPACE:
        options = {"sep": r"\s+"}
    try:
        # One column more than the header names: a row that is too long shows itself there instead of shifting others.
        with warnings.catch_warnings():
            warnings.simplefilter("error", pd.errors.ParserWarning)
            frame: pd.DataFrame = pd.read_csv(
                io.BytesIO(body),
                header=None,
                names=list(range(len(names) + 1)),
                index_col=False,
                decimal=layout.decimal,
                skip_blank_lines=False,  # so that row numbers stay those of the file
                low_memory=False,
                encoding="utf-8",
                **options,
            )
            return frame
    except pd.errors.ParserError as error:
        raise BadInput(_not_a_table(str(error), where, layout)) from error
    except pd.errors.ParserWarning as error:  # the first row is more than one cell too long
        raise BadInput(_too_long(where, layout.first + 1, names)) from error
    except (pd.errors.EmptyDataError, ValueError, OverflowError, csv.Error) as error:
        raise BadInput(f"{where} cannot be read as a table ({error}). Save it as plain CSV.") from error


def _notes(layout: TableLayout) -> tuple[str, ...]:
    notes = []
    if layout.header:
        notes.append(
            f"{layout.header} lines above the names, which stand in row {layout.header + 1}, were passed over."
        )
    if layout.renamed:
        listed = ", ".join(layout.renamed[:6])
        notes.append(f"columns of one name ({listed}) are distinguished by their source or by a number behind it.")
    return tuple(notes)


def _too_long(where: str, row: int, names: tuple[str, ...]) -> str:
    advice = one_column(names) or "Mend that row."
    return f"{where}: row {row} has more cells than the header line has names ({len(names)}). {advice}"


def _not_a_table(message: str, where: str, layout: TableLayout) -> str:
    too_long = re.search(r"in line (\d+), saw (\d+)", message)
    if too_long:
        return _too_long(where, int(too_long.group(1)) + layout.first, layout.names)
    unclosed = re.search(r"EOF inside string starting at row (\d+)", message)
    if unclosed:
        row = int(unclosed.group(1)) + layout.first + 1
        return f"{where}: row {row}: a quotation mark is opened and never closed. Mend that row."
    return f"{where} cannot be read as a table ({message.strip()}). Save it as plain CSV."
