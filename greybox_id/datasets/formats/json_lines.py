"""JSON: lines or a list of objects, each a row of columns or a single reading with name and time (OpenXC).

Also one object that holds columns as lists, or such a list of objects.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pandas as pd

from ...base.errors import BadInput
from ..column_map import ColumnMap
from ..raw_table import RawTable
from . import Contents, few_enough, whole
from .long_table import apart_by_name
from .text import text_of_file

KIND = "JSON lines"
DEEPEST = 4
"""Nesting depth of objects whose numbers become columns, such as `pose.position.x`."""
SHORT_LISTS = 16
"""Longest list whose elements become separate columns."""


def contents(file: Path, _: ColumnMap) -> Contents:
    """The columns of a file with an object in each line, with one list of objects, or with one object of lists.

    Raises
    ------
    BadInput
        A line is not a JSON object: the error names the row.
    """
    text = text_of_file(file).decode()
    rows = _rows(text, str(file))
    if not rows:
        raise BadInput(f"{file} holds no rows; record something, or name another file.")
    flat = [_flat(row) for row in rows]
    names = tuple(dict.fromkeys(name for row in flat for name in row))
    few_enough(len(names), str(file))
    columns = tuple(pd.Series([row.get(name) for row in flat]) for name in names)
    numeric = tuple(c if pd.api.types.is_numeric_dtype(c.dtype) else c.infer_objects() for c in columns)
    table = RawTable(str(file), names, numeric, 1)
    return apart_by_name(table, KIND) or whole(table, KIND)


def _rows(text: str, where: str) -> list[dict[str, Any]]:
    """The objects of a file."""
    if text.lstrip().startswith("["):
        return _listed(text, where)
    lines = [line for line in text.splitlines() if line.strip()]
    first = lines[0] if lines else ""
    if len(lines) > 1 and not (first.rstrip().endswith("}") and first.lstrip().startswith("{")):  # one multi-line one
        return _within(_object(text, where)) or _lines(text, where)
    rows = _lines(text, where)
    return (_within(rows[0]) or rows) if len(rows) == 1 else rows


def _within(whole: dict[str, Any]) -> list[dict[str, Any]]:
    """The rows in one object: its longest list of objects, or else its lists of equal length as columns."""
    lists = {key: item for key, item in whole.items() if isinstance(item, list) and len(item) > 1}
    rows = [item for item in lists.values() if all(isinstance(row, dict) for row in item)]
    if rows:
        return max(rows, key=len)
    columns = {key: item for key, item in lists.items() if not any(isinstance(cell, dict | list) for cell in item)}
    if not columns or len({len(item) for item in columns.values()}) > 1:
        inside = [_within(item) for item in whole.values() if isinstance(item, dict)]
        return max(inside, key=len, default=[])
    return [dict(zip(columns, cells, strict=True)) for cells in zip(*columns.values(), strict=True)]


def _lines(text: str, where: str) -> list[dict[str, Any]]:
    return [_object(line, f"{where}: row {k}") for k, line in enumerate(text.splitlines(), 1) if line.strip()]


def _listed(text: str, where: str) -> list[dict[str, Any]]:
    rows = _parsed(text, where)
    if not isinstance(rows, list) or not all(isinstance(row, dict) for row in rows):
        raise BadInput(
            f"{where}: the file must hold a list with one object for each row; write it in this form, or as CSV."
        )
    return rows


def _object(line: str, where: str) -> dict[str, Any]:
    row = _parsed(line, where)
    if not isinstance(row, dict):
        raise BadInput(
            f"{where}: {line.strip():.40} is not a JSON object; write one object for each row, or a CSV file."
        )
    return row


def _parsed(text: str, where: str) -> Any:
    try:
        return json.loads(text)
    except (ValueError, RecursionError) as error:
        reason = "brackets are nested too deep" if isinstance(error, RecursionError) else str(error)
        raise BadInput(f"{where} is not JSON ({reason:.80}). Mend it, or write CSV.") from error


def _flat(row: dict[str, Any], path: str = "", depth: int = 0) -> dict[str, Any]:
    """The scalars of an object, by path."""
    flat: dict[str, Any] = {}
    for key, value in row.items():
        name = f"{path}{key}"
        if isinstance(value, dict) and depth < DEEPEST:
            flat.update(_flat(value, f"{name}.", depth + 1))
        elif isinstance(value, list) and len(value) <= SHORT_LISTS:
            flat.update({f"{name}[{k}]": item for k, item in enumerate(value) if not isinstance(item, dict | list)})
        elif not isinstance(value, dict | list):
            flat[name] = value
    return flat
