"""Lines and tables for a terminal or as plain text, without control characters from names of files or columns."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator
from io import StringIO

from rich.console import Console, ConsoleOptions, JustifyMethod, RenderableType
from rich.segment import Segment
from rich.table import Table

from ..words import clean

WIDTH = 160
"""Width in columns of tables that are written to a file or pipe."""


class Screen(Console):
    """Output for people, without markup, since names and sentences may contain brackets."""

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
        """Segments without control characters other than those of rich."""
        for item in super().render(renderable, options):
            yield item if item.control else Segment(clean(item.text), item.style)


def as_text(parts: Iterable[RenderableType], width: int = WIDTH) -> str:
    """The text on a screen of this width in columns, without trailing blanks."""
    screen = Screen(file=StringIO(), width=width)
    for part in parts:
        screen.print(part)
    assert isinstance(screen.file, StringIO)
    return "\n".join(line.rstrip() for line in screen.file.getvalue().rstrip().splitlines())


def plain_table(*titles: str, right: Collection[str] = (), fold: bool = False) -> Table:
    """A table without lines; columns in `right` are right-aligned, long words are cut or folded."""
    table = Table(box=None, padding=(0, 2, 0, 0), pad_edge=False)
    for title in titles:
        justify: JustifyMethod = "right" if title in right else "left"
        table.add_column(title, header_style="dim", justify=justify, overflow="fold" if fold else "ellipsis")
    return table


def led(lead: str, words: RenderableType) -> Table:
    """A line of a result: its lead, and words that wrap to its right."""
    table = Table.grid(padding=(0, 1, 0, 0))
    table.add_column(width=8, no_wrap=True)
    table.add_column(overflow="fold")
    table.add_row(lead, words)
    return table


def plain(value: float) -> str:
    """A stated number with all its digits."""
    return f"{value:.6g}".replace("inf", "∞").replace("-", "−")
