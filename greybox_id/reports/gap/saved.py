"""The file of a diagnosis: what it says and what it was made with."""

from __future__ import annotations

import json
from dataclasses import asdict
from pathlib import Path
from typing import Any

from ...errors import BadInput
from ...gap import Gap
from ...gap.saved import as_plain_data, from_plain_data, plain
from ...json_data import checksum, read_json, without_nan
from ...provenance import DataRecord
from .content import Made

FORMAT, FORMAT_VERSION = "greybox-gap", 1


def as_text(gap: Gap, made: Made) -> str:
    """The text of the file."""
    body = {"format": FORMAT, "format_version": FORMAT_VERSION, **as_plain_data(gap), **plain(asdict(made))}
    body["checksum"] = checksum(body)
    return json.dumps(without_nan(body), indent=1, ensure_ascii=False, allow_nan=False) + "\n"


def is_gap(body: Any) -> bool:
    """Whether the content of a JSON file is a diagnosis."""
    return isinstance(body, dict) and body.get("format") == FORMAT


def load_gap(path: str | Path) -> tuple[Gap, Made]:
    """Read a diagnosis back, without its closed model, which is a vehicle file of its own.

    Raises
    ------
    BadInput : the file is no diagnosis, is damaged, or was written by a newer version.
    """
    file = Path(path)
    body = read_json(file)
    if not is_gap(body):
        raise BadInput(f"{file} is not a diagnosis of greybox-id; make one with greybox gap --out.")
    if body.get("format_version") != FORMAT_VERSION:
        raise BadInput(
            f"{file} has format version {body.get('format_version')!r}, and this greybox-id reads version "
            f"{FORMAT_VERSION}. Install the version that wrote it ({body.get('version', 'unknown')}), or diagnose "
            "again."
        )
    if body.pop("checksum", None) != checksum(body):
        raise BadInput(f"{file} is damaged: its content does not match its checksum. Restore it, or diagnose again.")
    try:
        data = tuple(DataRecord(**record) for record in body["data"])
        made = Made(
            str(body["vehicle"]),
            str(body["command"]),
            int(body["seed"]),
            str(body["version"]),
            data,
            dict(body["settings"]),
        )
        return from_plain_data(body), made
    except (KeyError, TypeError, ValueError, AttributeError) as error:
        raise BadInput(f"{file} is damaged: {error}. Restore it, or diagnose again.") from error
