"""MAT files: version 4 by scipy, 5 to 7 by `mat5`, 7.3 (which is HDF5) by h5py.

Structs are flattened to dotted names: a timeseries saved as a struct is `speed.Data` on the clock `speed.Time`. Columns
of matrices are counted from 1.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from pathlib import Path

import numpy as np
from scipy.io import loadmat, savemat
from scipy.io.matlab import matfile_version

from ...errors import BadInput
from ..column_map import ColumnMap
from .apart import Apart
from .columns import Columns
from .contents import Contents, sound
from .hdf5 import READER, dataset_leaves
from .mat5 import Opaque, Value, mat5, texts
from .tree import Leaf, groups_of, matrix_leaves

KIND = "MAT"
UNITS = "units"
"""A struct of texts of this name states units."""
LONGEST_NAME = 63
HDF5 = b"\x89HDF\r\n\x1a\n"


def contents(file: Path, mapping: ColumnMap) -> Contents:
    """Vectors, matrices and what lies in structs, by dotted name.

    Raises
    ------
    BadInput
        The file is damaged, or is of version 7.3 and h5py is not installed.
    """
    with file.open("rb") as opened:
        newest = HDF5 in opened.read(1024)
    objects: list[str] = []
    with sound(str(file), KIND):
        if newest:
            leaves = list(_newest(file, objects))
        else:
            data = file.read_bytes()
            held = mat5(data) if matfile_version(file, appendmat=False)[0] else _version_4(file)
            units = {".".join(path[1:]): text for path, text in texts(held) if path[0] == UNITS}
            leaves = [leaf for name, value in held.items() for leaf in _flat((name,), value, units, objects)]
    notes: tuple[str, ...] = ()
    if objects:
        lost = ", ".join(objects[:6])
        notes = (f"{lost}: MATLAB objects cannot be read; save timeseries as struct(ts) or as vectors.",)
    return Contents(str(file), groups_of(leaves, ".", mapping.time.column, str(file)), KIND, notes)


def write(columns: Columns, path: Path) -> None:
    """Write columns as standing vectors, and their units as a struct.

    Raises
    ------
    BadInput
        MATLAB would not take a column's name for that of a variable.
    """
    for name in columns.values:
        if not re.fullmatch(rf"[A-Za-z]\w{{0,{LONGEST_NAME - 1}}}", name, re.ASCII):
            raise BadInput(f'{path}: MAT has no variable named "{name}"; rename it in the column map, or write .h5.')
    vectors = {name: np.reshape(values, (-1, 1)) for name, values in columns.values.items()}
    savemat(path, {**vectors, UNITS: dict(columns.units)}, do_compression=True, long_field_names=True)


def _version_4(file: Path) -> dict[str, Value]:
    return {name: value for name, value in loadmat(file, appendmat=False).items() if isinstance(value, np.ndarray)}


def _flat(path: tuple[str, ...], value: Value, units: Mapping[str, str], objects: list[str]) -> Iterator[Leaf]:
    if isinstance(value, Opaque):
        objects.append(".".join(path))
    elif isinstance(value, list):
        for number, record in enumerate(value, 1):
            for name, own in record.items():
                yield from _flat((*path, name) if len(value) == 1 else (*path, str(number), name), own, units, objects)
    elif isinstance(value, np.ndarray) and value.dtype.kind in "iufb":
        array = value
        yield from matrix_leaves(path, array.shape, lambda: array, 1, units.get(".".join(path), ""))


def _newest(file: Path, objects: list[str]) -> Iterator[Leaf]:
    reader = Apart(file, READER, "MAT 7.3", "hdf5")
    found = reader.answer("variables")
    objects.extend(name.replace("/", ".") for name in found["objects"])
    for node in found["datasets"]:
        yield from dataset_leaves(reader, file, node, 1, transposed=True)
