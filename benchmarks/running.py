"""What benchmarks share: the options of their command lines, and what they found as JSON or as tables."""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Mapping
from typing import Any

from greybox_id.reports.text.screen import Screen, plain_table


def options(doc: str, **known: Any) -> argparse.Namespace:
    """The options of a command line, and --json.

    Parameters
    ----------
    doc : what the benchmark is; its first line is shown.
    known : name -> default, which says the type, or what `add_argument` takes.
    """
    parser = argparse.ArgumentParser(description=doc.splitlines()[0])
    for name, value in known.items():
        more = value if isinstance(value, dict) else {"type": type(value), "default": value}
        parser.add_argument(f"--{name.replace('_', '-')}", **more)
    parser.add_argument("--json", action="store_true", help="one JSON object on standard output")
    return parser.parse_args()


def tell(found: Mapping[str, Any], as_json: bool) -> None:
    """One JSON object; or a table for each list of rows, and a line for whatever else there is."""
    if as_json:
        sys.stdout.write(json.dumps(found, indent=1, ensure_ascii=False, default=float) + "\n")
        return
    screen = Screen()
    screen.width = max(screen.width, 180)
    for name, value in found.items():
        if value == []:
            continue
        if not (isinstance(value, list) and value and all(isinstance(row, Mapping) for row in value)):
            screen.print(f"{name.replace('_', ' ')}: {_shown(value)}")
            continue
        titles = list(dict.fromkeys(title for row in value for title in row))
        numbers = [title for title in titles if all(isinstance(row.get(title), float | int | None) for row in value)]
        table = plain_table(
            *(title.replace("_", " ") for title in titles), right=[one.replace("_", " ") for one in numbers]
        )
        for row in value:
            table.add_row(*(_shown(row.get(title)) for title in titles))
        screen.print(table)


def _shown(value: Any) -> str:
    if value is None:
        return ""
    if isinstance(value, float):
        return f"{value:.4g}"
    if isinstance(value, Mapping):
        return ", ".join(f"{name} {_shown(item)}" for name, item in value.items())
    return ", ".join(map(_shown, value)) if isinstance(value, list | tuple) else str(value)
