"""TOML files that people write: errors name the file and the place in it."""

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
"""Keys whose text, if given, must not be blank."""
BARE_KEY = re.compile(r"[A-Za-z0-9_-]+")


def quoted(text: str) -> str:
    """Text as a TOML string: JSON's escapes, and that of DEL (U+007F), which JSON does not escape."""
    return json.dumps(text, ensure_ascii=False).replace("\x7f", "\\u007f")


def key_of(name: str) -> str:
    """A name as a TOML key: bare if possible, else quoted."""
    return name if BARE_KEY.fullmatch(name) else quoted(name)


def small_text(path: str | Path, what: str) -> str:
    """The text of a file that a command reads; `what` names its kind in errors. Raises `BadInput`."""
    try:
        return small_file(path, what).decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise BadInput(f"{path}: this {what} is not UTF-8 text; save it as UTF-8.") from error


def read_toml(path: str | Path, what: str) -> dict[str, Any]:
    """The table in a TOML file; `what` names its kind in errors. Raises `BadInput` if unreadable or not TOML."""
    return parse_toml(small_text(path, what), str(path))


def parse_toml(text: str, where: str) -> dict[str, Any]:
    """The table in a TOML text; `where` names its source in errors. Raises `BadInput` if it is not TOML."""
    try:
        return tomllib.loads(text)
    except (ValueError, RecursionError) as error:  # ValueError: also integers of thousands of digits
        raise BadInput(f"{where}: not valid TOML: {error}. Mend that line.") from error


def must_know(table: Mapping[str, Any], keys: Collection[str], where: str, what: str = "key") -> None:
    """Raise `BadInput` for an unknown key."""
    for key in table:
        if key not in keys:
            raise BadInput(f'{where}: there is no {what} "{key}".{near(key, keys)} Known are {", ".join(keys)}.')


def table_of(parent: Mapping[str, Any], key: str, where: str) -> Mapping[str, Any]:
    """The table under a key; empty if the key is missing. Raises `BadInput` if the value is not a table."""
    value = parent.get(key, {})
    if not isinstance(value, dict):
        raise BadInput(f'{where}: "{key}" must be a table, not {value!r:.60}.')
    return value


def text_of(table: Mapping[str, Any], key: str, where: str, default: str = "") -> str:
    """The text under a key. Raises `BadInput` if it is not a text, or blank under a key of `NEVER_EMPTY`."""
    value = table.get(key, default)
    if not isinstance(value, str) or (key in table and key in NEVER_EMPTY and not value.strip()):
        raise BadInput(f"{where}: {key} must be text in quotes, not {value!r:.60}.")
    return value
