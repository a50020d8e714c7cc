"""What is in a file: groups of columns, each on a clock of its own."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from importlib import import_module
from typing import Any

from ...errors import BadInput, GreyboxError
from ..table import RawTable

TIME = "time"
"""What a column map calls the clock of a group that has its own, whatever the file calls it."""
LARGEST = 1_000_000_000
"""Bytes that the text of a file, or the columns that are read of it, may take: five hours at 100 Hz of 69 numbers."""
MOST_COLUMNS = 20_000
"""Columns that a file may have; one with a million of them takes minutes to tell apart."""


@dataclass(frozen=True)
class Group:
    """Columns that share their rows: a whole CSV file, a ROS topic, a channel group.

    Attributes
    ----------
    name : what sentences call it; empty where a file is one group.
    names : full names of its columns.
    load : reads the named columns; a file's other columns are not touched.
    prefix : what a full name has before the column's own; it may be omitted where a file has one group.
    clock : full name of the column with its time; empty where the column map has to name one.
    clock_unit : unit of that column; empty where the column map says it.
    units : units of columns, by full name, as far as the file states them.
    """

    name: str
    names: tuple[str, ...]
    load: Callable[[Sequence[str]], RawTable]
    prefix: str = ""
    clock: str = ""
    clock_unit: str = ""
    units: Mapping[str, str] = field(default_factory=dict)

    def full(self, name: str, alone: bool = False) -> str | None:
        """The full name of a column of this group; `alone`: the prefix may be omitted."""
        if name in self.names:
            return name
        if alone and self.prefix + name in self.names:
            return self.prefix + name
        if self.clock and name in ((TIME, self.prefix + TIME) if alone else (self.prefix + TIME,)):
            return self.clock
        return None


@dataclass(frozen=True)
class Contents:
    """The groups of a file.

    Attributes
    ----------
    where : the file as the user named it.
    groups : what is in it.
    kind : what kind of file it is, for sentences.
    notes : what a person should know of how it was read.
    """

    where: str
    groups: tuple[Group, ...]
    kind: str
    notes: tuple[str, ...] = ()

    @property
    def names(self) -> tuple[str, ...]:
        """Full names of all columns."""
        return tuple(name for group in self.groups for name in group.names)

    def find(self, name: str) -> tuple[Group, str] | None:
        """The group and the full name of a column; None if there is none of that name."""
        alone = len(self.groups) == 1
        for group in self.groups:
            full = group.full(name, alone)
            if full is not None:
                return group, full
        return None


def bounded(size: float, where: str) -> None:
    """Raise `BadInput` for more than is read at once, before it is laid out."""
    if size > LARGEST:
        raise BadInput(
            f"{where} holds {size / 1e9:.3g} GB once it is laid out, and {LARGEST / 1e9:g} GB are read at most. Cut it "
            "into parts, or leave columns out."
        )


def few_enough(columns: int, where: str) -> None:
    """Raise `BadInput` for a file with more columns than are told apart."""
    if columns > MOST_COLUMNS:
        raise BadInput(
            f"{where} has {columns} columns, and {MOST_COLUMNS} are read at most. Leave out those that hold no signals."
        )


def whole(table: RawTable, kind: str) -> Contents:
    """A file that is one table and has been read."""
    return Contents(table.where, (Group("", table.names, lambda _: table, units=table.units),), kind)


def needed(module: str, extra: str, where: str, kind: str) -> Any:
    """A module that comes with an extra.

    Raises
    ------
    BadInput
        It is not installed: the sentence names the extra.
    """
    try:
        return import_module(module)
    except ImportError as error:
        raise missing(module, extra, where, kind) from error


def missing(module: str, extra: str, where: str, kind: str) -> BadInput:
    """The sentence on a module that is not installed."""
    return BadInput(
        f"{where}: reading and writing {kind} needs {module.partition('.')[0]}, which is not installed; "
        f"pip install 'greybox-id[{extra}]'."
    )


@contextmanager
def sound(where: str, kind: str) -> Iterator[None]:
    """Turns whatever a reader of foreign files raises over a damaged one into a sentence."""
    try:
        yield
    except GreyboxError:
        raise
    except Exception as error:  # readers of binary files fail over damage in ways nobody has listed
        raise unsound(where, kind, next(iter(str(error).splitlines()), "") or type(error).__name__) from error


def unsound(where: str, kind: str, reason: str) -> BadInput:
    """The sentence on a damaged file, with what its reader said."""
    return BadInput(f"{where} is not a sound {kind} file ({reason:.120}). Write or fetch it again.")
