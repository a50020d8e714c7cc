"""A run of a fleet as a table that is drawn anew while it goes."""

from __future__ import annotations

from rich.console import Group, RenderableType
from rich.table import Table
from rich.text import Text

from ..processes import duration
from .run import FleetProgress
from .states import OK, STATUSES

MOST = 12
"""Vehicles shown: those with most recordings that did not end well."""


def live(progress: FleetProgress) -> RenderableType:
    """The table: a row for each vehicle, the worst first, and a line for all."""
    table = Table(box=None, padding=(0, 2, 0, 0), pad_edge=False)
    table.add_column("vehicle", header_style="dim")
    for name in STATUSES:
        table.add_column(name, header_style="dim", justify="right")
    worst = sorted(progress.vehicles.items(), key=lambda own: (own[1][OK] - sum(own[1].values()), own[0]))
    for name, counts in worst[:MOST]:
        table.add_row(Text(name), *(str(counts[status] or "") for status in STATUSES))
    if len(worst) > MOST:
        table.add_row(Text(f"and {len(worst) - MOST} more", style="dim"))
    lines: list[RenderableType] = [table, Text(f"{progress.line()}  {duration(progress.seconds)}")]
    if progress.last:
        lines.append(Text(progress.last, style="yellow", no_wrap=True, overflow="ellipsis"))
    return Group(*lines)
