"""Options that several commands share."""

from __future__ import annotations

import json
import re
from collections.abc import Sequence
from typing import Any

import click

from ..datasets.column_map import shipped_maps
from ..datasets.vehicle_file import shipped_vehicles
from .completion import names

VEHICLES = names(shipped_vehicles(), files=".toml")
"""What completes the name of a vehicle."""
columns_option = click.option(
    "--columns", default="canonical", show_default=True, metavar="MAP",
    shell_complete=names(shipped_maps(), files=".toml"),
    help="Column map: name of a shipped one, or a .toml file.",
)  # fmt: skip
json_option = click.option("--json", "as_json", is_flag=True, help="One JSON object on standard output.")
jobs_option = click.option(
    "--jobs", type=click.IntRange(min=1), default=1, show_default=True, help="Processes at a time (on Linux)."
)

WORD = re.compile(r"[A-Za-z_][\w-]*")
"""A setting that is a name, such as that of a tyre."""


def settings_of(pairs: Sequence[str]) -> dict[str, Any]:
    """NAME=VALUE pairs as nested plain data: `lat.q=14` becomes {"lat": {"q": 14}}; values are JSON or single words."""
    found: dict[str, Any] = {}
    for pair in pairs:
        name, equals, text = pair.partition("=")
        if not equals or not name:
            raise click.UsageError(f"{pair!r} is not NAME=VALUE.")
        try:
            value = json.loads(text)
        except (ValueError, RecursionError) as error:
            if not WORD.fullmatch(text):
                raise click.UsageError(f"{pair!r}: {text!r} is no number, word, true, false or [list].") from error
            value = text
        *groups, last = name.split(".")
        inner = found
        for group in groups:
            inner = inner.setdefault(group, {})
            if not isinstance(inner, dict):
                raise click.UsageError(f"{pair!r}: {group} is given as a value and as a group.")
        inner[last] = value
    return found
