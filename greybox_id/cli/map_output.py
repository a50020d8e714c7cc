"""What `greybox data map` shows of a proposal."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

from rich.console import Console
from rich.table import Table
from rich.text import Text

from ..errors import BadInput
from ..guard import claim
from ..reports.numbers import counted

if TYPE_CHECKING:
    from ..mapping import MapEntry, Proposal


def map_target(out: str) -> Path:
    """Where a map is to be written. Raises `BadInput` for another kind of file, and for one that is there.

    A map that is there may have been edited, and no map is taken for one that may be replaced.
    """
    target = Path(out)
    if target.suffix.lower() != ".toml":
        raise BadInput(f"{out}: a column map is a .toml file; name one with --out.")
    return claim(target, becomes="a column map")


def show_proposal(proposal: Proposal, out: str | None, screen: Console) -> None:
    """Print the proposal as a table, with what is not sure and what to do next."""
    table = Table(box=None, padding=(0, 2, 0, 0), pad_edge=False)
    for title in ("signal", "column", "unit", "why"):
        table.add_column(title, header_style="dim", overflow="fold")
    if proposal.time:
        table.add_row(*_row(proposal.time))
    for entry in sorted(proposal.entries, key=lambda own: not own.decided):
        table.add_row(*_row(entry), style=None if entry.decided else "yellow")
    screen.print(Text(proposal.file, style="bold"))
    screen.print(table)
    if proposal.time is None:
        screen.print("no column looks like a time; say which one holds it")
    if proposal.others:
        screen.print(f"unused: {', '.join(proposal.others)}")
        if proposal.lacking:
            screen.print(f"no column looks like {', '.join(proposal.lacking)}; where one is, name it in the map")
    for finding in proposal.findings:
        screen.print(f"{finding.severity.value}: {finding.where.channel}: {finding.sentence}")
    asked = {entry.signal for entry in proposal.open}
    if asked:
        screen.print(f"{counted(len(asked), 'signal')} left to you (marked ?): {', '.join(sorted(asked))}")
    if out:
        screen.print(f"written  {out}; then: greybox data check {proposal.file} --columns {out}")


def proposal_as_dict(proposal: Proposal, out: str | None) -> dict[str, Any]:
    """The proposal as plain data."""
    return {
        "path": proposal.file,
        "written": out,
        "time": _as_dict(proposal.time) if proposal.time else None,
        "runs": proposal.run or None,
        "signals": [_as_dict(entry) for entry in proposal.entries],
        "others": list(proposal.others),
        "findings": [{"kind": f.kind, "channel": f.where.channel, "sentence": f.sentence} for f in proposal.findings],
    }


def _row(entry: MapEntry) -> tuple[str, str, str, str]:
    unit = entry.unit if entry.decided else " or ".join(entry.units or (entry.unit,)) or "?"
    if entry.divide_by != 1.0:
        unit += f" · {entry.divide_by:g}"
    return (
        ("" if entry.decided else "? ") + entry.signal,
        entry.column,
        ("− " if entry.sign < 0 else "") + unit,
        ("; ".join(entry.reasons)),
    )


def _as_dict(entry: MapEntry) -> dict[str, Any]:
    return {
        "signal": entry.signal,
        "column": entry.column,
        "unit": entry.unit or None,
        "units": list(entry.units),
        "sign": entry.sign,
        "divide_by": entry.divide_by,
        "decided": entry.decided,
        "reasons": list(entry.reasons),
    }
