"""Files of results: JSON that says what it is, in which version, and whether it is as it was written.

Numbers and words only; nothing in such a file is executed.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar

from .errors import BadInput
from .guard import protect
from .json_data import checksum, plain, read_json, without_nan
from .version import __version__

FORMAT, VERSION, CHECKSUM = "format", "format_version", "checksum"

Found = TypeVar("Found")


@dataclass(frozen=True)
class Kind:
    """A kind of result that is kept in a file.

    Attributes
    ----------
    format, version : what its files say they are; a file of another version is not read.
    what : for people: "a fit".
    command : what makes one.
    again : what to do where a file cannot be used: "fit again".
    """

    format: str
    version: int
    what: str
    command: str
    again: str

    def text(self, body: Mapping[str, Any]) -> str:
        """The text of a file of this kind that holds plain data."""
        whole = plain({FORMAT: self.format, VERSION: self.version, **body})
        whole[CHECKSUM] = checksum(whole)
        return json.dumps(without_nan(whole), indent=1, ensure_ascii=False, allow_nan=False) + "\n"

    def load(self, path: str | Path, made: Callable[[dict[str, Any]], Found], *, going_on: bool = False) -> Found:
        """What a file of this kind holds.

        Parameters
        ----------
        path : the file.
        made : makes it of the plain data; `LookupError`, `ArithmeticError`, `TypeError`, `ValueError` and
            `AttributeError` of it mean that the data are not those of such a file.
        going_on : whether it is going to be replaced by what goes on from it.

        Raises
        ------
        BadInput : the file is something else, is damaged, or was written by another version.
        """
        file = Path(path)
        if not going_on:
            protect(file)
        body = read_json(file)
        if not isinstance(body, dict) or body.get(FORMAT) != self.format:
            raise BadInput(f"{file} is not {self.what} of greybox-id; make one with {self.command}.")
        if body.get(VERSION) != self.version:
            raise BadInput(
                f"{file} has format version {body.get(VERSION)!r}, this is greybox-id {__version__}, which reads "
                f"version {self.version}. Install the version that wrote it ({body.get('version', 'unknown')}), or "
                f"{self.again}."
            )
        if body.pop(CHECKSUM, None) != checksum(body):
            raise BadInput(f"{file} is damaged: its content does not match its checksum. Restore it, or {self.again}.")
        try:
            return made(body)
        except (LookupError, ArithmeticError, TypeError, ValueError, AttributeError) as error:
            raise BadInput(f"{file} is damaged: {error}. Restore it, or {self.again}.") from error


def format_of(path: str | Path) -> str:
    """What a file says that it is; "" where it says nothing. Raises `BadInput` where it is no JSON."""
    body = read_json(Path(path))
    return str(body.get(FORMAT, "")) if isinstance(body, dict) else ""
