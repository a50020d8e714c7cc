"""Origin of equations that greybox-id does not ship: the file that defines them, and its checksum."""

from __future__ import annotations

import hashlib
import os
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from types import FunctionType

PACKAGE = "greybox_id"
DEEPEST = 4
"""Nesting depth to which functions inside functions (closures) are followed."""


@dataclass(frozen=True)
class Origin:
    """File in which the equations of a user's model or effect are defined.

    Attributes
    ----------
    file : path, relative to the working folder if the file lies below it; "" if typed into an interactive session.
    sha256 : checksum of the file, hexadecimal; "" without a file.
    """

    file: str
    sha256: str

    @property
    def words(self) -> str:
        """The origin as printed: path and abbreviated checksum."""
        return f"{self.file} (sha256 {self.sha256[:12]}...)" if self.file else "a session that is over"


def origin_of(*functions: object) -> Origin | None:
    """Origin of the first of these functions that greybox-id does not ship; None if it ships all of them.

    Functions made by helpers of this package (such as `alteration`) hold the user's functions in their closures.
    """
    for function in functions:
        for item in _inside(function, DEEPEST):
            if (item.__module__ or "").partition(".")[0] != PACKAGE:
                return _defined(item)
    return None


def _inside(thing: object, depth: int) -> Iterator[FunctionType]:
    """A function and the functions in its closure, recursively; of a mapping, those of its values."""
    if isinstance(thing, Mapping):
        for item in thing.values():
            yield from _inside(item, depth)
    elif isinstance(thing, FunctionType) and depth:
        yield thing
        for cell in thing.__closure__ or ():
            try:
                held = cell.cell_contents
            except ValueError:  # not yet assigned
                continue
            yield from _inside(held, depth - 1)


def _defined(function: FunctionType) -> Origin:
    path = Path(function.__code__.co_filename)
    try:
        content = path.read_bytes()
    except OSError:  # a notebook's cell, or a file that is gone
        return Origin("", "")
    try:
        shown = os.path.relpath(path)
    except ValueError:  # on another drive
        shown = str(path)
    return Origin(str(path) if shown.startswith("..") else shown, hashlib.sha256(content).hexdigest())
