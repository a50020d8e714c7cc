"""Formats of recordings: `contents` reads files of every kind, `write` writes them.

A file's content determines its kind; its name decides if the content does not. Each kind has a module with
`contents(file, mapping)` and `write(columns, path)`, which is all that a new kind needs.
"""

from __future__ import annotations

import hashlib
import json
from collections import Counter
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from ...base.errors import BadInput, GreyboxError
from ...base.files import near_file, replacing
from ...base.guard import protect
from ...base.memory import give_back
from ...base.shorthands import Array
from ..column_map import ColumnMap
from ..raw_table import RawTable
from ..recording import Recording

__all__ = ["SUFFIXES", "WRITTEN", "Contents", "Group", "bare_name", "contents", "hash_of", "write"]

Load = Callable[[Sequence[str]], RawTable]


def loader(where: str, names: Collection[str], column: Callable[[str], Any], first_row: int = 1) -> Load:
    """A function that loads the requested ones of these columns by name."""

    def load(target: Sequence[str]) -> RawTable:
        chosen = tuple(name for name in names if name in target)
        return RawTable(where, chosen, tuple(pd.Series(column(name)) for name in chosen), first_row)

    return load


def unique_names(names: tuple[str, ...], where: str) -> None:
    """Raise `BadInput` if two columns have the same name."""
    twice = [name for name, count in Counter(names).items() if count > 1]
    if twice:
        raise BadInput(
            f'{where}: column name "{twice[0]}" stands there {names.count(twice[0])} times. Rename all but one.'
        )


def one_column(names: tuple[str, ...]) -> str:
    """A hint for a header line that was not split; empty if it was."""
    result = max(";\t|", key=names[0].count) if len(names) == 1 else ""
    if not result or result not in names[0]:
        return ""
    return (
        f"The whole header line was read as one column, {names[0]!r:.80}; set separator = {json.dumps(result)} in the "
        "column map."
    )


TIME = "time"
"""Name in column maps for the clock of a group, whatever its name in the file."""
LARGEST = 1_000_000_000
"""Largest size in bytes of a file's text, or of the columns read from it: five hours at 100 Hz of 69 numbers."""
MOST_COLUMNS = 20_000
"""Largest number of columns of a file; names of a million columns take minutes to process."""


@dataclass(frozen=True)
class Group:
    """Columns that share their rows: a whole CSV file, a ROS topic, a channel group.

    Attributes
    ----------
    name : in sentences; empty if the file is one group.
    names : full names of its columns.
    load : reads the named columns; the file's other columns are not read.
    prefix : of full names, before the column's own name; may be omitted if the file has one group.
    clock : full name of the time column; empty if the column map must name one.
    clock_unit : unit of that column; empty if the column map states it.
    units : full name -> unit, for columns whose unit the file states.
    """

    name: str
    names: tuple[str, ...]
    load: Load
    prefix: str = ""
    clock: str = ""
    clock_unit: str = ""
    units: Mapping[str, str] = field(default_factory=dict)

    def full(self, name: str, alone: bool = False) -> str | None:
        """The full name of a column of this group; `alone` : whether the prefix may be omitted."""
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
    groups : groups of columns.
    kind : kind of file, for sentences.
    notes : how the file was read, as sentences for users.
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
        """The group and the full name of a column; None if there is no such column."""
        alone = len(self.groups) == 1
        for group in self.groups:
            full = group.full(name, alone)
            if full is not None:
                return group, full
        return None


def bounded(size: float, where: str) -> None:
    """Raise `BadInput`, before allocating memory, for more bytes than are read at once."""
    if size > LARGEST:
        raise BadInput(
            f"{where} holds {size / 1e9:.3g} GB of numbers, and {LARGEST / 1e9:g} GB are read at most. Cut it "
            "into parts, or leave columns out."
        )


def few_enough(columns: int, where: str) -> None:
    """Raise `BadInput` for a file with too many columns."""
    if columns > MOST_COLUMNS:
        raise BadInput(
            f"{where} has {columns} columns, and {MOST_COLUMNS} are read at most. Leave out those that hold no signals."
        )


