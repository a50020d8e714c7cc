"""Racelogic's .vbo files: sections of text, with values separated by blanks.

Source: Racelogic, VBO file format (support centre): time is UTC as HHMMSS.SS, latitude and longitude are minutes, north
and west positive. They are converted to seconds from midnight and degrees, north and east positive.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from pathlib import Path

import numpy as np
import pandas as pd

from ...base.errors import BadInput
from ...base.shorthands import Array
from ...base.units import known_unit
from ..column_map import ColumnMap
from ..raw_table import RawTable
from . import Contents, few_enough, whole
from .text import text_of_file

KIND = "VBO"
DAY = 86_400.0
STANDARD = {"time": "s", "lat": "deg", "long": "deg", "heading": "deg", "height": "m", "velocity": "km/h"}
"""Short name of a standard channel -> its unit, unless [header] states another."""
_SECTION = re.compile(r"\[([a-z ]+)\]", re.IGNORECASE)


def contents(file: Path, _: ColumnMap) -> Contents:
    """The channels of the [data] section, named by [column names].

    Raises
    ------
    BadInput
        A section is missing, or the number of cells in a row differs from that of names.
    """
    sections, first = _sections(text_of_file(file).decode(), str(file))
    names = " ".join(sections.get("column names", [])).split()
    if not names:
        raise BadInput(f"{file} has no [column names]; a .vbo file names its columns there. Export it again.")
    few_enough(len(names), str(file))
    rows = [line.split() for line in sections["data"] if line.strip()]
    for k, row in enumerate(rows):
        if len(row) != len(names):
            raise BadInput(
                f"{file}: row {first + k} has {len(row)} cells, but [column names] lists {len(names)} "
                f"columns. Correct that row."
            )
    columns = dict(zip(names, (pd.Series(item) for item in zip(*rows, strict=True)), strict=True)) if rows else {}
    table = RawTable(str(file), tuple(columns) or tuple(names), tuple(columns.values()), first, _units(names, sections))
    numbers = {name: table.numbers(name) for name in table.names} if rows else {}
    numbers |= {name: sign * numbers[name] / 60.0 for name, sign in (("lat", 1.0), ("long", -1.0)) if name in numbers}
    numbers |= {"time": _seconds(numbers["time"])} if "time" in numbers else {}
    table = RawTable(table.where, table.names, tuple(pd.Series(v) for v in numbers.values()), first, table.units)
    return whole(
        table, KIND, ("latitude and longitude are minutes, west positive: converted to degrees, east positive.",)
    )


def _sections(text: str, where: str) -> tuple[Mapping[str, list[str]], int]:
    """Section -> its lines, and the row number of the first values, counted from 1."""
    sections: dict[str, list[str]] = {}
    lines, first = sections.setdefault("", []), 0
    for k, line in enumerate(text.splitlines(), 1):
        result = _SECTION.fullmatch(line.strip())
        if result:
            lines = sections.setdefault(result[1].lower(), [])
            first = k + 1 if result[1].lower() == "data" else first
        else:
            lines.append(line.strip())
    if "data" not in sections:
        raise BadInput(f"{where} has no section [data]: this .vbo file is incomplete. Export it again.")
    return sections, first


def _units(names: list[str], sections: Mapping[str, list[str]]) -> dict[str, str]:
    """Units of columns: stated in [header] after a channel's name, else those of standard channels."""
    titles = [line for line in sections.get("header", []) if line]
    further = sections.get("channel units", [])[:]
    while further and not further[-1]:  # blank lines between sections
        further.pop()
    units = {}
    for k, name in enumerate(names):
        title = titles[k].split() if len(titles) == len(names) else []
        from_end = k - len(names) + len(further)
        stated = further[from_end] if 0 <= from_end < len(further) else title[-1] if len(title) > 1 else ""
        units[name] = known_unit(stated) or STANDARD.get(name.lower(), "")
    return {name: unit for name, unit in units.items() if unit}


def _seconds(clock: Array) -> Array:
    """Clock times HHMMSS.SS in seconds, continued past midnight."""
    hours, rest = np.divmod(clock, 10_000.0)
    minutes, seconds = np.divmod(rest, 100.0)
    result = np.round(3600 * hours + 60 * minutes + seconds, 6)
    midnights = np.cumsum(np.concatenate([[0], np.diff(result) < -DAY / 2]))
    return np.asarray(result + DAY * midnights)
