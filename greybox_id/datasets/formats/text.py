"""Text files of rows and columns, also gzipped: CSV and loggers' variants with preambles, units and sources.

Long tables (one row per reading, with its channel's name) and lines of JSON become one group of columns per channel.

Loggers write various lines above the values: a preamble of narrower lines, names, units, the source of a channel. The
table is located by width: values are the rows that continue to the end, and names are in the nearest non-numeric lines
of that width above them.
"""

from __future__ import annotations

import codecs
import csv
import gzip
import io
import re
import warnings
import zlib
from collections import Counter
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from ...base.errors import BadInput
from ..column_map import SEPARATORS, ColumnMap
from ..raw_table import RawTable
from . import LARGEST, Columns, Contents, bounded, few_enough, one_column, whole
from .cells import DECIMAL_COMMA, NOTHING, as_numbers, is_value, stated_unit, unit_behind
from .long_table import apart_by_name
from .raw_can import must_hold_signals

SPACE = " "
"""Separator of columns: any number of blanks."""
SAMPLED = 400
"""Lines from which the layout is determined."""
NAMED = 0.8
"""Share of columns that a line of names must name; preambles are mostly blank at this width."""
HEADING_LINES = 4
"""Largest number of non-numeric lines between preamble and values: names, units, sources, one more."""
COMMENT = ("#", "%", "//")
STATISTICS = (
    "min", "max", "mean", "avg", "average", "minimum", "maximum", "median", "std", "stdev", "sigma", "mittel",
    "mittelwert", "maximal", "minimal",
)  # fmt: skip
"""First cells of rows with statistics of the columns."""
BETWEEN = 8
"""Largest number of numeric rows between names and values: statistics, channel numbers, rates."""
FEWEST_ABOVE = 20
"""Fewest rows above the last one to judge whether it has fewer cells or digits."""
_DEVICE = re.compile(r"^\d+\s*:\s*")


@dataclass(frozen=True)
class TableLayout:
    """Layout of the table in a text file.

    Attributes
    ----------
    separator : one of `SEPARATORS`, or SPACE.
    decimal : "." or ",".
    header : line of the names, from 0.
    first : first line of values, from 0.
    names : names of columns, without comment mark and blank ends, made unique.
    units : one per name; empty if the file states none.
    renamed : names that occur more than once, as in the file.
    between : numeric rows between names and values that are not samples.
    words : non-numeric rows among the values.
    cut : whether the file ends within its last row, which is left out.
    """

    separator: str
    decimal: str
    header: int
    first: int
    names: tuple[str, ...]
    units: tuple[str, ...]
    renamed: tuple[str, ...] = ()
    between: int = 0
    words: int = 0
    cut: bool = False


def layout_of(lines: Sequence[str], separator: str, decimal: str) -> TableLayout:
    """The layout of a file from its first lines; an empty separator or decimal mark is detected.

    Raises
    ------
    csv.Error
        The line of names is not valid CSV.
    """
    lines = lines[:SAMPLED]
    separator = separator or _separator(lines)
    rows = [_cells(line, separator) for line in lines]
    width = _width(rows)
    first = _first_values(rows, width)
    block, between = _words_above(rows, first, width) if first else ([], [])
    header = _line_of_names(rows, block, width)
    if header is None:  # the usual table: names in the first line
        header, block, between = 0, [], []
    below = [rows[k] for k in block if k > header]
    units: Sequence[str] = next((row for row in below if _is_units(row)), [])
    sources: Sequence[str] = next((row for row in below if row is not units), [])
    line = lines[header].lstrip("#% ") if lines and lines[header].startswith(COMMENT) else "".join(lines[header:][:1])
    names = [cell.strip() for cell in _cells(line, separator, strict=True)]
    while names and not names[-1]:  # a trailing separator in each line
        names.pop()
    known, renamed = _told_apart(names, sources)
    stated = tuple(stated_unit(units[k]) if k < len(units) else "" for k in range(len(names)))
    start = max((header, *block, *between)) + 1 if block else header + 1
    if block:  # blank lines may stand between names and values
        start = next((k for k in range(start, len(rows)) if any(rows[k])), start)
    if not decimal:
        comma = separator != "," and any(DECIMAL_COMMA.fullmatch(c) for row in rows[start : start + 5] for c in row)
        decimal = "," if comma else "."
    return TableLayout(separator, decimal, header, start, known, stated, renamed, len(between))


