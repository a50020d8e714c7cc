"""Overwrite protection: outputs replace neither files that the same command reads nor results of another kind.

Within `guarding`, readers register files (`protect`), outputs are registered as soon as they are known (`claim`), and
`files.replacing` asks before it replaces a file (`permit`). Files are identified by device and inode, not by path:
links, hard links, other upper and lower case and folders that do not exist yet are recognised.
"""

from __future__ import annotations

import os
import re
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from contextvars import ContextVar
from dataclasses import dataclass, field
from pathlib import Path

from .errors import BadInput

HEAD = 1 << 16
"""Bytes at the beginning of a file by which its kind is recognised."""
MARK = "greybox-id"
"""Mark in every figure, report and vehicle file that greybox-id writes."""
VEHICLE_MARK = f"# Vehicle file written by {MARK}"
PAGE_MARK = f"<!-- Page written by {MARK} -->"
RECORDING = "data that may exist nowhere else"
_MODEL = re.compile(rb'"model":\s*\{\s*"name":\s*"([^"\\]*)"')
_HOLDS = re.compile(rb"greybox-id: (a table of [a-z]{1,20})")
_FORMAT = re.compile(rb'\A\s*\{\s*"format":\s*"greybox-(\w+)"')


@dataclass(frozen=True)
class FileContent:
    """Kind of a file's content.

    Attributes
    ----------
    words : as printed, such as "a fit of lateral".
    derived : whether a command made it from other files and can make it again.
    """

    words: str
    derived: bool = False


NOTHING = FileContent("nothing", derived=True)


@dataclass
class _Guard:
    overwrite: bool = False
    read: dict[tuple[int, int], Path] = field(default_factory=dict)
    folders: dict[Path, Path] = field(default_factory=dict)
    claimed: dict[Path, str] = field(default_factory=dict)
    written: set[Path] = field(default_factory=set)


_current: ContextVar[_Guard | None] = ContextVar("guard", default=None)


@contextmanager
def guarding() -> Iterator[None]:
    """Protect files within the context, which is one command."""
    token = _current.set(_Guard())
    try:
        yield
    finally:
        _current.reset(token)


def allow_overwriting() -> None:
    """Allow results of another kind to be replaced; files that the command reads remain protected."""
    guard = _current.get()
    if guard is not None:
        guard.overwrite = True


def protect(path: str | Path) -> None:
    """Register a file, or a folder with all its files, as read: it must not be overwritten.

    Raises
    ------
    BadInput : the file was claimed as an output.
    """
    guard = _current.get()
    if guard is None:
        return
    file = Path(path)
    for spelled in _spellings(file):
        with suppress(OSError, ValueError):
            about = spelled.stat()
            guard.read.setdefault((about.st_dev, about.st_ino), file)
            if spelled.is_dir():
                guard.folders.setdefault(spelled.resolve(), file)
    for output, option in guard.claimed.items():
        _refuse_read(guard, output, option)


def claim(path: str | Path, option: str = "‹out›", becomes: str = "") -> Path:
    """Register a file or folder as an output.

    Parameters
    ----------
    path : of the output.
    option : the argument that names the output, as printed in errors.
    becomes : `FileContent.words` of the output, if known: an existing file of another kind is then refused before
        long work, not after it.

    Raises
    ------
    BadInput : the file is also read, another output has the same path, or a file of another kind exists there.
    """
    target = Path(path)
    guard = _current.get()
    if guard is None:
        return target
    _refuse_read(guard, target, option)
    place = _place(target)
    if guard.claimed.setdefault(place, option) != option:
        raise BadInput(f"{path} is named by both {guard.claimed[place]} and {option}; name two different places.")
    if becomes and not guard.overwrite and target.is_file():
        there = content_of(target)
        if there not in (NOTHING, FileContent(becomes, derived=True)):
            raise _of_another_kind(target, there, option)
    return target


def permit(new: Path, target: Path) -> None:
    """Raise `BadInput` if the file `new` must not replace the file `target`."""
    guard = _current.get()
    if guard is None:
        return
    option = option_of(target)
    _refuse_read(guard, target, option)
    place = _place(target)
    if not guard.overwrite and place not in guard.written and target.is_file():
        there = content_of(target)
        same = there.derived and there in (NOTHING, content_of(new))
        from filecmp import cmp

        if not same and not cmp(new, target, shallow=False):
            raise _of_another_kind(target, there, option)
    guard.written.add(place)


def permit_folder(folder: Path, there: str = "", becomes: str = "") -> None:
    """Check whether a whole folder may be replaced.

    Parameters
    ----------
    folder : the folder.
    there, becomes : its present and its new content, in words.

    Raises
    ------
    BadInput : the command reads a file in it, or the two contents differ.
    """
    guard = _current.get()
    if guard is None:
        return
    option = option_of(folder)
    for file in folder.rglob("*") if folder.is_dir() else ():
        _refuse_read(guard, file, option)
    if there != becomes and not guard.overwrite:
        raise _of_another_kind(folder, FileContent(there), option)


