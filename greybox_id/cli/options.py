"""Options that several commands share."""

from __future__ import annotations

import json
import re
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from .completion import names

if TYPE_CHECKING:
    from ..datasets.column_map import ColumnMap
    from ..recording import Recording


def _vehicles() -> tuple[str, ...]:
    from ..datasets.vehicle_file import shipped_vehicles

    return shipped_vehicles()


def _maps() -> tuple[str, ...]:
    from ..datasets.column_map import shipped_maps

    return shipped_maps()


VEHICLES = names(_vehicles, files=".toml")
"""What completes the name of a vehicle."""
PART = "part of each recording"
"""Where a command keeps what --between and --where say, until its recordings are read."""


def _kept(ctx: click.Context, option: click.Parameter, value: Any) -> None:
    ctx.meta.setdefault(PART, {})[option.name] = value


def _span(ctx: click.Context, option: click.Parameter, value: str | None) -> None:
    from ..condition import span
    from ..errors import BadInput

    try:
        _kept(ctx, option, None if value is None else span(value))
    except BadInput as error:
        raise click.BadParameter(str(error)) from error


calibrate_option = click.option(
    "--calibrate", metavar="timing[=SECONDS]",
    help="Models with memory: first seconds (5) of each new run tell its delay; what follows counts.",
)  # fmt: skip


def columns_option(command: Callable[..., Any]) -> Callable[..., Any]:
    """How recordings are read: --columns, and --between and --where, which `read_part` obeys."""
    for option in (
        click.option(
            "--where", metavar="CONDITION", callback=_kept, expose_value=False,
            help='Only rows at which this holds, such as "v_x > 5 and abs(steer) < 0.1".',
        ),
        click.option(
            "--between", metavar="START:STOP", callback=_span, expose_value=False,
            help="Only rows from START to STOP, in s; one of them may be omitted.",
        ),
        click.option(
            "--columns", default="canonical", show_default=True, metavar="MAP",
            shell_complete=names(_maps, files=".toml"),
            help="Column map: name of a shipped one, or a .toml file.",
        ),
    ):  # fmt: skip
        command = option(command)
    return command


def read_part(file: str | Path, columns: str | Path | ColumnMap = "canonical") -> Recording:
    """A recording, or that part of it for which the running command was asked with --between and --where."""
    from ..datasets.read import read

    return part_asked(read(file, columns))


def part_asked(recording: Recording) -> Recording:
    """The part of a recording for which the running command was asked."""
    ctx = click.get_current_context(silent=True)
    asked = ctx.meta.get(PART, {}) if ctx is not None else {}
    return part(recording, asked.get("between"), asked.get("where"))


def part(recording: Recording, between: tuple[float | None, float | None] | None, where: str | None) -> Recording:
    """The rows that lie between two times and at which a condition holds."""
    if between is not None:
        recording = recording.between(*between)
    return recording if where is None else recording.where(where)


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
