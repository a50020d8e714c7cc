"""HDF5 files: every dataset is a column named by its path.

In HDF5 and MAT files, arrays in folders belong to the time array of the same folder or of one above.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...base.errors import BadInput
from ..column_map import ColumnMap
from . import Columns, Contents, Group, loader, needed, sound
from .apart import Apart

TIMES = ("time", "t", "timestamp", "timestamps", "time_s", "stamp", "zeit")
"""Names of time in files whose column map does not name it."""
MOST_WIDE = 64
"""Largest number of columns of a matrix of signals."""
LARGEST_SWELL = 1000
"""Largest ratio of an array's size to its file's; measured signals compress less."""
SMALL = 2**26
"""Bytes allowed in any file."""


@dataclass(frozen=True)
class TreeLeaf:
    """One column in a tree of folders.

    Attributes
    ----------
    path : names of the folders, then of the column.
    rows : number of rows.
    load : returns the values (rows,).
    unit : stated in the file; empty if none.
    """

    path: tuple[str, ...]
    rows: int
    load: Callable[[], NDArray[Any]]
    unit: str = ""


def matrix_leaves(
    path: tuple[str, ...], shape: tuple[int, ...], load: Callable[[], NDArray[Any]], first: int, unit: str = ""
) -> list[TreeLeaf]:
    """The columns of an array: one of a row or column vector; of a matrix as many as its shorter side.

    Parameters
    ----------
    path : of the array.
    shape : of the array.
    load : returns the array.
    first : number of a matrix's first column; numbers are the columns' names.
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
    """Raise `BadInput` for an array that is too large for its file."""
    if size > max(SMALL, LARGEST_SWELL * file_size):
        raise BadInput(
            f"{where} is damaged: it claims to hold {size / 1e9:.3g} GB in {file_size / 1e6:.3g} MB. Fetch it again."
        )


def groups_of(leaves: Iterable[TreeLeaf], separator: str, time: str, where: str) -> tuple[Group, ...]:
    """Groups of columns with a common clock.

    Parameters
    ----------
    leaves : all columns.
    separator : between the parts of a full name.
    time : name of time in the column map: its last part in any folder, or a full name.
    where : the file, for sentences.
    """
    everything = list(leaves)
    clocks = {leaf.path: leaf for leaf in everything if _is_time(leaf.path, separator, time)}
    sets: dict[tuple[tuple[str, ...], str], list[TreeLeaf]] = {}
    for leaf in everything:
        clock = _clock(leaf, clocks, separator, time)
        key = (clock.path, "") if clock else (leaf.path[:-1], str(leaf.rows))
        sets.setdefault(key, []).append(leaf)
    result = [
        _group(item, clocks.get(key) if not rows else None, separator, where) for (key, rows), item in sets.items()
    ]
    lone = [group for group, item in zip(result, sets.values(), strict=True) if group.clock or item[0].rows > 1]
    return tuple(lone or result)


def _is_time(path: tuple[str, ...], separator: str, time: str) -> bool:
    return separator.join(path) == time or path[-1] == time or path[-1].lower() in TIMES


def _clock(leaf: TreeLeaf, clocks: dict[tuple[str, ...], TreeLeaf], separator: str, time: str) -> TreeLeaf | None:
    """The time of a column: the nearest one of equal length in its folder or above; the map's time takes precedence."""
    for depth in range(len(leaf.path) - 1, -1, -1):
        near = [c for p, c in clocks.items() if p[:-1] == leaf.path[:depth] and c.rows == leaf.rows]
        if near:
            return min(near, key=lambda c: (separator.join(c.path) != time, c.path[-1] != time, c.path))
    return next((c for p, c in clocks.items() if separator.join(p) == time and c.rows == leaf.rows), None)


def _group(leaves: Sequence[TreeLeaf], clock: TreeLeaf | None, separator: str, where: str) -> Group:
    names = {separator.join(leaf.path): leaf for leaf in leaves}
    folder = (clock or leaves[0]).path[:-1]
    prefix, of_clock = separator.join((*folder, "")) if folder else "", separator.join(clock.path) if clock else ""
    load = loader(where, names, lambda name: _plain(names[name].load()))
    units = {name: leaf.unit for name, leaf in names.items() if leaf.unit}
    return Group(separator.join(folder), tuple(names), load, prefix, of_clock, units=units)


def _plain(values: NDArray[Any]) -> NDArray[Any]:
    values = values.astype(values.dtype.newbyteorder("="))
    return values.astype(np.uint8) if values.dtype == bool else values


KIND = "HDF5"
READER = "greybox_id.datasets.readers.hdf5:Hdf5Reader"


def contents(file: Path, mapping: ColumnMap) -> Contents:
    """Datasets by path, fields of compound datasets as path/field, columns of matrices as path/0, path/1, ...

    Raises
    ------
    BadInput
        h5py is not installed, or the file is damaged.
    """
    with sound(str(file), KIND):
        reader = Apart(file, READER, KIND, "hdf5")
        leaves = [leaf for node in reader.answer("datasets") for leaf in dataset_leaves(reader, file, node, 0)]
    return Contents(str(file), groups_of(leaves, "/", mapping.time.column, str(file)), KIND)


def dataset_leaves(
    reader: Apart, file: Path, node: Mapping[str, Any], first: int, transposed: bool = False
) -> Iterator[TreeLeaf]:
    """The columns in a dataset, each loaded on demand.

    Parameters
    ----------
    reader, file : the file and its reader.
    node : description of the dataset by `readers.hdf5`.
    first : number of a matrix's first column.
    transposed : whether the file stores dimensions in reverse order.
    """
    name, path = node["name"], tuple(node["name"].split("/"))
    shape = tuple(node["shape"])[:: -1 if transposed else 1]
    fits(math.prod(shape) * node["itemsize"], file.stat().st_size, str(file))

    def values(field: str | None) -> Callable[[], NDArray[Any]]:
        def load() -> NDArray[Any]:
            result = reader.array("values", name, field)
            return result.T if transposed else result

        return load

    for field in node["fields"]:
        value = path if field is None else (*path, field)
        yield from matrix_leaves(value, shape, values(field), first, node["unit"])


def write(columns: Columns, path: Path) -> None:
    """Write columns as datasets of the root, with their units as attributes."""
    h5py = needed("h5py", "hdf5", str(path), KIND)
    # Built in memory: if the disk is full, the library fails again when it closes the file, and aborts the process.
    with h5py.File(path.name, "w", driver="core", backing_store=False) as opened:
        for name, values in columns.values.items():
            dataset = opened.create_dataset(name, data=values, compression="gzip" if len(values) else None)
            dataset.attrs["unit"] = columns.units.get(name, "1")
        opened.flush()
        content = opened.id.get_file_image()
    path.write_bytes(content)
