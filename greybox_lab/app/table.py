"""Tables of words, escaped."""

from __future__ import annotations

from collections.abc import Sequence
from html import escape

from nicegui import ui


def table(head: Sequence[str], rows: Sequence[Sequence[str]], right: Sequence[int] = ()) -> ui.html:
    """A table; `right` are the columns that stand to the right."""

    def cells(values: Sequence[str], tag: str) -> str:
        return "".join(
            f"<{tag}{' class=r' if k in right else ''}>{escape(value)}</{tag}>" for k, value in enumerate(values)
        )

    lines = "".join(f"<tr>{cells(row, 'td')}</tr>" for row in rows)
    text = f"<table class=data><thead><tr>{cells(head, 'th')}</tr></thead><tbody>{lines}</tbody></table>"
    return ui.html(text, sanitize=False).classes("w-full")
