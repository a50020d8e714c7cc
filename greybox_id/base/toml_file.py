"""TOML files that people write: what cannot be used in one is said with its place."""

from __future__ import annotations

import json
import re
import tomllib
from collections.abc import Collection, Mapping
from pathlib import Path
from typing import Any

from .errors import BadInput, near
from .files import small_file

NEVER_EMPTY = ("column", "name", "unit")
"""Keys whose text says something where it is there."""
BARE_KEY = re.compile(r"[A-Za-z0-9_-]+")


def quoted(text: str) -> str:
    """Text as TOML writes it: JSON's escapes are its own but for the one character that JSON leaves as it is."""
    return json.dumps(text, ensure_ascii=False).replace("\x7f", "\\u007f")


def key_of(name: str) -> str:
    """A name as TOML writes it for a key."""
    return name if BARE_KEY.fullmatch(name) else quoted(name)


def small_text(path: str | Path, what: str) -> str:
    """The text of a file that a command reads; `what` it is, for people. Raises `BadInput`."""
    try:
        return small_file(path, what).decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise BadInput(f"{path}: this {what} is not UTF-8 text; save it as UTF-8.") from error


def read_toml(path: str | Path, what: str) -> dict[str, Any]:
    """What a file holds; `what` it is, for people. Raises `BadInput` where it cannot be read or is no TOML."""
    return parse_toml(small_text(path, what), str(path))


def parse_toml(text: str, where: str) -> dict[str, Any]:
    """What a text holds; `where` it stands, for sentences. Raises `BadInput` where it is no TOML."""
    try:
        return tomllib.loads(text)
    except (ValueError, RecursionError) as error:  # ValueError: also integers of thousands of digits
        raise BadInput(f"{where}: not valid TOML: {error}. Mend that line.") from error


def must_know(table: Mapping[str, Any], keys: Collection[str], where: str, what: str = "key") -> None:
    """Raise `BadInput` for a key that means nothing."""
    for key in table:
        if key not in keys:
            raise BadInput(f'{where}: there is no {what} "{key}".{near(key, keys)} Known are {", ".join(keys)}.')


def table_of(parent: Mapping[str, Any], key: str, where: str) -> Mapping[str, Any]:
    """A table within a table; empty where it is not there. Raises `BadInput` for anything else."""
    value = parent.get(key, {})
    if not isinstance(value, dict):
        raise BadInput(f'{where}: "{key}" must be a table, not {value!r:.60}.')
    return value


def text_of(table: Mapping[str, Any], key: str, where: str, default: str = "") -> str:
    """A text in a table. Raises `BadInput` for anything else, and for a name that is blank."""
    value = table.get(key, default)
    if not isinstance(value, str) or (key in table and key in NEVER_EMPTY and not value.strip()):
        raise BadInput(f"{where}: {key} must be text in quotes, not {value!r:.60}.")
    return value
