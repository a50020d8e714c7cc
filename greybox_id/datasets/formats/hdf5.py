"""HDF5 files: every dataset is a column named by its path; groups may each have their own time."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any

from numpy.typing import NDArray

from ..column_map import ColumnMap
from .apart import Apart
from .columns import Columns
from .contents import Contents, needed, sound
from .tree import TreeLeaf, fits, groups_of, matrix_leaves

KIND = "HDF5"
READER = "greybox_id.datasets.readers.hdf5:Hdf5Reader"


def contents(file: Path, mapping: ColumnMap) -> Contents:
    """Datasets by path, fields of compound ones as path/field, columns of matrices as path/0, path/1, ...

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
    """The columns in a dataset, each read when it is wanted.

    Parameters
    ----------
    reader, file : where the dataset lies.
    node : what `readers.hdf5` says of it.
    first : number of a matrix's first column.
    transposed : whether the file's shape is the other way round.
    """
    name, path = node["name"], tuple(node["name"].split("/"))
    shape = tuple(node["shape"])[:: -1 if transposed else 1]
    fits(math.prod(shape) * node["itemsize"], file.stat().st_size, str(file))

    def values(field: str | None) -> Callable[[], NDArray[Any]]:
        def load() -> NDArray[Any]:
            found = reader.array("values", name, field)
            return found.T if transposed else found

        return load

    for field in node["fields"]:
        own = path if field is None else (*path, field)
        yield from matrix_leaves(own, shape, values(field), first, node["unit"])


def write(columns: Columns, path: Path) -> None:
    """Write columns as datasets of the root, their units as attributes."""
    h5py = needed("h5py", "hdf5", str(path), KIND)
    # Made in memory: where the disk is full, the library fails again when it closes the file, and ends the process.
    with h5py.File(path.name, "w", driver="core", backing_store=False) as opened:
        for name, values in columns.values.items():
            dataset = opened.create_dataset(name, data=values, compression="gzip" if len(values) else None)
            dataset.attrs["unit"] = columns.units.get(name, "1")
        opened.flush()
        content = opened.id.get_file_image()
    path.write_bytes(content)
