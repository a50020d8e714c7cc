"""Lines and tables on a screen or as plain text; nothing in names of files, columns or units orders a terminal."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator
from io import StringIO

from rich.console import Console, ConsoleOptions, JustifyMethod, RenderableType
from rich.segment import Segment
from rich.table import Table

from ..words import clean

WIDTH = 160
"""Columns of tables that go to a file or a pipe."""


class Screen(Console):
    """Output for people; names and sentences may hold brackets, so there is no markup."""

    def __init__(
        self,
        *,
        errors: bool = False,
        soft_wrap: bool = False,
        file: StringIO | None = None,
        width: int | None = None,
    ) -> None:
        super().__init__(stderr=errors, highlight=False, markup=False, soft_wrap=soft_wrap, file=file, width=width)

    def render(self, renderable: RenderableType, options: ConsoleOptions | None = None) -> Iterator[Segment]:
        """Segments without orders but rich's own."""
        for item in super().render(renderable, options):
            yield item if item.control else Segment(clean(item.text), item.style)


def as_text(parts: Iterable[RenderableType], width: int = WIDTH) -> str:
    """What a screen of so many columns shows, without blanks at the ends of lines."""
    screen = Screen(file=StringIO(), width=width)
    for part in parts:
        screen.print(part)
    assert isinstance(screen.file, StringIO)
    return "\n".join(line.rstrip() for line in screen.file.getvalue().rstrip().splitlines())


def plain_table(*titles: str, right: Collection[str] = (), fold: bool = False) -> Table:
    """A table without lines; columns of these titles on the right, words that are too long cut or folded."""
    table = Table(box=None, padding=(0, 2, 0, 0), pad_edge=False)
    for title in titles:
        justify: JustifyMethod = "right" if title in right else "left"
        table.add_column(title, header_style="dim", justify=justify, overflow="fold" if fold else "ellipsis")
    return table


def led(lead: str, words: RenderableType) -> Table:
    """A line of an answer: its lead, and words that wrap beside it."""
    table = Table.grid(padding=(0, 1, 0, 0))
    table.add_column(width=8, no_wrap=True)
    table.add_column(overflow="fold")
    table.add_row(lead, words)
    return table


def plain(value: float) -> str:
    """A stated number, as it was stated."""
    return f"{value:.6g}".replace("inf", "∞").replace("-", "−")
