"""Lines of JSON, an object each: a row of columns, or a reading with its name and time, as OpenXC traces are."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pandas as pd

from ...base.errors import BadInput
from ..column_map import ColumnMap
from . import Contents, RawTable, apart_by_name, few_enough, whole
from .text import text_of_file

KIND = "JSON lines"
DEEPEST = 4
"""Objects in objects whose numbers are columns, `pose.position.x`."""
SHORT_LISTS = 16
"""Elements of a list that are columns of their own."""


def contents(file: Path, _: ColumnMap) -> Contents:
    """The columns of a file with an object in each line, or with one list of objects.

    Raises
    ------
    BadInput
        A line is no object of JSON: names the row.
    """
    text = text_of_file(file).decode()
    rows = _listed(text, str(file)) if text.lstrip().startswith("[") else _lines(text, str(file))
    if not rows:
        raise BadInput(f"{file} holds no rows; record something, or name another file.")
    flat = [_flat(row) for row in rows]
    names = tuple(dict.fromkeys(name for row in flat for name in row))
    few_enough(len(names), str(file))
    columns = tuple(pd.Series([row.get(name) for row in flat]) for name in names)
    numeric = tuple(c if pd.api.types.is_numeric_dtype(c.dtype) else c.infer_objects() for c in columns)
    table = RawTable(str(file), names, numeric, 1)
    return apart_by_name(table, KIND) or whole(table, KIND)


def _lines(text: str, where: str) -> list[dict[str, Any]]:
    return [_object(line, f"{where}: row {k}") for k, line in enumerate(text.splitlines(), 1) if line.strip()]


def _listed(text: str, where: str) -> list[dict[str, Any]]:
    rows = _parsed(text, where)
    if not isinstance(rows, list) or not all(isinstance(row, dict) for row in rows):
        raise BadInput(f"{where}: a list of objects is read, one for each row; write it so, or as CSV.")
    return rows


def _object(line: str, where: str) -> dict[str, Any]:
    row = _parsed(line, where)
    if not isinstance(row, dict):
        raise BadInput(f"{where}: {line.strip():.40} is no object; write one for each row, or CSV.")
    return row


def _parsed(text: str, where: str) -> Any:
    try:
        return json.loads(text)
    except (ValueError, RecursionError) as error:
        reason = "brackets are nested too deep" if isinstance(error, RecursionError) else str(error)
        raise BadInput(f"{where} is no JSON ({reason:.80}). Mend it, or write CSV.") from error


def _flat(row: dict[str, Any], path: str = "", depth: int = 0) -> dict[str, Any]:
    """The scalars of an object by their paths."""
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