def _cells(line: str, separator: str, strict: bool = False) -> list[str]:
    """The cells of a line; a line that is not valid CSV is one cell."""
    if separator == SPACE:
        return line.split()
    try:
        return [cell.strip() for cell in next(csv.reader([line], delimiter=separator, skipinitialspace=True), [])]
    except csv.Error:
        if strict:
            raise
        return [line]


def _separator(lines: Sequence[str]) -> str:
    """The separator that splits most of the later lines into the same number of cells, at least two."""
    later = [line for line in lines[len(lines) // 2 :] if line.strip()]
    best: str = SEPARATORS[0]
    reached: tuple[int, int] | None = None
    for item in (*SEPARATORS, SPACE):
        widths = Counter(len(_cells(line, item)) for line in later)
        widths.pop(1, None)
        if not widths:
            continue
        merit = (max(widths.values()), -_split_numbers(later, item))  # decimal commas also split rows evenly
        if reached is None or merit > reached:
            best, reached = item, merit
    return best


def _split_numbers(lines: Sequence[str], separator: str) -> int:
    """Number of cells in the first lines that contain another separator and are no number or instant."""
    cells = [cell for line in lines[:20] for cell in _cells(line, separator)]
    others = [item for item in (*SEPARATORS, SPACE) if item != separator]
    return sum(1 for c in cells if not (is_value(c) or unit_behind(c)) and any(other in c for other in others))


def _width(rows: Sequence[Sequence[str]]) -> int:
    """Number of cells of the rows that continue to the end of the sample."""
    widths = Counter(len(row) for row in rows[len(rows) // 2 :] if any(row))
    return max(widths, key=lambda item: (widths[item], item)) if widths else 0


def _words(row: Sequence[str]) -> int:
    return sum(1 for cell in row if cell and not is_value(cell))


def _first_values(rows: Sequence[Sequence[str]], width: int) -> int:
    """Index of the first row of values."""
    wide = [row for row in rows[len(rows) // 2 :] if len(row) == width]
    usual = max((_words(row) for row in wide), default=0)  # number of text columns among the values
    for k, row in enumerate(rows):
        if len(row) >= width - 1 and len(row) > 0 and _words(row) <= usual and any(map(is_value, row)):
            later = [row for row in rows[k + 1 : k + 11] if any(row)]
            alike = sum(1 for item in later if len(item) >= width - 1 and _words(item) <= usual)
            if alike >= 0.5 * len(later) and not any(_is_units(row) or _sums_up(row) for row in later[:BETWEEN]):
                return k
    return 0


def _words_above(rows: Sequence[Sequence[str]], first: int, width: int) -> tuple[list[int], list[int]]:
    """Non-numeric lines of the table's width above the values, and numeric rows between them, from the top.

    Blank lines may lie between them, and up to `BETWEEN` full rows of statistics or channel numbers.
    """
    block: list[int] = []
    between: list[int] = []
    for k in range(first - 1, -1, -1):
        row = list(rows[k])
        while row and not row[-1]:
            row.pop()
        if not row:
            continue
        numbers = sum(1 for cell in row if is_value(cell) and cell != "1")
        if len(row) > width + 1 or len(row) < 0.3 * width or len(block) == HEADING_LINES:
            break
        if numbers > 0.2 * len(row):
            full = sum(map(bool, row)) >= NAMED * width and len(between) < BETWEEN
            if not full or not (_sums_up(row) or all(map(is_value, row))):
                break
            between.insert(0, k)
        else:
            block.insert(0, k)
    return block, [k for k in between if block and k > block[0]]


def _sums_up(row: Sequence[str]) -> bool:
    """Whether a row holds a statistic of each column, such as the minimum or the mean."""
    return bool(row) and row[0].strip("[]():= ").lower() in STATISTICS


def _line_of_names(rows: Sequence[Sequence[str]], block: Sequence[int], width: int) -> int | None:
    """The line of names: directly above the units or, without units, the topmost line that names nearly all columns."""
    full = [k for k in block if sum(1 for cell in rows[k] if cell) >= NAMED * width and not _is_units(rows[k])]
    units = next((k for k in block if _is_units(rows[k])), None)
    above = [k for k in full if units is None or k < units]
    if not above:  # the names are spelled like units, and no line is above them
        return next((k for k in block if sum(1 for cell in rows[k] if cell) >= NAMED * width), None)
    if units is not None:
        return above[-1]
    telling = [k for k in above if len(set(rows[k])) > 0.5 * len(rows[k])]
    return (telling or above)[0]


def _is_units(row: Sequence[str]) -> bool:
    """Whether most of a row's cells are units."""
    cells = [cell for cell in row if cell.strip("[]() ").lower() not in NOTHING]
    return bool(cells) and sum(1 for cell in cells if stated_unit(cell)) >= 0.6 * len(cells)


def _told_apart(names: Sequence[str], sources: Sequence[str]) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Unique names: repeated ones get their source, or else a number; and the repeated names."""
    counts = Counter(names)
    known: list[str] = []
    for k, name in enumerate(names):
        if counts[name] > 1 and name:
            source = _DEVICE.sub("", sources[k]).strip() if k < len(sources) else ""
            name = f"{name} {source}" if source else name
        number, plain = 2, name
        while name in known and name:
            name, number = f"{plain} {number}", number + 1
        known.append(name)
    return tuple(known), tuple(name for name, count in counts.items() if count > 1 and name)


LINE_END = re.compile(rb"\r\n|\r|\n")
_COMMENT_LINE = re.compile(rb"(?m)^[ \t]*(?:#|//)[^\r\n]*(?:\r\n|\r|\n|$)")
_OTHER_LETTERS = frozenset("°º²³µ·±–")
"""Characters other than letters that are allowed in names and units in the code page of Windows."""
KIND = "CSV"
GZIP = b"\x1f\x8b"
HEAD = 65_536
"""Bytes in which the layout is searched."""


def contents(file: Path, mapping: ColumnMap) -> Contents:
    """The table in a text file, zipped or not; a long table has one group per channel.

    Raises
    ------
    BadInput
        The bytes are not text, or the names and the rows do not form a table.
    """
    table, layout = csv_table(text_of_file(file), str(file), mapping.separator, mapping.decimal)
    return apart_by_name(table, KIND) or whole(table, KIND, notes_of(layout))


def text_of_file(file: Path) -> bytes:
    """The text of a file as UTF-8, unzipped. Raises `BadInput` if it is not text, or too long."""
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
    wide = _utf_16(data)
    if wide:
        try:
            data = data.decode(wide).encode()
        except UnicodeDecodeError as error:
            raise BadInput(
                f"{file} begins like UTF-16 text, but cannot be decoded as such ({error.reason}). Save it as UTF-8."
            ) from error
    return _utf_8(data.removeprefix(b"\xef\xbb\xbf"), str(file))


def _utf_16(data: bytes) -> str:
    """The codec if a text is UTF-16, by its byte order mark or by null bytes in every second place; else empty."""
    if data.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)):
        return "utf-16"
    begin = data[:HEAD]
    for code, nulls, letters in (("utf-16-le", begin[1::2], begin[::2]), ("utf-16-be", begin[::2], begin[1::2])):
        if nulls and nulls.count(0) > NAMED * len(nulls) and not letters.count(0):
            return code
    return ""


def _utf_8(data: bytes, where: str) -> bytes:
    """Text as UTF-8; letters and signs in the code page of Windows (a degree sign) are converted."""
    if b"\0" in data:
        raise BadInput(
            f"{where} is not a text file: it holds null bytes. Name a CSV file in UTF-8, or a .parquet file."
        )
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
        row = len(LINE_END.findall(data[: error.start])) + 1
        strange = f"byte 0x{data[error.start]:02x} in row {row}"
        raise BadInput(f"{where} is not UTF-8 text ({strange}). Save it as UTF-8, or name another file.") from error


def write(columns: Columns, path: Path) -> None:
    """Write columns with all digits, so that reading returns the same numbers; missing values are empty cells."""
    pd.DataFrame(dict(columns.values)).to_csv(path, index=False)


def csv_table(data: bytes, where: str, separator: str = "", decimal: str = "") -> tuple[RawTable, TableLayout]:
    """The table in the text of a CSV file, and its layout. Raises `BadInput` if it is not a table."""
    layout = laid_out(data, where, separator, decimal)
    names = layout.names
    parts = LINE_END.split(data, maxsplit=layout.first)
    body = without_sums(parts[layout.first], layout.separator) if len(parts) > layout.first else b""
    body = _COMMENT_LINE.sub(b"", body) if any(mark.encode() in body for mark in COMMENT[::2]) else body
    body, cut = without_cut(body, layout)
    layout = replace(layout, cut=cut)
    if not body.strip():
        units = {name: unit for name, unit in zip(names, layout.units, strict=True) if unit}
        empty = tuple(pd.Series([], dtype=float) for _ in names)
        return RawTable(where, names, empty, layout.first + 1, units), layout
    with as_sentences(where, layout):
        frame = pd.read_csv(io.BytesIO(body), **options(layout))
    return table_of(frame, layout, where)


def laid_out(data: bytes, where: str, separator: str = "", decimal: str = "") -> TableLayout:
    """The layout of a table, from the beginning of the text. Raises `BadInput` if there is none."""
    head = _head(data, separator, where)
    must_hold_signals(head, where)
    try:
        layout = layout_of(head or [""], separator, decimal)
    except csv.Error as error:
        raise BadInput(f"{where}: the header line cannot be read ({error}). Name one column per cell.") from error
    names = layout.names
    if not names:
        raise BadInput(f"{where}: row {layout.header + 1} is empty; it must hold the column names.")
    few_enough(len(names), where)
    if len(names) > 1 and all(is_value(name.partition(" ")[0]) for name in names):  # repeated ones have a number added
        raise BadInput(
            f"{where}: row {layout.header + 1} holds values in place of column names. Write the column "
            f"names above the values."
        )
    return layout


def table_of(frame: pd.DataFrame, layout: TableLayout, where: str) -> tuple[RawTable, TableLayout]:
    """Rows of values, keyed by column index, as a table without empty rows at the end.

    Raises `BadInput` for a row with more cells than there are names.
    """
    names, first_row = layout.names, layout.first + 1
    units = {name: unit for name, unit in zip(names, layout.units, strict=True) if unit}
    frame, of_cells, words = as_numbers(frame, layout.decimal)
    units |= {names[k]: unit for k, unit in of_cells.items()}
    filled = frame.notna().any(axis=1).to_numpy()
    frame = frame.iloc[: int(np.flatnonzero(filled)[-1]) + 1 if filled.any() else 0]
    overflow = frame[len(names)].notna().to_numpy() if len(names) in frame else np.empty(0)
    if overflow.any():
        raise BadInput(_too_long(where, int(np.argmax(overflow)) + first_row, names))
    places = [k for k in range(len(names)) if k in frame]
    chosen = tuple(names[k] for k in places)
    return RawTable(where, chosen, tuple(frame[k] for k in places), first_row, units), replace(layout, words=words)


def without_sums(body: bytes, separator: str) -> bytes:
    """The rows of values without statistics at the end."""
    for _ in range(BETWEEN):
        kept, _, last = body.rstrip().rpartition(b"\n")
        if not kept or not _sums_up(_cells(last[:HEAD].decode("utf-8", "ignore"), separator)):
            break
        body = kept + b"\n"
    return body


def without_cut(body: bytes, layout: TableLayout) -> tuple[bytes, bool]:
    """The rows without a last one that the file's end cut off, and whether there is one: it has no line end, and fewer
    cells than the rows above, or fewer digits in its last number.
    """
    if body.endswith((b"\n", b"\r")):
        return body, False
    kept = LINE_END.split(body[-HEAD:])[1:][-SAMPLED:]
    *above, last = [_cells(line.decode("utf-8", "ignore"), layout.separator) for line in kept] or [[]]
    if len(above) < FEWEST_ABOVE or not last:
        return body, False
    fewer = len(last) < np.median([len(row) for row in above])
    digits = [_digits(row[-1], layout.decimal) for row in above if row]
    shorter = _digits(last[-1], layout.decimal)
    behind, before = np.array(digits).T
    cut = fewer or shorter[0] < np.median(behind) or (shorter[0] == np.max(behind) == 0 and shorter[1] < np.min(before))
    return (body[: len(body) - len(kept[-1])], True) if cut else (body, False)


def _digits(cell: str, decimal: str) -> tuple[int, int]:
    """Number of digits after the decimal mark, and before it."""
    whole, _, rest = cell.strip().partition(decimal)
    return len(rest), len(whole.lstrip("+-"))


def _head(data: bytes, separator: str, where: str) -> list[str]:
    """The first lines, at least two complete ones."""
    ends = [match.end() for _, match in zip(range(2), LINE_END.finditer(data), strict=False)]
    cut = max(HEAD, *ends, 0) if len(ends) == 2 else len(data)
    head = data[:cut].decode("utf-8", "ignore").splitlines()
    if len(data) > cut and len(head) > 2 and not data[:cut].endswith((b"\n", b"\r")):
        head.pop()  # an incomplete line
    for item in [separator] if separator else SEPARATORS:
        few_enough(max((line.count(item) + 1 for line in head[:2]), default=0), where)
    return head


def options(layout: TableLayout) -> dict[str, Any]:
    """Options of pandas for the rows of values, with one column more than there are names."""
    # With one column more than the header names, a row that is too long is detected instead of shifting other cells.
    columns = list(range(len(layout.names) + 1))
    blanks = {"sep": r"\s+"} if layout.separator == SPACE else {"sep": layout.separator, "skipinitialspace": True}
    # Blank lines are rows, so that row numbers stay those of the file.
    return dict[str, Any](header=None, names=columns, index_col=False, decimal=layout.decimal, skip_blank_lines=False,
                          low_memory=False, encoding="utf-8", **blanks)  # fmt: skip


@contextmanager
def as_sentences(where: str, layout: TableLayout) -> Iterator[None]:
    """Convert errors of pandas about a table into `BadInput`."""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error", pd.errors.ParserWarning)
            yield
    except pd.errors.ParserError as error:
        raise BadInput(_not_a_table(str(error), where, layout)) from error
    except pd.errors.ParserWarning as error:  # the first row is more than one cell too long
        raise BadInput(_too_long(where, layout.first + 1, layout.names)) from error
    except (pd.errors.EmptyDataError, ValueError, OverflowError, csv.Error) as error:
        raise BadInput(f"{where} cannot be read as a table ({error}). Save it as plain CSV.") from error


def notes_of(layout: TableLayout) -> tuple[str, ...]:
    """Notes on how a table was read."""
    notes = []
    if layout.header:
        notes.append(f"{layout.header} lines above the names, which are in row {layout.header + 1}, were skipped.")
    if layout.between:
        notes.append(f"{layout.between} rows of numbers between names and values were skipped: they are not samples.")
    if layout.words:
        notes.append(f"rows of words among the values were skipped: {layout.words}.")
    if layout.cut:
        notes.append("the file ends within its last row, which was left out.")
    if layout.renamed:
        listed = ", ".join(layout.renamed[:6])
        notes.append(
            f"columns of the same name ({listed}) are distinguished by their source, or by a number after the name."
        )
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