def whole(table: RawTable, kind: str, notes: tuple[str, ...] = ()) -> Contents:
    """Contents of a file that is a single table, already read."""
    return Contents(table.where, (Group("", table.names, lambda _: table, units=table.units),), kind, notes)


def needed(module: str, extra: str, where: str, kind: str) -> Any:
    """Import a module that an optional extra installs.

    Raises
    ------
    BadInput
        The module is not installed: the error names the extra.
    """
    try:
        return import_module(module)
    except ImportError as error:
        raise missing(module, extra, where, kind) from error


def missing(module: str, extra: str, where: str, kind: str) -> BadInput:
    """The error about a module that is not installed."""
    return BadInput(
        f"{where}: reading and writing {kind} needs {module.partition('.')[0]}, which is not installed; "
        f"pip install 'greybox-id[{extra}]'."
    )


@contextmanager
def sound(where: str, kind: str) -> Iterator[None]:
    """Convert any exception that a reader raises for a damaged file into a `BadInput`."""
    try:
        yield
    except GreyboxError:
        raise
    except Exception as error:  # damaged binary files make readers raise exceptions of any type
        raise unsound(where, kind, next(iter(str(error).splitlines()), "") or type(error).__name__) from error


def unsound(where: str, kind: str, reason: str) -> BadInput:
    """The error about a damaged file, with the reader's message."""
    return BadInput(f"{where} is not a sound {kind} file ({reason:.120}). Write or fetch it again.")


BETWEEN_RUNS = 1.0
"""Seconds between runs on a clock that must not step back."""


@dataclass(frozen=True)
class Columns:
    """Columns of a file to be written.

    Attributes
    ----------
    values : name -> (n,): time in s, run counted from 1, and the signals in SI units.
    units : name -> unit.
    steady : (n,) s from 0, with the same steps as time within runs; it continues where time restarts.
    """

    values: Mapping[str, NDArray[Any]]
    units: Mapping[str, str]
    steady: Array


def columns_of(recording: Recording) -> Columns:
    """A recording as columns to be written."""
    runs = np.zeros(len(recording), dtype=np.int64)
    for number, (start, stop) in enumerate(recording.runs, 1):
        runs[start:stop] = number
    values = {"time": recording.time, "run": runs, **recording.signals}
    units = {"time": "s", **{name: recording.unit(name) for name in recording.signals}}
    return Columns(values, units, _steady(recording))


def _steady(recording: Recording) -> Array:
    steady, end = np.zeros(len(recording)), -BETWEEN_RUNS
    for start, stop in recording.runs:
        steady[start:stop] = recording.time[start:stop] - recording.time[start] + end + BETWEEN_RUNS
        end = steady[stop - 1]
    return steady


SUFFIXES = {
    ".csv": "text", ".csv.gz": "text", ".txt": "text", ".tsv": "text", ".dat": "text", ".log": "text",
    ".jsonl": "json_lines", ".json": "json_lines", ".ndjson": "json_lines", ".json.gz": "json_lines",
    ".vbo": "racelogic", ".xrk": "aim", ".xrz": "aim", ".erg": "carmaker", ".parquet": "parquet",
    ".mat": "matlab", ".h5": "hdf5", ".hdf5": "hdf5",
    ".mf4": "mdf", ".mdf": "mdf", ".mcap": "ros", ".db3": "ros", ".bag": "ros",
}  # fmt: skip
"""Suffix of a file's name -> the module that reads it."""
WRITTEN = (".csv", ".parquet", ".mat", ".h5", ".mf4", ".mcap")
"""Suffixes that can be written."""
MAGIC = (
    (b"PAR1", "parquet"), (b"\x89HDF\r\n\x1a\n", "hdf5"), (b"MATLAB ", "matlab"), (b"MDF ", "mdf"),
    (b"UnFinMF ", "mdf"), (b"CM-ERG", "carmaker"), (b"\x89MCAP0\r\n", "ros"), (b"SQLite format 3\0", "ros"),
    (b"#ROSBAG V", "ros"),
)  # fmt: skip
"""First bytes of a file -> the module that reads it."""
BAG = (".mcap", ".db3", ".mcap.zstd", ".db3.zstd")
"""Suffixes of files in the folder of a ROS 2 bag."""