def option_of(target: Path) -> str:
    """The option that named a file or a folder above it; "‹out›" if none was claimed."""
    guard = _current.get()
    if guard is None:
        return "‹out›"
    place = _place(target)
    return next((guard.claimed[parent] for parent in (place, *place.parents) if parent in guard.claimed), "‹out›")


def content_of(file: Path) -> FileContent:
    """Kind of a file, by its first bytes. A file that cannot be read must not be replaced."""
    try:
        with file.open("rb") as opened:
            head = opened.read(HEAD)
    except OSError:
        return FileContent("a file that cannot be read")
    if not head:
        return NOTHING
    if head.startswith(b"PAR1"):
        return _table(_parquet_names(file))
    if head.startswith((b"%PDF", b"<!DOCTYPE html", b"<svg", b"\x89PNG")):
        return _picture(file, head)
    if head.startswith((b"MDF ", b"\x89MCAP")):
        return _measurements(file, head)
    if head.startswith(VEHICLE_MARK.encode()):
        return FileContent("a vehicle file that greybox wrote", derived=True)
    if head.startswith(PAGE_MARK.encode()):
        return FileContent("a report", derived=True)
    saved = _FORMAT.match(head)
    if saved:
        kind = saved[1].decode()
        model = _MODEL.search(head) if kind == "fit" else None
        return FileContent(f"a {kind}{f' of {model[1].decode()}' if model else ''}", derived=True)
    line = head.split(b"\n", 1)[0].decode("utf-8", "replace").strip()
    return _table(tuple(line.split(",")))


def _picture(file: Path, head: bytes) -> FileContent:
    """A report or figure; derived if it contains `MARK`, in a PDF at its end."""
    with file.open("rb") as opened:
        opened.seek(-min(HEAD, file.stat().st_size), os.SEEK_END)
        tail = opened.read()
    words = "a figure" if head.startswith((b"<svg", b"\x89PNG")) else "a report"
    derived = MARK.encode() in head or (head.startswith(b"%PDF") and MARK.encode() in tail)
    return FileContent(words if derived else f"{words} that greybox did not write", derived)


def _measurements(file: Path, head: bytes) -> FileContent:
    """A file of measurements; derived if greybox-id noted the content at its beginning or end."""
    with file.open("rb") as opened:
        opened.seek(-min(HEAD, file.stat().st_size), os.SEEK_END)
        about = _HOLDS.search(head + opened.read())
    return FileContent(about[1].decode(), derived=True) if about else FileContent(RECORDING)


def _table(names: tuple[str, ...]) -> FileContent:
    """A table; derived if its columns are those of a table that a command writes."""
    if set(names) - {"allowed_noise_alone"} == {"parameter", "value", "rise", "allowed"}:
        return FileContent("a table of profiles", derived=True)
    if {"time", "phase", "steer", "v_x_low", "v_x_high", "yaw_rate_low"} <= set(names):
        return FileContent("a table of a manoeuvre", derived=True)
    if names[:3] == ("chain", "draw", "weight"):
        return FileContent("a posterior", derived=True)
    if {"parameters", "cv_error", "aic_effective"} <= set(names):
        return FileContent("a table of a grid", derived=True)
    if names[:2] == ("time", "run") and len(names) > 2:
        for end, words in (("_predicted", "predictions"), ("_simulated", "simulations")):
            if any(name.endswith(end) for name in names):
                return FileContent(f"a table of {words}", derived=True)
        values = [name for name in names[2:] if f"{name}_sd" in names]
        if 2 * len(values) == len(names) - 2:
            return FileContent("a table of estimates", derived=True)
    return FileContent(RECORDING)


def _parquet_names(file: Path) -> tuple[str, ...]:
    import pyarrow as pa
    import pyarrow.parquet as pq

    try:
        return tuple(pq.read_schema(file).names)
    except (pa.ArrowException, OSError, ValueError):
        return ()


def _refuse_read(guard: _Guard, target: Path, option: str) -> None:
    advice = f"is read by this command and would be overwritten; name another place with {option}."
    for spelled in _spellings(target):
        with suppress(OSError, ValueError):
            about = spelled.stat()
            if not spelled.is_dir() and (about.st_dev, about.st_ino) in guard.read:
                raise BadInput(f"{target} {advice}")
        for folder, named in guard.folders.items():
            if folder in spelled.resolve().parents:
                raise BadInput(f"{target} lies in {named}, which {advice}")


def _of_another_kind(target: Path, there: FileContent, option: str) -> BadInput:
    return BadInput(
        f"{target} already exists and holds {there.words}; name another place with {option}, or replace the file "
        "with ‹overwrite›."
    )


def _spellings(path: Path) -> tuple[Path, ...]:
    """A path as written, and normalised: missing/../file can only be looked up once the folder "missing" exists."""
    return tuple(dict.fromkeys((path, Path(os.path.normpath(path)))))


def _place(path: Path) -> Path:
    """Absolute path with links of folders resolved, but not a link in the last part: that is replaced, not followed."""
    whole = Path(os.path.abspath(path))
    return whole.parent.resolve() / whole.name
