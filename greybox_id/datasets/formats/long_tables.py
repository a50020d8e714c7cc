"""Tables with a row for every reading: its time, the name of its channel and its value. Each channel is a group."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pandas as pd

from ...base.shorthands import Array
from ..instants import count_unit, is_instants
from .contents import Contents, Group, RawTable

NAMES = frozenset(
    ("name", "signal", "channel", "topic", "key", "variable", "parameter", "metric", "id", "series", "tag")
)
VALUES = frozenset(["value", "val", "values", "reading", "data"])
TIMES = frozenset(("time", "timestamp", "t", "stamp", "ts", "datetime", "date", "elapsed", "timecode"))
MOST_COLUMNS = 6
"""A table with more columns is none of readings."""
WORDS = {"true": 1.0, "false": 0.0, "on": 1.0, "off": 0.0}
CLOCK = "time"


def apart_by_name(table: RawTable, kind: str) -> Contents | None:
    """The channels of a long table, each on its own clock; None for a table that is none."""
    if not len(table) or len(table.names) > MOST_COLUMNS:
        return None
    plain = {name.lower().strip(): name for name in table.names}
    result = [next((plain[item] for item in plain if item in known), None) for known in (TIMES, NAMES, VALUES)]
    if not all(result):
        return None
    time, name, value = (str(item) for item in result)
    labels = table.column(name)
    if pd.api.types.is_numeric_dtype(labels.dtype):
        return None
    times = table.column(time)
    if not (pd.api.types.is_numeric_dtype(times.dtype) or is_instants(times)):
        return None
    unit = table.units.get(time, "") or count_unit(times)
    groups, words = [], []
    for label, rows in labels.groupby(labels, sort=False).groups.items():
        values = _numbers(table.column(value).loc[rows])
        if np.isfinite(values).any():
            groups.append(_group(str(label), table, pd.Series(values), times.loc[rows], unit))
        else:
            words.append(str(label))
    if not groups:
        return None
    passed = (f"channels without numbers were passed over: {', '.join(words[:6])}.",) if words else ()
    note = f"a row for every reading: {len(groups)} channels, each on its own clock."
    return Contents(table.where, tuple(groups), kind, (note, *passed))


def _group(name: str, table: RawTable, values: pd.Series[float], times: pd.Series[float], unit: str) -> Group:
    clock = f"{name}/{CLOCK}"
    columns = {name: values, clock: times.reset_index(drop=True)}

    def load(target: Sequence[str]) -> RawTable:
        chosen = tuple(column for column in columns if column in target)
        return RawTable(table.where, chosen, tuple(columns[item] for item in chosen), table.first_row)

    return Group(name, (name, clock), load, f"{name}/", clock, unit)


def _numbers(values: pd.Series[float]) -> Array:
    """Readings as numbers; words of truth as 1 and 0, other words as NaN."""
    if pd.api.types.is_numeric_dtype(values.dtype):
        return np.asarray(values.to_numpy(dtype=float, na_value=np.nan), dtype=float)
    words = values.astype("string").str.strip().str.lower()
    numbers = pd.to_numeric(words, errors="coerce").to_numpy(dtype=float, na_value=np.nan)
    truths = words.map(WORDS).to_numpy(dtype=float, na_value=np.nan)
    return np.asarray(np.where(np.isnan(numbers), truths, numbers), dtype=float)
