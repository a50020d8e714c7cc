"""How a diagnosis is printed."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path

from rich.console import Console, Group
from rich.table import Table

from ..gap import Gap
from ..gap.changed import Changed
from ..json_data import finite, plain
from ..models.effects import EFFECTS
from ..reports.gap.saved import Made
from ..reports.gap.words import budget, magnitude_words
from ..reports.numbers import listed, number, pretty_unit
from ..reports.text.gap import parts, probability
from ..reports.text.screen import led


def as_json_text(gap: Gap, made: Made, written: Sequence[Path], changed: Changed | None = None) -> str:
    """The diagnosis and what it was made with as one JSON object; what is not a finite number becomes null."""
    told = gap.to_json() if changed is None else changed.to_json()
    body = plain({**told, **asdict(made), "written": [str(target) for target in written]})
    return json.dumps(finite(body), indent=1, ensure_ascii=False, allow_nan=False) + "\n"


def show(out: Console, gap: Gap) -> None:
    """Print a diagnosis for people: doubts on the data, whether, where, which, how far, what is left."""
    for part in parts(gap, out.width):
        out.print(part)


def show_changed(out: Console, found: Changed) -> None:
    """Print what changed since other recordings, how much of the gap that is, and what did not change."""
    gap = found.gap
    for doubt in (*gap.doubts, *found.drift):
        out.print(led("Doubt", doubt))
    table = Table.grid(padding=(0, 2, 0, 0))
    for _ in range(4):
        table.add_column(overflow="fold")
    for own in gap.ranking:
        if own.effect in gap.applied:
            mean = number(found.scatter[own.effect][0], 2)
            table.add_row(own.effect, magnitude_words(own), probability(own.probability), f"before: {mean}")
    before = listed([*found.since])
    lead = f"beyond what {before} scatter by" if gap.applied else f"nothing beyond what {before} scatter by"
    out.print(led("Changed", Group(lead, table) if gap.applied else lead))
    for own in gap.ranking:
        if own.reason:
            out.print(led("", f"{own.effect} {number(own.magnitude, 2)} not applied: {own.reason}"))
    if gap.budget is not None:
        out.print(led("Budget", budget(gap)))
    still = [f"{name} (± {_within(found, name)})" for name in found.scatter if name not in gap.applied]
    out.print(led("Same", f"within two standard deviations of the scatter: {listed(still)}"))
    out.print(led("Left", gap.unknown or "nothing unnamed shows"))


def _within(found: Changed, name: str) -> str:
    """Twice the standard deviation of an effect's scatter, in its unit; factors in per cent."""
    size, unit = 2 * found.scatter[name][1], EFFECTS[name].parameter.unit
    return f"{number(100 * size, 2)} %" if unit == "1" else f"{number(size, 2)} {pretty_unit(unit)}"
