"""MAT files of version 5 to 7, as MathWorks' "MAT-File Format" describes them; only what can be a signal is kept.

A reader of our own: that of scipy ends the process over some damaged files.
"""

from __future__ import annotations

import zlib
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from .tree import LARGEST_SWELL, SMALL

MATRIX, COMPRESSED = 14, 15
TYPES = {1: "i1", 2: "u1", 3: "i2", 4: "u2", 5: "i4", 6: "u4", 7: "f4", 9: "f8", 12: "i8", 13: "u8", 16: "u1", 17: "u2",
         18: "u4"}  # fmt: skip
"""Types of data elements."""
NUMBERS = {6: "f8", 7: "f4", 8: "i1", 9: "u1", 10: "i2", 11: "u2", 12: "i4", 13: "u4", 14: "i8", 15: "u8"}
"""Classes of arrays that hold numbers."""
STRUCT, TEXT, OBJECTS = 2, 4, (3, 16, 17)
COMPLEX = 0x08
DEEPEST = 32
"""Structs within structs; deeper ones are damage."""


@dataclass(frozen=True)
class Opaque:
    """A MATLAB object, which only MATLAB reads."""


Value = NDArray[Any] | str | Opaque | list[dict[str, Any]]
"""An array of numbers, a text, an object, or the records of a struct array."""


def mat5(data: bytes) -> dict[str, Value]:
    """The variables of a file.

    Parameters
    ----------
    data : the file's bytes.

    Raises
    ------
    ValueError
        The bytes are no undamaged MAT file of this version.
    """
    if len(data) < 128 or data[126:128] not in (b"IM", b"MI"):
        raise ValueError("its header is damaged")
    order = "<" if data[126:128] == b"IM" else ">"
    found: dict[str, Value] = {}
    for kind, body in _elements(data[128:], order, aligned=False):
        if kind == COMPRESSED:
            inside = _inflated(body)
            elements = list(_elements(inside, order))
        else:
            elements = [(kind, body)]
        for own, content in elements:
            if own == MATRIX:
                name, value = _matrix(content, order, 0)
                if name and value is not None:
                    found[name] = value
    return found


def _inflated(body: bytes) -> bytes:
    limit = max(SMALL, LARGEST_SWELL * len(body))
    stream = zlib.decompressobj()
    inside = stream.decompress(body, limit)
    if not stream.eof:
        raise ValueError("a compressed variable is cut short or too large")
    return inside


def _elements(data: bytes, order: str, aligned: bool = True) -> Iterator[tuple[int, bytes]]:
    """The data elements in a stretch of bytes: type and content."""
    place = 0
    endian: Literal["little", "big"] = "little" if order == "<" else "big"
    while place + 8 <= len(data):
        head = int.from_bytes(data[place : place + 4], endian)
        if head >> 16:  # four bytes at most, in the place of the length
            kind, size, start, step = head & 0xFFFF, head >> 16, place + 4, 8
        else:
            kind, start = head, place + 8
            size = int.from_bytes(data[place + 4 : place + 8], endian)
            padded = aligned or kind == MATRIX
            step = 8 + (-(-size // 8) * 8 if padded and kind != COMPRESSED else size)
        if start + size > len(data) or (head >> 16 and size > 4):
            raise ValueError("a data element is longer than the file")
        yield kind, data[start : start + size]
        place += step


def _matrix(body: bytes, order: str, depth: int) -> tuple[str, Value | None]:
    """Name and value of an array; no value for what cannot be a signal."""
    parts = _elements(body, order)
    flags = _array(next(parts, (0, b"")), order)
    if depth > DEEPEST or flags.size < 1:
        raise ValueError("an array has no flags, or structs lie too deep")
    kind = int(flags[0]) & 0xFF
    shape = () if kind in OBJECTS else tuple(int(n) for n in _array(next(parts, (0, b"")), order))
    name = _text(next(parts, (0, b"")), order)
    if kind in OBJECTS:
        return name or _text(next(parts, (0, b"")), order), Opaque()
    if any(n < 0 for n in shape) or np.prod([float(n) for n in shape]) > max(len(body), 1):
        raise ValueError(f"{name} has a size of {shape} in {len(body)} bytes")
    if kind == STRUCT:
        return name, _records(parts, shape, order, depth)
    values = _array(next(parts, (0, b"")), order)
    if kind == TEXT:
        return name, "".join(chr(c) for c in values.tolist() if 0 < c < 0x110000)
    if kind not in NUMBERS or int(flags[0]) >> 8 & COMPLEX:
        return name, None
    if values.size != int(np.prod(shape)):
        raise ValueError(f"{name} has {values.size} values for a size of {shape}")
    with np.errstate(invalid="ignore", over="ignore"):
        return name, values.reshape(shape, order="F").astype(NUMBERS[kind])


def _records(
    parts: Iterator[tuple[int, bytes]], shape: tuple[int, ...], order: str, depth: int
) -> list[dict[str, Any]]:
    length = _array(next(parts, (0, b"")), order)
    names = next(parts, (0, b""))[1]
    width = int(length[0]) if length.size else 0
    if not 0 < width <= 64 or len(names) % width:
        raise ValueError("the names of a struct's fields are damaged")
    fields = [names[k : k + width].split(b"\0")[0].decode("utf-8", "replace") for k in range(0, len(names), width)]
    records: list[dict[str, Any]] = []
    for _ in range(int(np.prod(shape)) if fields else 0):
        record: dict[str, Any] = {}
        for field in fields:
            kind, content = next(parts, (0, b""))
            if kind != MATRIX:
                raise ValueError(f"the field {field} of a struct is no array")
            value = _matrix(content, order, depth + 1)[1] if content else None
            if value is not None:
                record[field] = value
        records.append(record)
    return records


def _array(element: tuple[int, bytes], order: str) -> NDArray[Any]:
    kind, content = element
    if kind not in TYPES:
        raise ValueError(f"a data element has the unknown type {kind}")
    return np.frombuffer(content[: len(content) // int(TYPES[kind][1]) * int(TYPES[kind][1])], order + TYPES[kind])


def _text(element: tuple[int, bytes], order: str) -> str:
    return bytes(_array(element, order).astype(np.uint8)).decode("utf-8", "replace").rstrip("\0")


def texts(held: Mapping[str, Any], path: tuple[str, ...] = ()) -> Iterator[tuple[tuple[str, ...], str]]:
    """All texts among variables, by path."""
    for name, value in held.items():
        if isinstance(value, str):
            yield (*path, name), value
        elif isinstance(value, list) and len(value) == 1:
            yield from texts(value[0], (*path, name))
