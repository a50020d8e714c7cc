"""MAT files: version 4 to 7 by scipy, 7.3 (which is HDF5) by h5py, each in an isolated process.

Structs are flattened to dotted names: a timeseries saved as a struct is `speed.Data` on the clock `speed.Time`. Columns
of matrices are numbered from 1.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from functools import cache, partial
from pathlib import Path

import numpy as np
from scipy.io import savemat

from ...base.errors import BadInput
from ..column_map import ColumnMap
from . import Columns, Contents, sound
from .apart import Apart
from .hdf5 import READER, TreeLeaf, dataset_leaves, groups_of, matrix_leaves

KIND = "MAT"
OLDER = "greybox_id.datasets.readers.mat:MatReader"
UNITS = "units"
"""Name of a struct of texts that states units."""
LONGEST_NAME = 63
HDF5 = b"\x89HDF\r\n\x1a\n"


def contents(file: Path, mapping: ColumnMap) -> Contents:
    """Vectors, matrices and fields of structs, by dotted name.

    Raises
    ------
    BadInput
        The file is damaged, or is of version 7.3 and h5py is not installed.
    """
    with file.open("rb") as opened:
        newest = HDF5 in opened.read(1024)
    objects: list[str] = []
    with sound(str(file), KIND):
        leaves = list(_newest(file, objects) if newest else _older(file, objects))
    notes: tuple[str, ...] = ()
    if objects:
        lost = ", ".join(objects[:6])
        notes = (f"{lost}: MATLAB objects cannot be read; save timeseries as struct(ts) or as vectors.",)
    return Contents(str(file), groups_of(leaves, ".", mapping.time.column, str(file)), KIND, notes)


def write(columns: Columns, path: Path) -> None:
    """Write columns as column vectors, and their units as a struct.

    Raises
    ------
    BadInput
        A column's name is not a valid MATLAB variable name.
    """
    for name in columns.values:
        if not re.fullmatch(rf"[A-Za-z]\w{{0,{LONGEST_NAME - 1}}}", name, re.ASCII):
            raise BadInput(
                f'{path}: a .mat file cannot hold a variable named "{name}"; rename it in the column map, or write .h5.'
            )
    vectors = {name: np.reshape(values, (-1, 1)) for name, values in columns.values.items()}
    savemat(path, {**vectors, UNITS: dict(columns.units)}, do_compression=True, long_field_names=True)


def _older(file: Path, objects: list[str]) -> Iterator[TreeLeaf]:
    reader = Apart(file, OLDER, KIND, "mat")
    result = reader.answer("variables")
    objects.extend(result["objects"])
    units = {".".join(item["path"][1:]): item["text"] for item in result["texts"] if item["path"][0] == UNITS}
    for number, item in enumerate(result["arrays"]):
        path = tuple(item["path"])
        load = cache(partial(reader.array, "values", number))
        yield from matrix_leaves(path, tuple(item["shape"]), load, 1, units.get(".".join(path), ""))


def _newest(file: Path, objects: list[str]) -> Iterator[TreeLeaf]:
    reader = Apart(file, READER, "MAT 7.3", "hdf5")
    result = reader.answer("variables")
    objects.extend(name.replace("/", ".") for name in result["objects"])
    for node in result["datasets"]:
        yield from dataset_leaves(reader, file, node, 1, transposed=True)
