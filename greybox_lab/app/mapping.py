"""The column map as the page shows it: what `greybox data map` prints of signals, and `use`: True, False, or open."""

from __future__ import annotations

import tomllib
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import tomli_w

from .beneath import SIGNALS, USUAL, write_atomically

Entry = dict[str, Any]

USUAL_UNITS = USUAL | {"m/s": ("m/s", "km/h", "mph"), "rad/s": ("rad/s", "deg/s", "rpm"), "m": ("m", "mm")}
"""SI unit -> units that loggers write, where nothing tells which: offered in this order."""
TIME_UNITS = ("s", "ms", "us", "ns")


def base_of(proposed: Path, answer: Mapping[str, Any]) -> dict[str, Any]:
    """What a proposed map says beside its signals: time, runs, separators, what commands do between rows."""
    try:
        text = tomllib.loads(proposed.read_text("utf-8"))
    except (OSError, tomllib.TOMLDecodeError):
        text = {}
    base = {key: value for key, value in text.items() if key not in ("name", "signals", "extra")}
    time = answer["time"]
    if time is not None and not {"column", "unit"} <= base.get("time", {}).keys():
        base["time"] = {"column": time["column"], "unit": time["unit"] or (time["units"] or ["s"])[0]}
        base["time_units"] = list(time["units"] or TIME_UNITS)
    elif time is None:
        base.pop("time", None)
    return base


def units_for(entry: Entry) -> list[str]:
    """Units that come into question for an entry, the likeliest first."""
    if entry["unit"] and not entry["units"]:
        return [entry["unit"]]
    signal = SIGNALS.get(entry["signal"])
    usual = USUAL_UNITS.get(signal.unit, (signal.unit,)) if signal else ("1",)
    return list(entry["units"] or ([entry["unit"]] if entry["unit"] else usual))


def questions(entries: Sequence[Entry]) -> list[Entry]:
    """Entries that are open; none of a signal that has its column already."""
    taken = {entry["signal"] for entry in entries if entry["use"]}
    return [entry for entry in entries if entry["use"] is None and entry["signal"] not in taken]


def answered(entries: Sequence[Entry], entry: Entry, **answer: Any) -> list[Entry]:
    """Entries with one of them answered; a column that is taken for a signal takes it from the others."""
    changed = []
    for each in entries:
        if each["signal"] == entry["signal"] and each["column"] == entry["column"]:
            changed.append({**each, **answer})
        elif answer.get("use") and each["signal"] == answer.get("signal", entry["signal"]) and each["use"]:
            changed.append({**each, "use": None})
        else:
            changed.append(each)
    return changed


def column_of(entry: Entry, unit: str = "") -> dict[str, Any]:
    """One column as a map has it."""
    column: dict[str, Any] = {**entry.get("more", {}), "column": entry["column"], "unit": unit or units_for(entry)[0]}
    if entry["sign"] != 1:
        column["sign"] = -1
    if entry["divide_by"] != 1.0:
        column["divide_by"] = entry["divide_by"]
    return column


def write_map(
    path: Path, base: Mapping[str, Any], entries: Sequence[Entry], extra: Mapping[str, Mapping[str, Any]] | None = None
) -> None:
    """Write the column map, atomically."""
    table = {key: value for key, value in base.items() if key not in ("time_units", "extra")}
    signals = {entry["signal"]: column_of(entry) for entry in entries if entry["use"]}
    more = {**base.get("extra", {}), **(extra or {})}
    table = {"name": "map", **table, "signals": signals, **({"extra": more} if more else {})}
    words = "# Made by greybox app; every command reads it: --columns map.toml\n"
    write_atomically(path, words + tomli_w.dumps(table))


def entries_of_map(written: str) -> tuple[dict[str, Any], list[Entry]]:
    """Base and entries of a map in TOML, such as one that a person edited."""
    text = tomllib.loads(written)
    base = {key: value for key, value in text.items() if key not in ("name", "about", "source", "signals")}
    entries = [
        {
            "signal": name, "column": column.get("column", name), "unit": column["unit"], "units": [],
            "sign": int(column.get("sign", 1)), "divide_by": float(column.get("divide_by", 1.0)), "decided": True,
            "reasons": [], "use": True,
            "more": {key: value for key, value in column.items() if key not in ("column", "unit", "sign", "divide_by")},
        }
        for name, column in text.get("signals", {}).items()
    ]  # fmt: skip
    return base, entries
