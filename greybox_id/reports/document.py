"""A report as a tree of parts: its content, not its appearance. HTML, PDF and text are made from the same tree."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from ..base.files import write_atomically
from .equations.expression import Equation

if TYPE_CHECKING:  # matplotlib is loaded where something is drawn
    from .figures.sheet import Sheet


@dataclass(frozen=True)
class Table:
    """A table of words.

    Attributes
    ----------
    head : titles of the columns.
    rows : one word per column each.
    columns : a letter per column: l or r for its alignment, a capital if the column takes the remaining width; all l
        by default.
    """

    head: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]
    columns: str = ""

    @property
    def dense(self) -> bool:
        """Whether the font is smaller, so that more than six columns fit on a page."""
        return len(self.head) > 6

    @property
    def letters(self) -> str:
        """A letter per column."""
        return self.columns or "l" * len(self.head)


@dataclass(frozen=True)
class Section:
    """A heading; `level` 2 for a subsection."""

    title: str
    level: int = 1


@dataclass(frozen=True)
class Text:
    """A paragraph, optionally with a bold lead; `small` for explanations."""

    words: str
    lead: str = ""
    small: bool = True


@dataclass(frozen=True)
class Points:
    """A list of sentences."""

    items: tuple[str, ...]


@dataclass(frozen=True)
class VerdictBox:
    """The result of a report: (lead, sentence) pairs."""

    pairs: tuple[tuple[str, str], ...]


@dataclass(frozen=True)
class Pairs:
    """(name, value) pairs; values of the names in `code` are commands or code."""

    pairs: tuple[tuple[str, str], ...]
    code: tuple[str, ...] = ("command",)


@dataclass(frozen=True)
class Formulas:
    """Typeset equations."""

    equations: tuple[Equation, ...]


@dataclass(frozen=True)
class Drawing:
    """A figure with its caption.

    Attributes
    ----------
    name : of its file, without suffix.
    figure : the figure; None if there is nothing to draw: then the part is omitted.
    caption : text below it.
    alt : alternative text that describes it.
    """

    name: str
    figure: Sheet | None
    caption: str
    alt: str

    @property
    def svg(self) -> str:
        """The figure as an SVG file in the light colours."""
        assert self.figure is not None
        return self.figure.svg(self.alt)


@dataclass(frozen=True)
class Together:
    """Parts that are kept on one page."""

    parts: tuple[Part, ...]


Part = Section | Text | Points | VerdictBox | Pairs | Table | Formulas | Drawing | Together


@dataclass(frozen=True)
class Document:
    """A report.

    Attributes
    ----------
    title, about : heading of the report.
    of : subject of the report, such as "a fit".
    written_by : software and version.
    parts : in order.
    endless : whether it is a single page of any length, as for an image.
    """

    title: str
    about: str
    of: str
    written_by: str
    parts: tuple[Part, ...]
    endless: bool = False

    @property
    def verdict(self) -> tuple[tuple[str, str], ...]:
        """The result: (lead, sentence) pairs."""
        return next((part.pairs for part in self.parts if isinstance(part, VerdictBox)), ())

    @property
    def drawings(self) -> tuple[Drawing, ...]:
        """All figures."""
        return tuple(part for part in self.flat if isinstance(part, Drawing))

    @property
    def flat(self) -> tuple[Part, ...]:
        """All parts, those that are kept together one by one."""
        return tuple(_flat(self.parts))


def _flat(parts: Sequence[Part]) -> Iterator[Part]:
    for part in parts:
        yield from _flat(part.parts) if isinstance(part, Together) else (part,)


def write_drawings(made: Sequence[Drawing], folder: str | Path) -> list[Path]:
    """Write figures as SVG files, each atomically.

    Raises
    ------
    BadInput : if the folder cannot be written.
    """
    return [write_atomically(Path(folder) / f"{one.name}.svg", one.svg) for one in made]


def titled(title: str, *parts: Part, level: int = 1) -> tuple[Part, ...]:
    """Parts below a heading, which is kept on one page with the first of them; empty if there are none."""
    kept = there(*parts)
    if not kept:
        return ()
    first, *rest = kept
    if isinstance(first, Drawing | Text | Pairs) or (isinstance(first, Table) and len(first.rows) <= SHORT):
        return (Together((Section(title, level), first)), *rest)
    return (Section(title, level), *kept)


def there(*parts: Part) -> tuple[Part, ...]:
    """The parts that are not empty."""
    return tuple(part for part in parts if not _empty(part))


SHORT = 14
"""Most rows of a table that is kept on one page."""


def _empty(part: Part) -> bool:
    match part:
        case Table():
            return not part.rows
        case Points():
            return not part.items
        case Text():
            return not (part.words or part.lead)
        case Pairs() | VerdictBox():
            return not part.pairs
        case Formulas():
            return not part.equations
        case Drawing():
            return part.figure is None
        case Together():
            return all(_empty(part) for part in part.parts)
    return False
