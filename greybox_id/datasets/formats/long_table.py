"""Long tables, with one row per reading and its channel's name: one group of columns per channel."""

from __future__ import annotations

import re
from typing import Any

import numpy as np
import pandas as pd

from ...base.shorthands import Array
from ...base.units import known_unit
from ..instants import count_unit, is_instants
from ..raw_table import RawTable
from . import Contents, Group, loader

NAMES = frozenset([
    "name", "signal", "channel", "topic", "key", "variable", "parameter", "metric", "id", "series", "tag",
    "measurement", "quantity", "sensor", "field", "item", "kanal", "messgröße", "groesse", "größe",
])  # fmt: skip
VALUES = frozenset(["value", "val", "values", "reading", "data", "wert", "messwert", "physical"])
TIMES = frozenset([
    "time", "timestamp", "t", "stamp", "ts", "datetime", "date", "elapsed", "timecode", "zeit", "zeitstempel",
    "seconds", "secs", "millis",
])  # fmt: skip
UNITS = frozenset(["unit", "units", "einheit", "uom"])
COLUMNS_OF_READINGS = 8
"""Largest number of columns of a long table."""
READINGS_EACH = 2.0
"""Least average number of readings per channel."""
WORDS = {"true": 1.0, "false": 0.0, "on": 1.0, "off": 0.0}
CLOCK = "time"
_WORDS = re.compile(r"[^\W\d_]+")
_CAMEL = re.compile(r"(?<=[a-z])(?=[A-Z])")
_BRACKET = re.compile(r"[\[(]\s*([^\])]*)[\])]\s*$")


def apart_by_name(table: RawTable, kind: str) -> Contents | None:
    """The channels of a long table, each on its own clock; None if the table is not a long one."""
    roles = _roles(table)
    if roles is None:
        return None
    time, name, value, unit_column = roles
    labels, times = table.column(name), table.column(time)
    bracket = _BRACKET.search(time)
    unit = table.units.get(time, "") or known_unit(bracket[1] if bracket else "") or count_unit(times)
    groups, words = [], []
    for label, rows in labels.groupby(labels, sort=False).groups.items():
        values = _numbers(table.column(value).loc[rows])
        if np.isfinite(values).any():
            stated = {str(item) for item in table.column(unit_column).loc[rows].dropna()} if unit_column else set()
            known = known_unit(stated.pop()) if len(stated) == 1 else ""
            groups.append(_group(str(label), table, pd.Series(values), times.loc[rows], unit, known))
        else:
            words.append(str(label))
    if not groups:
        return None
    passed = (f"channels without numbers were skipped: {', '.join(words[:6])}.",) if words else ()
    note = f"each row holds one reading: {len(groups)} channels, each with its own time stamps."
    return Contents(table.where, tuple(groups), kind, (note, *passed))


def _roles(table: RawTable) -> tuple[str, str, str, str] | None:
    """The columns of time, channel names, values and units (empty for none); None if it is not a long table."""
    if not len(table) or len(table.names) > COLUMNS_OF_READINGS:
        return None
    words = {name: _words(name) for name in table.names}
    texts = {name for name in table.names if not pd.api.types.is_numeric_dtype(table.column(name).dtype)}
    units = next((name for name in table.names if words[name] & UNITS and name in texts), "")
    times = [n for n in table.names if words[n] & TIMES and (n not in texts or is_instants(table.column(n)))]
    values = [n for n in table.names if words[n] & VALUES and n not in (*times, units)]
    kinds = {n: table.column(n).nunique() for n in table.names if words[n] & NAMES and n in texts}
    named = [n for n in kinds if n not in (*times, units) and READINGS_EACH * kinds[n] <= len(table)]
    plain = [n for n in named if n not in values] or named
    if not times or not plain:
        return None
    name = max(plain, key=lambda n: kinds[n])  # most values: an identifier of messages would cover several signals
    values = [n for n in values if n != name and n not in plain] or [n for n in values if n != name]
    return (times[0], name, values[0], units) if values else None


def _words(name: str) -> set[str]:
    """The words of a column's name in lower case, without a suffix in brackets."""
    return {word.lower() for word in _WORDS.findall(_CAMEL.sub(" ", _BRACKET.sub("", name)))}


def _group(
    name: str, table: RawTable, values: pd.Series[float], times: pd.Series[float], unit: str, known: str
) -> Group:
    clock = f"{name}/{CLOCK}"
    columns: dict[str, pd.Series[Any]] = {name: values, clock: times.reset_index(drop=True)}
    load = loader(table.where, columns, columns.__getitem__, table.first_row)
    return Group(name, (name, clock), load, f"{name}/", clock, unit, {name: known} if known else {})


def _numbers(values: pd.Series[float]) -> Array:
    """Readings as numbers; true and on as 1, false and off as 0, other words as NaN."""
    if pd.api.types.is_numeric_dtype(values.dtype):
        return np.asarray(values.to_numpy(dtype=float, na_value=np.nan), dtype=float)
    words = values.astype("string").str.strip().str.lower()
    numbers = pd.to_numeric(words, errors="coerce").to_numpy(dtype=float, na_value=np.nan)
    truths = words.map(WORDS).to_numpy(dtype=float, na_value=np.nan)
    return np.asarray(np.where(np.isnan(numbers), truths, numbers), dtype=float)
