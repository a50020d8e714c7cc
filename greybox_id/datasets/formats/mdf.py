"""Measurement files of ASAM MDF 3 and 4: every channel group has its own clock.

A channel is named by its name, or by group/channel if several groups have a channel of that name.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from ..column_map import ColumnMap
from . import Columns, Contents, Group, loader, needed, sound
from .apart import Apart

KIND = "MDF"
READER = "greybox_id.datasets.readers.mdf:MdfReader"
MASTER = "t"
"""Name of the clock in written files; the column time keeps the recording's time, which may restart."""


def contents(file: Path, _: ColumnMap) -> Contents:
    """Numeric channels, by channel group.

    Raises
    ------
    BadInput
        asammdf is not installed, or the file is damaged.
    """
    with sound(str(file), KIND):
        reader = Apart(file, READER, KIND, "mdf")
        groups = tuple(_groups(reader, file, reader.answer("groups")))
    return Contents(str(file), groups, KIND)


def _groups(reader: Apart, file: Path, result: Sequence[Mapping[str, Any]]) -> Iterator[Group]:
    """Groups as listed by `readers.mdf`, with unique channel names."""
    seen = Counter(name for group in result for name in {name for name, _ in group["channels"]})
    titles = Counter(group["title"] for group in result)
    for k, group in enumerate(result):
        title = group["title"] if titles[group["title"]] == 1 else f"{group['title']}#{k}"
        full = [name if seen[name] == 1 else f"{title}/{name}" for name, _ in group["channels"]]
        names = {name: (k, number) for number, name in enumerate(full)}
        if not names:
            continue
        clock = next((name for name, (_, number) in names.items() if number == group["clock"]), "")
        unit_of = {name: group["channels"][number][1] for name, (_, number) in names.items()}
        units = {name: unit for name, unit in unit_of.items() if unit}
        load = loader(str(file), names, partial(_values, reader, names))
        yield Group(title, tuple(names), load, f"{title}/", clock, "s" if clock else "", units)


def _values(reader: Apart, names: Mapping[str, tuple[int, int]], name: str) -> Any:
    return reader.array("values", *names[name])


def write(columns: Columns, path: Path, comment: str = "") -> None:
    """Write columns as one channel group of an MDF 4 file, with units; the header contains the comment."""
    asammdf = needed("asammdf", "mdf", str(path), KIND)
    with asammdf.MDF(version="4.10") as made:
        if comment:
            made.header.comment = comment
        made.append(
            [
                asammdf.Signal(
                    np.asarray(values), columns.steady, columns.units.get(name, ""), name, master_metadata=(MASTER, 1)
                )
                for name, values in columns.values.items()
            ]
        )
        made.save(path, overwrite=True)
