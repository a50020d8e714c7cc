"""How a diagnosis is printed."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path

from rich.console import Console, Group, RenderableType
from rich.table import Table

from ..gap import Closure, Errors, Gap
from ..json_data import plain
from ..reports.gap.content import Made
from ..reports.gap.quantities import magnitude_words
from ..reports.gap.words import as_it_stands, how_far, judged, left, levels, told_apart, where, whether
from ..reports.numbers import number, pretty_unit
from .output import finite

LEAST, MOST = 0.02, 6
"""Effects less probable than this are not printed unless they are applied; at most so many are."""
MOST_WORDS = 4
"""Effects that did not show, or would not, that are named."""
NARROW = 110
"""Narrower terminals are shown two horizons."""
NEAR = 0.5
"""Horizon, s, shown beside the free run where there is little room."""


def as_json_text(gap: Gap, made: Made, written: Sequence[Path]) -> str:
    """The diagnosis and what it was made with as one JSON object; what is not a finite number becomes null."""
    body = plain({**gap.to_json(), **asdict(made), "written": [str(target) for target in written]})
    return json.dumps(finite(body), indent=1, ensure_ascii=False, allow_nan=False) + "\n"


def show(out: Console, gap: Gap) -> None:
    """Print a diagnosis for people: doubts on the data, whether, where, which, how far, what is left."""
    for doubt in gap.doubts:
        out.print(_row("Doubt", doubt))
    out.print(whether(gap))
    place = where(gap)
    if place:
        out.print(_row("Where", place))
    which = _which(gap, out.width)
    if which is not None:
        out.print(_row("Which", which))
    for line in _silent(gap):
        out.print(_row("", line))
    out.print(_row("How far", _how_far(gap, out.width)))
    out.print(_row("Left", left(gap)))
    for sentence in gap.advice:
        out.print(_row("Next", sentence))


def _row(lead: str, words: RenderableType) -> Table:
    """A line of the answer: its lead, and words that wrap beside it."""
    table = Table.grid(padding=(0, 1, 0, 0))
    table.add_column(width=8, no_wrap=True)
    table.add_column(overflow="fold")
    table.add_row(lead, words)
    return table


def _which(gap: Gap, width: int) -> Group | None:
    """The ranked effects with magnitude, probability, and what they cannot be told from."""
    likely = [
        (k, own) for k, own in enumerate(gap.ranking, 1) if own.probability >= LEAST or own.effect in gap.applied
    ][:MOST]
    if not likely or not (gap.gap_detected or gap.applied):
        return None
    wide = width >= NARROW
    table = Table.grid(padding=(0, 2, 0, 0))
    for _ in range(4 + wide):
        table.add_column(overflow="fold")
    heads = ("", "effect", "magnitude ± sd or [95 %]", "probability", "")
    table.add_row(*heads[: 4 + wide], style="dim")
    notes: list[RenderableType] = [table]
    for k, own in likely:
        note = "; ".join(filter(None, ("applied" if own.effect in gap.applied else "", told_apart(gap, own))))
        cells = (str(k), own.effect, magnitude_words(own), _probability(own.probability))
        table.add_row(*cells, *([note] if wide else []))
        if note and not wide:
            notes.append(f"{k}  {note}")
    rest = len(gap.ranking) - len(likely)
    if rest:
        notes.append(f"and {rest} less likely, told by --json")
    return Group(*notes)


def _probability(value: float) -> str:
    return "> 0.99" if value > 0.99 else "< 0.01" if value < 0.01 else f"{value:.2f}"


def _silent(gap: Gap) -> list[str]:
    """What would not show on these recordings, and what would be taken up by something else."""
    lines = []
    if gap.not_excited:
        named = [f"{name} up to {_printed(size)}" for name, size in list(gap.not_excited.items())[:MOST_WORDS]]
        lines.append(f"would not show here: {_and_more(named, len(gap.not_excited))}")
    if gap.absorbed:
        named = list(gap.absorbed[:MOST_WORDS])
        lines.append(f"taken up by tolerances or free parameters: {_and_more(named, len(gap.absorbed))}")
    return lines


def _printed(size: str) -> str:
    """A size with its unit as people write it."""
    value, _, unit = size.partition(" ")
    return f"{value} {pretty_unit(unit)}" if value.startswith("±") and unit else size


def _and_more(named: Sequence[str], count: int) -> str:
    more = count - len(named)
    return ", ".join(named) + (f" and {more} more, told by --json" if more > 0 else "")


def _how_far(gap: Gap, width: int) -> Group:
    closure, held_out = judged(gap)
    said: list[RenderableType] = [how_far(gap, closure, held_out), levels(closure)]
    if warning := as_it_stands(closure):
        said.append(warning)
    if not held_out and gap.applied:
        said.append("what it is worth on other recordings is not known: name some with --held-out")
    if closure.errors:
        said.append(_errors(closure, width))
    return Group(*said)


def _errors(closure: Closure, width: int) -> Table:
    """RMSE before → after (floor) for each channel, over the horizons."""
    horizons = sorted({own.horizon for own in closure.errors}, key=lambda h: float("inf") if h is None else h)
    if width < NARROW and len(horizons) > 2:
        timed = [h for h in horizons if h is not None]
        near = min(timed, key=lambda h: abs(h - NEAR))
        horizons = [near, horizons[-1]]
    table = Table(box=None, padding=(0, 2, 0, 0), pad_edge=False, show_edge=False)
    table.add_column("RMSE before → after (floor)", header_style="dim")
    for horizon in horizons:
        table.add_column("free run" if horizon is None else f"{horizon:g} s", header_style="dim", no_wrap=True)
    by = {(own.channel, own.horizon): own for own in closure.errors}
    for channel in dict.fromkeys(own.channel for own in closure.errors):
        unit = next(own.unit for own in closure.errors if own.channel == channel)
        cells = [_error(by.get((channel, horizon))) for horizon in horizons]
        table.add_row(f"{channel} [{pretty_unit(unit)}]", *cells)
    return table


def _error(own: Errors | None) -> str:
    if own is None:
        return "–"
    return f"{number(own.before, 2)} → {number(own.after, 2)} ({number(own.floor, 2)})"
