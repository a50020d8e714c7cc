"""AiM's .xrk and .xrz files: channels with separate clocks, read by libxrk."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from ...base.units import known_unit
from ..column_map import ColumnMap
from . import Contents, Group, loader, needed, sound

KIND = "AiM"
CLOCK = "timecodes"
"""libxrk's name for the time of a channel, in ms from the start of the file."""


def contents(file: Path, _: ColumnMap) -> Contents:
    """The channels of a file.

    Raises
    ------
    BadInput
        libxrk is not installed, or the file is damaged.
    """
    libxrk = needed("libxrk", "aim", str(file), KIND)
    with sound(str(file), KIND):
        log = libxrk.aim_xrk(str(file))
        return of_log(log, str(file))


def of_log(log: Any, where: str) -> Contents:
    """The channels of libxrk's log; those with identical times form one group."""
    tables = {name: table for name, table in log.channels.items() if table.num_rows}
    by_clock: dict[bytes, list[str]] = {}
    for name, table in tables.items():
        by_clock.setdefault(table.column(CLOCK).to_numpy().tobytes(), []).append(name)
    groups = tuple(_group(names, tables, where) for names in by_clock.values())
    return Contents(where, groups, KIND)


def _group(names: Sequence[str], tables: dict[str, Any], where: str) -> Group:
    title = names[0]
    clock = f"{title}/time"
    units = {name: unit for name in names if (unit := _unit(tables[name], name))}

    def column(name: str) -> Any:
        return (tables[title].column(CLOCK) if name == clock else tables[name].column(name)).to_numpy()

    every = (*names, clock)
    return Group(title, every, loader(where, every, column), f"{title}/", clock, "ms", units)


def _unit(table: Any, name: str) -> str:
    """The unit in a channel's metadata, if it is a known one; else empty."""
    stated = (table.schema.field(name).metadata or {}).get(b"units", b"")
    return known_unit(stated.decode("utf-8", "replace"))
