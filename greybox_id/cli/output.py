"""What a person sees while and after a command works, on standard error and standard output."""

from __future__ import annotations

import json
import math
import sys
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

import click
from rich.console import Console, JustifyMethod
from rich.table import Table

from ..reports.numbers import pretty_unit
from ..signals import unit_of

if TYPE_CHECKING:
    from ..fitting import Say

WIDTH = 160
"""Columns of tables that go to a file or a pipe."""


def console() -> Console:
    """Standard output for people; names and sentences may hold brackets, so there is no markup."""
    found = Console(highlight=False, markup=False)
    if not found.is_terminal:
        found.width = WIDTH
    return found


@contextmanager
def progress() -> Iterator[Say]:
    """A live line on a terminal, plain lines elsewhere; all on standard error."""
    errors = Console(stderr=True, highlight=False, markup=False, soft_wrap=True)
    if not errors.is_terminal:

        def plain(line: str, passing: bool = False) -> None:
            if not passing:
                click.echo(line, err=True)

        yield plain
        return
    with errors.status("starting") as status:

        def live(line: str, passing: bool = False) -> None:
            status.update(line)
            if not passing:
                errors.print(line, style="dim")

        yield live


def print_json(body: Mapping[str, Any]) -> None:
    """One JSON object on standard output; what is not a finite number becomes null."""
    sys.stdout.write(json.dumps(finite(body), indent=1, ensure_ascii=False, allow_nan=False) + "\n")


def finite(value: Any) -> Any:
    """Plain data without NaN and infinities, which JSON does not know: they become null."""
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    if isinstance(value, Mapping):
        return {key: finite(inner) for key, inner in value.items()}
    if isinstance(value, (list, tuple)):
        return [finite(inner) for inner in value]
    return value


def plain(value: float) -> str:
    """A stated number, as it was stated."""
    return f"{value:.6g}".replace("inf", "∞").replace("-", "−")


PROTOCOL_WORDS = {
    "honest": "one sample ahead, pooled, no window across a join",
    "published": "as published: batches of 100, windows across joins",
    "closed_loop": "free run on own predictions, pooled",
    "free run": "free run of whole manoeuvres, pooled",
}


def errors_table(metrics: Mapping[str, Any]) -> Table:
    """Errors by recording, protocol and output, each with its standard error and unit."""
    table = Table(box=None, padding=(0, 2, 0, 0), pad_edge=False)
    titles: tuple[tuple[str, JustifyMethod], ...] = (
        ("error", "left"),
        ("protocol", "left"),
        ("RMSE", "right"),
        ("unit", "left"),
        ("FVU", "right"),
    )
    for title, justify in titles:
        table.add_column(title, header_style="dim", justify=justify)
    for role, protocols in metrics.items():
        for protocol, outputs in protocols.items():
            for name, error in outputs.items():
                sd = error["rmse_sd"]
                rmse = f"{error['rmse']:.4f} ± " + (f"{sd:.4f}" if math.isfinite(sd) else "–")
                unit = pretty_unit(unit_of(name))
                table.add_row(f"{role} {name}", PROTOCOL_WORDS[protocol], rmse, unit, f"{error['fvu']:.4f}")
    return table
