"""JSON with non-finite numbers, and result files in JSON with format, version and checksum.

Such files hold numbers and texts only; nothing in them is executed.
"""

from __future__ import annotations

import hashlib
import json
import math
import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from .errors import BadInput
from .files import near_file
from .guard import protect
from .version import __version__

NOT_FINITE = "not_finite"
"""JSON has no non-finite numbers; they are written as {"not_finite": "nan"}, "inf" or "-inf"."""


def without_nan(value: Any) -> Any:
    """Plain data with non-finite numbers replaced by `NOT_FINITE` tables."""
    if isinstance(value, Mapping):
        return {name: without_nan(item) for name, item in value.items()}
    if isinstance(value, (list, tuple)):
        return [without_nan(item) for item in value]
    if isinstance(value, float) and not np.isfinite(value):
        return {NOT_FINITE: str(float(value))}
    return value


def plain(value: Any) -> Any:
    """Plain data with numpy scalars and arrays converted to Python's numbers and lists."""
    if isinstance(value, np.generic):
        return value.item()
    if isinstance(value, np.ndarray):
        return value.tolist()
    if isinstance(value, Mapping):
        return {str(key): plain(inner) for key, inner in value.items()}
    if isinstance(value, (list, tuple)):
        return [plain(inner) for inner in value]
    return value


def attributes(of: object, *names: str) -> dict[str, Any]:
    """Some attributes of an object, by name."""
    return {name: getattr(of, name) for name in names}


def finite(value: Any) -> Any:
    """Plain data with NaN and infinities replaced by null, for readers of standard JSON."""
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    if isinstance(value, Mapping):
        return {key: finite(inner) for key, inner in value.items()}
    if isinstance(value, (list, tuple)):
        return [finite(inner) for inner in value]
    return value


def _with_nan(body: dict[str, Any]) -> Any:
    if set(body) == {NOT_FINITE} and body[NOT_FINITE] in ("nan", "inf", "-inf"):
        return float(body[NOT_FINITE])
    return body


def read_json(file: Path) -> Any:
    """Plain data of a file written with `without_nan`."""
    try:
        return json.loads(file.read_text(encoding="utf-8"), object_hook=_with_nan)
    except OSError as error:
        raise BadInput(f"{file} cannot be read: {error.strerror}.{near_file(file)}") from error
    except (ValueError, RecursionError) as error:
        if _begins(file) not in (b"{", b"[", b""):
            raise BadInput(f"{file} is not JSON; name a file that greybox-id wrote, such as fit.json.") from error
        raise BadInput(f"{file} is damaged: it is not JSON ({error}). Restore it, or make it again.") from error


def _begins(file: Path) -> bytes:
    """The first non-blank character of a file."""
    with file.open("rb") as stream:
        return stream.read(1000).lstrip()[:1]


def checksum(body: Mapping[str, Any]) -> str:
    """Hash of plain data, independent of the order of keys."""
    plain = json.dumps(body, sort_keys=True, allow_nan=True, default=list)
    return hashlib.sha256(plain.encode()).hexdigest()


FORMAT, VERSION, CHECKSUM = "format", "format_version", "checksum"

_NUMBERS = re.compile(r"\[\n\s*([-+.,\deE\s]+?)\n\s*\]")
"""A list of numbers, one below the other: a line of a file holds a whole list."""

Found = TypeVar("Found")


@dataclass(frozen=True)
class Kind:
    """A kind of result that is saved to a file.

    Attributes
    ----------
    format, version : stated in its files; a file of another version is not read.
    what : its name in errors, such as "a fit".
    command : the command that makes such a file.
    again : advice if a file cannot be used, such as "fit again".
    """

    format: str
    version: int
    what: str
    command: str
    again: str

    def text(self, body: Mapping[str, Any]) -> str:
        """Plain data as the text of a file of this kind."""
        whole = plain({FORMAT: self.format, VERSION: self.version, **body})
        whole[CHECKSUM] = checksum(whole)
        text = json.dumps(without_nan(whole), indent=1, ensure_ascii=False, allow_nan=False)
        return _NUMBERS.sub(lambda found: f"[{' '.join(found[1].split())}]", text) + "\n"

    def load(self, path: str | Path, made: Callable[[dict[str, Any]], Found], *, going_on: bool = False) -> Found:
        """Load a result of this kind from a file.

        Parameters
        ----------
        path : the file.
        made : builds the result from plain data; `LookupError`, `ArithmeticError`, `TypeError`, `ValueError` and
            `AttributeError` raised by it are reported as a damaged file.
        going_on : whether the command continues this result and replaces the file: it is then not protected.

        Raises
        ------
        BadInput : the file is of another kind, damaged, or written by another version.
        """
        file = Path(path)
        if not going_on:
            protect(file)
        body = read_json(file)
        if not isinstance(body, dict) or body.get(FORMAT) != self.format:
            raise BadInput(f"{file} is not {self.what} of greybox-id; make one with {self.command}.")
        if body.get(VERSION) != self.version:
            raise BadInput(
                f"{file} has format version {body.get(VERSION)!r}, but greybox-id {__version__} reads version "
                f"{self.version}. Install the version that wrote it ({body.get('version', 'unknown')}), or "
                f"{self.again}."
            )
        if body.pop(CHECKSUM, None) != checksum(body):
            raise BadInput(f"{file} is damaged: its content does not match its checksum. Restore it, or {self.again}.")
        try:
            return made(body)
        except (LookupError, ArithmeticError, TypeError, ValueError, AttributeError) as error:
            raise BadInput(f"{file} is damaged: {error}. Restore it, or {self.again}.") from error


def format_of(path: str | Path) -> str:
    """Format stated in a file; "" if none is stated. Raises `BadInput` if the file is not JSON."""
    body = read_json(Path(path))
    return str(body.get(FORMAT, "")) if isinstance(body, dict) else ""
