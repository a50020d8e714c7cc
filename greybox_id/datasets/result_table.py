"""Tables of results, one row per sample, as CSV, Parquet, MDF 4 (.mf4) or MCAP, formats that plotting tools open."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from ..base.errors import BadInput
from ..base.files import replacing
from ..base.guard import MARK, claim
from ..base.signals import unit_of, unit_of_quantity
from .formats import BETWEEN_RUNS, Columns, mdf, needed

PLAIN = (".csv", ".parquet")
SUFFIXES = (*PLAIN, ".mf4", ".mcap")
ENDINGS = ("_predicted", "_simulated", "_sd")
"""Suffixes that names of results add to the name of their signal."""
AT_A_TIME = 100_000
"""Rows of Parquet that are encoded at a time, which bounds memory."""
TOPIC = "/greybox"
"""Topic in MCAP files: one message per row."""


def target_of(out: str, suffixes: tuple[str, ...] = SUFFIXES) -> Path:
    """Path of a table to be written. Raises `BadInput` if its suffix is not supported."""
    target = Path(out)
    if target.suffix not in suffixes:
        kinds = " or ".join(filter(None, (", ".join(suffixes[:-1]), suffixes[-1])))
        raise BadInput(f"{out}: tables are written as {kinds}; name such a file (‹out›).")
    if target.suffix == ".mf4":
        needed("asammdf", "mdf", out, mdf.KIND)
    if target.suffix == ".mcap":
        needed("mcap.writer", "mcap", out, "MCAP")
    return target


def claimed_table(out: str, words: str, suffixes: tuple[str, ...] = SUFFIXES) -> Path:
    """Path of a table with content `words`, claimed before long work. Raises `BadInput` if it must not be written."""
    return claim(target_of(out, suffixes), becomes=words)


def write_table(table: pd.DataFrame, target: Path, words: str) -> None:
    """Write a table atomically in the format of the suffix; columns `time` [s] and `run`, others in their SI units.

    Parameters
    ----------
    table : one row per sample.
    target : a file whose suffix is one of `SUFFIXES`.
    words : its content, such as "a table of predictions"; noted in the file if the format allows.
    """
    with replacing(target) as beside:
        if target.suffix == ".csv":
            table.to_csv(beside, index=False)
        elif target.suffix == ".parquet":
            table.to_parquet(beside, index=False, row_group_size=AT_A_TIME)
        elif target.suffix == ".mf4":
            columns = Columns({str(name): table[name].to_numpy() for name in table}, _units(table), _clock(table))
            mdf.write(columns, beside, f"{MARK}: {words}")
        else:
            _write_mcap(table, beside, words)


def _units(table: pd.DataFrame) -> dict[str, str]:
    result = {"time": "s"}
    for column in table:
        name = str(column)
        for ending in ENDINGS:
            name = name.removesuffix(ending)
        unit = unit_of(name, unit_of_quantity(name))
        if unit and name != "time":
            result[str(column)] = unit
    return result


def _clock(table: pd.DataFrame) -> np.ndarray[Any, Any]:
    """The table's time in s, shifted where it would step back from one run to the next, so that it always increases."""
    if "time" not in table:
        return np.arange(len(table), dtype=float)
    time = table["time"].to_numpy(dtype=float)
    back = np.append(0.0, np.where(np.diff(time) <= 0, BETWEEN_RUNS - np.diff(time), 0.0)) if len(time) else time
    return np.asarray(time + np.cumsum(back))


def _write_mcap(table: pd.DataFrame, path: Path, words: str) -> None:
    """Write one JSON message per row, with a schema; NaN values are omitted from their message."""
    writer_of = needed("mcap.writer", "mcap", str(path), "MCAP").Writer
    units = _units(table)
    properties: dict[str, Mapping[str, str]] = {str(name): {"type": "number"} for name in table}
    for name, unit in units.items():
        if name in properties:
            properties[name] = {"type": "number", "description": unit}
    schema = {"type": "object", "title": "greybox.Row", "description": words, "properties": properties}
    names, rows = [str(name) for name in table], table.to_numpy(dtype=float)
    clock = np.round(_clock(table) * 1e9).astype(np.int64)
    clock -= min(0, int(clock.min(initial=0)))  # MCAP's times must not be negative
    with path.open("wb") as opened:
        writer = writer_of(opened)
        writer.start(profile="", library=f"{MARK}: {words}")
        kind = writer.register_schema("greybox.Row", "jsonschema", json.dumps(schema, ensure_ascii=False).encode())
        channel = writer.register_channel(TOPIC, "json", kind)
        for at, row in zip(clock.tolist(), rows, strict=True):
            known = {name: value for name, value in zip(names, row.tolist(), strict=True) if np.isfinite(value)}
            writer.add_message(channel, at, json.dumps(known).encode(), at)
        writer.finish()
