"""Long text files, read in blocks of rows; only the columns that the map names are kept, as numbers.

A file of hours is larger as text than as numbers, and parsing it at once takes several times its size. Files that are
not a regular table of numbers (with comments, letters that are not UTF-8, columns that mix words and numbers) are left
to `text`.
"""

from __future__ import annotations

import codecs
import gzip
import io
import zlib
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, BinaryIO, cast

import pandas as pd
from pandas.api.types import is_bool_dtype, is_numeric_dtype

from ..column_map import ColumnMap
from . import LARGEST, Contents, Group
from .long_table import apart_by_name
from .text import (
    COMMENT,
    GZIP,
    HEAD,
    KIND,
    LINE_END,
    TableLayout,
    as_sentences,
    laid_out,
    notes_of,
    options,
    table_of,
    without_cut,
    without_sums,
)  # fmt: skip

ROWS = 100_000
"""Rows per block: some MB of text."""
AT_ONCE = 4 * 1024 * 1024
"""Bytes scanned at a time."""


def contents(file: Path, mapping: ColumnMap) -> Contents | None:
    """The columns of a file that a map names, or all if it names none; None if `text` must read the file.

    Raises
    ------
    BadInput
        The names and the rows do not form a table.
    """
    ends = _ends(file)
    if ends is None:
        return None
    head, tail, size = ends
    layout = laid_out(head, str(file), mapping.separator, mapping.decimal)
    above = LINE_END.split(head, maxsplit=layout.first)
    if len(above) <= layout.first or not above[-1].strip():
        return None
    kept, cut = without_cut(without_sums(tail, layout.separator), layout)
    with _opened(file) as opened:
        rows = _Rows(opened, len(head) - len(above[-1]), size - len(tail) + len(kept))
        with as_sentences(str(file), layout):
            frame = _frame(rows, layout, _places(mapping, layout))
    if frame is None:
        return None
    table, layout = table_of(frame, replace(layout, cut=cut), str(file))
    if apart_by_name(table, KIND) is not None:
        return None
    group = Group("", layout.names, lambda _: table, units=table.units)
    return Contents(str(file), (group,), KIND, notes_of(layout))


def _opened(file: Path) -> BinaryIO:
    with file.open("rb") as begins:
        zipped = begins.read(2) == GZIP
    return cast("BinaryIO", gzip.open(file)) if zipped else file.open("rb")


def _ends(file: Path) -> tuple[bytes, bytes, int] | None:
    """First and last bytes of a text and its length; None if it is not a regular table."""
    decoder, head, tail, size = codecs.getincrementaldecoder("utf-8")(), b"", b"", 0
    try:
        with _opened(file) as opened:
            while block := opened.read(AT_ONCE):
                seam = tail[-1:] + block
                if b"\0" in block or any(mark.encode() in seam for mark in COMMENT[::2]):
                    return None
                if not block.isascii() or decoder.getstate()[0]:
                    decoder.decode(block)
                head += block[: max(0, 2 * HEAD - len(head))]
                tail, size = (tail + block)[-2 * HEAD :], size + len(block)
        decoder.decode(b"", final=True)
    except (OSError, EOFError, zlib.error, UnicodeDecodeError):
        return None
    return None if size > LARGEST or head.startswith(codecs.BOM_UTF8) else (head, tail, size)


class _Rows(io.RawIOBase):
    """The bytes of a file between two positions, as a stream."""

    def __init__(self, opened: BinaryIO, start: int, stop: int) -> None:
        self._opened, self._left = opened, stop - start
        opened.seek(start)

    def readable(self) -> bool:
        """Always."""
        return True

    def readinto(self, buffer: Any) -> int:
        """As `io.RawIOBase` does."""
        view = memoryview(buffer)
        data = self._opened.read(min(len(view), self._left))
        view[: len(data)] = data
        self._left -= len(data)
        return len(data)


def _places(mapping: ColumnMap, layout: TableLayout) -> list[int]:
    """Indices of the columns that a map names; of all columns if it names none of this file."""
    everywhere = list(range(len(layout.names)))
    if not mapping.channels:
        return everywhere
    columns = (mapping.time, *mapping.channels)
    names = {name for column in columns for name in (*column.names, *column.otherwise)}
    names |= {mapping.run_column, mapping.start_column}
    names |= {name.rpartition("/")[2] for name in names}  # names qualified by one of several files
    return [k for k in everywhere if layout.names[k] in names] or everywhere


def _frame(rows: _Rows, layout: TableLayout, places: list[int]) -> pd.DataFrame | None:
    """Columns of a table, read block by block; None if one mixes words and numbers, or there is no row."""
    pieces: dict[int, list[pd.Series[Any]]] = {k: [] for k in (*places, len(layout.names))}
    text = io.BufferedReader(rows, HEAD)
    with pd.read_csv(text, **options(layout), chunksize=ROWS) as reader:
        for block in reader:
            for k, series in pieces.items():
                series.append(block[k].copy())
    columns = {}
    for k in list(pieces):
        series = pieces.pop(k)
        if k == len(layout.names) and not any(piece.notna().any() for piece in series):
            continue
        if not series or not _of_one_kind(series):
            return None
        columns[k] = pd.concat(series, ignore_index=True)
    return pd.DataFrame(columns, copy=False)


def _of_one_kind(pieces: Sequence[pd.Series[Any]]) -> bool:
    """Whether the non-empty pieces of a column are all numeric, or none is."""
    numbers = {is_numeric_dtype(p.dtype) and not is_bool_dtype(p.dtype) for p in pieces if p.notna().any()}
    return len(numbers) < 2
