"""Arrays in folders (MAT, HDF5) as groups of columns: each goes with the time that lies beside or above it."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from ...errors import BadInput
from ..table import RawTable
from .contents import Group

TIMES = ("time", "t", "timestamp", "timestamps", "time_s", "stamp", "zeit")
"""What time is called in files whose column map does not name it."""
MOST_WIDE = 64
"""A matrix wider than this is no set of signals."""
LARGEST_SWELL = 1000
"""How many times the size of its file an array may be; compression of measured signals saves less."""
SMALL = 2**26
"""Bytes that any file may hold."""


@dataclass(frozen=True)
class TreeLeaf:
    """One column somewhere in a file.

    Attributes
    ----------
    path : names of folders, then its own.
    rows : its length.
    load : (rows,) reads it.
    unit : as the file states it; empty if it does not.
    """

    path: tuple[str, ...]
    rows: int
    load: Callable[[], NDArray[Any]]
    unit: str = ""


def matrix_leaves(
    path: tuple[str, ...], shape: tuple[int, ...], load: Callable[[], NDArray[Any]], first: int, unit: str = ""
) -> list[TreeLeaf]:
    """The columns of an array: of a vector, lying or standing, one; of a matrix as many as its shorter side.

    Parameters
    ----------
    path : of the array.
    shape : of the array.
    load : reads it.
    first : number of the first column of a matrix, which is its name.
    unit : of all columns.
    """
    sides = [length for length in shape if length != 1] or [1] * (0 not in shape)
    if len(sides) == 1:
        return [TreeLeaf(path, sides[0], lambda: np.ravel(load()), unit)]
    if len(sides) != 2 or min(sides) > MOST_WIDE or 0 in sides:
        return []
    lying = sides[0] < sides[1]

    def column(number: int) -> Callable[[], NDArray[Any]]:
        def read() -> NDArray[Any]:
            values = np.reshape(load(), sides)
            return values[number] if lying else values[:, number]

        return read

    return [TreeLeaf((*path, str(first + k)), max(sides), column(k), unit) for k in range(min(sides))]


def fits(size: int, file_size: int, where: str) -> None:
    """Raise `BadInput` for an array that is too large to lie in its file."""
    if size > max(SMALL, LARGEST_SWELL * file_size):
        raise BadInput(
            f"{where} is damaged: it claims {size / 1e9:.3g} GB in {file_size / 1e6:.3g} MB. Fetch it again."
        )


def groups_of(leaves: Iterable[TreeLeaf], separator: str, time: str, where: str) -> tuple[Group, ...]:
    """Columns by the clock they go with.

    Parameters
    ----------
    leaves : all columns.
    separator : between the parts of a full name.
    time : the name of time in the column map: its last part in any folder, or a full name.
    where : the file, for sentences.
    """
    everything = list(leaves)
    clocks = {leaf.path: leaf for leaf in everything if _is_time(leaf.path, separator, time)}
    sets: dict[tuple[tuple[str, ...], str], list[TreeLeaf]] = {}
    for leaf in everything:
        clock = _clock(leaf, clocks, separator, time)
        key = (clock.path, "") if clock else (leaf.path[:-1], str(leaf.rows))
        sets.setdefault(key, []).append(leaf)
    found = [_group(own, clocks.get(key) if not rows else None, separator, where) for (key, rows), own in sets.items()]
    lone = [group for group, own in zip(found, sets.values(), strict=True) if group.clock or own[0].rows > 1]
    return tuple(lone or found)


def _is_time(path: tuple[str, ...], separator: str, time: str) -> bool:
    return separator.join(path) == time or path[-1] == time or path[-1].lower() in TIMES


def _clock(leaf: TreeLeaf, clocks: dict[tuple[str, ...], TreeLeaf], separator: str, time: str) -> TreeLeaf | None:
    """The time of a column: the nearest of its length, going up; the one the map names comes first."""
    for depth in range(len(leaf.path) - 1, -1, -1):
        near = [c for p, c in clocks.items() if p[:-1] == leaf.path[:depth] and c.rows == leaf.rows]
        if near:
            return min(near, key=lambda c: (separator.join(c.path) != time, c.path[-1] != time, c.path))
    return next((c for p, c in clocks.items() if separator.join(p) == time and c.rows == leaf.rows), None)


def _group(leaves: Sequence[TreeLeaf], clock: TreeLeaf | None, separator: str, where: str) -> Group:
    names = {separator.join(leaf.path): leaf for leaf in leaves}
    folder = (clock or leaves[0]).path[:-1]

    def load(wanted: Sequence[str]) -> RawTable:
        chosen = tuple(name for name in names if name in wanted)
        columns = tuple(pd.Series(_plain(names[name].load())) for name in chosen)
        return RawTable(where, chosen, columns, 1)

    return Group(
        name=separator.join(folder),
        names=tuple(names),
        load=load,
        prefix=separator.join((*folder, "")) if folder else "",
        clock=separator.join(clock.path) if clock else "",
        units={name: leaf.unit for name, leaf in names.items() if leaf.unit},
    )


def _plain(values: NDArray[Any]) -> NDArray[Any]:
    values = values.astype(values.dtype.newbyteorder("="))
    return values.astype(np.uint8) if values.dtype == bool else values
