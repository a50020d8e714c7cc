"""HDF5 files: every dataset is a column named by its path; groups may each have their own time."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..column_map import ColumnMap
from .columns import Columns
from .contents import Contents, needed, sound
from .tree import Leaf, fits, groups_of, matrix_leaves

KIND = "HDF5"


def contents(file: Path, mapping: ColumnMap) -> Contents:
    """Datasets by path, fields of compound ones as path/field, columns of matrices as path/0, path/1, ...

    Raises
    ------
    BadInput
        h5py is not installed, or the file is damaged.
    """
    h5py = needed("h5py", "hdf5", str(file), KIND)
    leaves: list[Leaf] = []

    def visit(name: str, node: Any) -> None:
        if isinstance(node, h5py.Dataset):
            leaves.extend(dataset_leaves(h5py, file, tuple(name.split("/")), node, 0))

    with sound(str(file), KIND), h5py.File(file, "r") as opened:
        opened.visititems(visit)
    return Contents(str(file), groups_of(leaves, "/", mapping.time.column, str(file)), KIND)


def dataset_leaves(
    h5py: Any, file: Path, path: tuple[str, ...], node: Any, first: int, transposed: bool = False
) -> Iterator[Leaf]:
    """The columns in a dataset, each read when it is wanted.

    Parameters
    ----------
    h5py : the module.
    file, path : where the dataset lies, and what it is to be called.
    node : the dataset.
    first : number of a matrix's first column.
    transposed : whether the file's shape is the other way round.
    """
    where, kind = node.name, node.dtype
    unit = _text(node.attrs)
    shape = tuple(node.shape or ())[:: -1 if transposed else 1]
    if node.shape is not None:
        fits(int(np.prod([float(n) for n in node.shape])) * kind.itemsize, file.stat().st_size, str(file))

    def reader(field: str | None) -> Callable[[], NDArray[Any]]:
        def load() -> NDArray[Any]:
            with sound(str(file), KIND), h5py.File(file, "r") as opened:
                values = np.asarray(opened[where][()] if field is None else opened[where][field])
            return values.T if transposed else values

        return load

    for field in [None] if kind.names is None else kind.names:
        own = kind if field is None else kind[field]
        if own.shape == () and own.kind in "iufb":
            name = path if field is None else (*path, field)
            yield from matrix_leaves(name, shape, reader(field), first, unit)


def _text(attributes: Mapping[str, Any]) -> str:
    """The unit among a dataset's attributes."""
    for name in ("unit", "units", "Unit", "Units"):
        found = attributes.get(name, "")
        text = found.decode("utf-8", "replace") if isinstance(found, bytes) else found
        if isinstance(text, str) and text:
            return text
    return ""


def write(columns: Columns, path: Path) -> None:
    """Write columns as datasets of the root, their units as attributes."""
    h5py = needed("h5py", "hdf5", str(path), KIND)
    with h5py.File(path, "w") as opened:
        for name, values in columns.values.items():
            dataset = opened.create_dataset(name, data=values, compression="gzip" if len(values) else None)
            dataset.attrs["unit"] = columns.units.get(name, "1")
