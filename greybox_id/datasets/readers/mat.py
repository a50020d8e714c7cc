"""MAT files of version 4 to 7 by scipy: list of the numeric arrays, and their values."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.io import loadmat
from scipy.io.matlab import MatlabFunction, MatlabObject, MatlabOpaque

DEEPEST = 32
"""Largest depth of nested structs; a greater one means a damaged file."""


class MatReader:
    """A loaded file."""

    def __init__(self, file: str, _: str) -> None:
        held = loadmat(file, appendmat=False, mat_dtype=True, struct_as_record=True)
        self._arrays: list[NDArray[Any]] = []
        self._found: dict[str, list[Any]] = {"arrays": [], "texts": [], "objects": []}
        for name, value in held.items():
            if not name.startswith("__"):
                self._take([name], value)

    def variables(self) -> dict[str, list[Any]]:
        """Numeric arrays with their paths and shapes, texts with their paths, and the names of objects."""
        return self._found

    def values(self, number: int) -> NDArray[Any]:
        """The values of an array, by its index in the list of `variables`."""
        return self._arrays[number]

    def _take(self, path: list[str], value: Any) -> None:
        """Record a variable's or field's arrays, texts and objects, recursively; other values cannot be signals."""
        if len(path) > DEEPEST:
            raise ValueError("structs are nested too deep")
        if isinstance(value, MatlabOpaque):
            text = _text(np.ravel(value["s0"])[0]) if path == ["None"] else ""  # its name is in the value
            self._found["objects"].append(text or ".".join(path))
        elif isinstance(value, MatlabObject | MatlabFunction):
            self._found["objects"].append(".".join(path))
        elif isinstance(value, np.ndarray) and value.dtype.names:
            for number, field, inside in _fields(value):
                self._take([*path, field] if value.size == 1 else [*path, str(number), field], inside)
        elif isinstance(value, np.ndarray) and value.dtype.kind in "iufb":
            self._arrays.append(value)
            self._found["arrays"].append({"path": path, "shape": list(value.shape)})
        elif isinstance(value, np.ndarray) and value.dtype.kind in "US" and value.size == 1:
            self._found["texts"].append({"path": path, "text": _text(value.ravel()[0])})


def _fields(records: NDArray[Any]) -> Iterator[tuple[int, str, Any]]:
    """(record number from 1, field, value) of a struct array."""
    for number, record in enumerate(np.ravel(records, order="F"), 1):
        for field in records.dtype.names or ():
            yield number, field, record[field]


def _text(value: Any) -> str:
    return value.decode("utf-8", "replace") if isinstance(value, bytes) else str(value)
