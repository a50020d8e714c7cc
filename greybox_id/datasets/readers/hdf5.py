"""HDF5 and MAT 7.3 by h5py: list of the datasets, and their values."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import h5py
import numpy as np
from numpy.typing import NDArray


class Hdf5Reader:
    """An opened file."""

    def __init__(self, file: str, _: str) -> None:
        self._opened = h5py.File(file, "r")

    def datasets(self) -> list[dict[str, Any]]:
        """All datasets: name, shape, bytes per element, numeric fields (None for the dataset itself) and unit."""
        result: list[dict[str, Any]] = []

        def visit(name: str, node: Any) -> None:
            if isinstance(node, h5py.Dataset):
                result.extend(_described(name, node))

        self._opened.visititems(visit)
        return result

    def variables(self) -> dict[str, Any]:
        """MATLAB's variables: datasets except texts and empty ones, and the names of objects."""
        result: list[dict[str, Any]] = []
        objects: list[str] = []

        def visit(name: str, node: Any) -> None:
            kind = node.attrs.get("MATLAB_class", b"")
            if name.startswith("#"):
                return
            if "MATLAB_object_decode" in node.attrs:
                objects.append(name)
            elif isinstance(node, h5py.Dataset) and kind != b"char" and not node.attrs.get("MATLAB_empty", 0):
                result.extend(_described(name, node))

        self._opened.visititems(visit)
        return {"datasets": result, "objects": objects}

    def values(self, name: str, field: str | None) -> NDArray[Any]:
        """A dataset, or a field of a compound one."""
        return np.asarray(self._opened[name][()] if field is None else self._opened[name][field])


def _described(name: str, node: Any) -> list[dict[str, Any]]:
    """Description of a dataset, as `Hdf5Reader.datasets` lists it; empty for a dataset without a shape."""
    if node.shape is None:
        return []
    kind = node.dtype
    kinds = {None: kind} if kind.names is None else {field: kind[field] for field in kind.names}
    fields = [field for field, of in kinds.items() if of.shape == () and of.kind in "iufb"]
    unit = _text(node.attrs)
    return [{"name": name, "shape": list(node.shape), "itemsize": kind.itemsize, "fields": fields, "unit": unit}]


def _text(attributes: Mapping[str, Any]) -> str:
    """The unit among a dataset's attributes."""
    for name in ("unit", "units", "Unit", "Units"):
        result = attributes.get(name, "")
        text = result.decode("utf-8", "replace") if isinstance(result, bytes) else result
        if isinstance(text, str) and text:
            return text
    return ""