LONG = 32 * 1024 * 1024
"""File size in bytes from which freed memory is returned: some hours at 100 Hz. With short files it would make a gap
diagnosis take a tenth longer."""


def contents(file: Path, mapping: ColumnMap) -> Contents:
    """Contents of a file, or of a folder with a ROS 2 bag.

    Raises
    ------
    BadInput
        The file cannot be read, is damaged or of no known kind, or an extra is missing: the error says which.
    """
    head = _head(file)
    protect(file)
    if file.is_dir() or _is_long(file):
        give_back()
    suffix = _suffix(file)
    module = next((kind for magic, kind in MAGIC if head.startswith(magic)), None)
    module = "ros" if file.is_dir() else module or (SUFFIXES[suffix] if suffix else None)
    if module is None:
        raise BadInput(f"{file}: cannot tell the kind of file from its name; {', '.join(SUFFIXES)} can be read.")
    result: Contents | None = None
    if module == "text" and _is_long(file):
        result = import_module(".blocks", __name__).contents(file, mapping)
    if result is None:
        result = import_module(f".{module}", __name__).contents(file, mapping)
    few_enough(len(result.names), str(file))
    return result


def _is_long(file: Path) -> bool:
    """Whether a file holds hours; zipped text is about a quarter as large."""
    return file.stat().st_size > (LONG / 4 if file.name.lower().endswith(".gz") else LONG)


def write(recording: Recording, path: Path) -> None:
    """Write a recording with the standard signal names, in SI units, in the format of the suffix.

    Raises
    ------
    BadInput
        The format cannot be written, the path is not writable, or an extra is missing.
    """
    suffix = _suffix(path)
    if suffix not in WRITTEN:
        raise BadInput(f"{path}: recordings are written as {', '.join(WRITTEN)}; name such a file with ‹out›.")
    with replacing(path) as beside:
        import_module(f".{SUFFIXES[suffix]}", __name__).write(columns_of(recording), beside)


def bare_name(file: Path) -> str:
    """The file's name without the suffix of its kind."""
    suffix = "" if file.is_dir() else _suffix(file) or ""
    return file.name[: len(file.name) - len(suffix)] or file.name


def hash_of(file: Path) -> str:
    """SHA-256 of a file's bytes; of a folder, of the names and hashes of its files."""
    if file.is_dir():
        inside = sorted(file for file in file.rglob("*") if file.is_file())
        lines = [f"{item.relative_to(file).as_posix()} {hash_of(item)}\n" for item in inside]
        return hashlib.sha256("".join(lines).encode()).hexdigest()
    with file.open("rb") as opened:
        return hashlib.file_digest(opened, "sha256").hexdigest()


def _suffix(file: Path) -> str | None:
    fitting = [suffix for suffix in SUFFIXES if file.name.lower().endswith(suffix)]
    return max(fitting, key=len) if fitting else None


def _head(file: Path) -> bytes:
    """The first bytes of the file. Raises `BadInput` if it cannot be read."""
    try:
        if file.is_dir():
            if not any(path.name.endswith(BAG) for path in file.iterdir()):
                raise BadInput(f"{file} is a folder; name a file in it, or the folder of a ROS 2 bag.")
            return b""
        with file.open("rb") as opened:
            head = opened.read(16)
    except FileNotFoundError as error:
        raise BadInput(f"{file}: there is no such file.{near_file(file)} Check the path.") from error
    except PermissionError as error:
        raise BadInput(f"{file} may not be read: permission denied. Change its permissions.") from error
    except (OSError, ValueError) as error:  # ValueError: a null byte in the path
        reason = error.strerror if isinstance(error, OSError) and error.strerror else "no valid path"
        raise BadInput(f"{file} cannot be read ({reason}). Check the path.") from error
    if not head:
        raise BadInput(f"{file} is empty (0 bytes). Name a file with a recording in it.")
    return head
