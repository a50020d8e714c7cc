"""A report as text for a terminal."""

from __future__ import annotations

from collections.abc import Iterator

from rich.console import RenderableType

from ..document import Document, Drawing, Points, Section, Table, Text
from .screen import plain_table


def on_screen(document: Document) -> Iterator[RenderableType]:
    """A page for a terminal, without its figures and headings that only a figure is below."""
    parts = [part for part in document.flat if not isinstance(part, Drawing)]
    for part, after in zip(parts, [*parts[1:], Section("", 0)], strict=True):
        match part:
            case Section() if not isinstance(after, Section) or after.level > part.level:
                yield f"\n{part.title}"
            case Points():
                yield from (f"  {item}" for item in part.items)
            case Text():
                yield f"{part.lead} {part.words}".strip()
            case Table():
                right = [title for title, letter in zip(part.head, part.letters, strict=True) if letter in "rR"]
                shown = plain_table(*part.head, right=right)
                for row in part.rows:
                    shown.add_row(*row)
                yield shown
