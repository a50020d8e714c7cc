"""Writing files so that nothing already on disk is lost.

Files are written under temporary names, which contain the machine and the process that made them. If that process no
longer exists, its temporary files are removed the next time something is written to the same folder.
"""

from __future__ import annotations

import errno
import os
import re
import shutil
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from contextvars import ContextVar
from functools import lru_cache
from pathlib import Path

from .errors import BadInput, nearest
from .guard import option_of, permit, protect

PREFIX = ".greybox-"
NAME = re.compile(r"\.greybox-(?P<machine>[0-9a-f]{8})-(?P<process>\d+)-(?P<started>\d+)-[0-9a-f]{12}(\..*)?")
SET_ASIDE = "old"
"""In a temporary folder, the folder that keeps the old target, to be moved back if the new one is not put in place."""

_swept: set[tuple[int, Path]] = set()
"""(process, folder) pairs already searched for leftover files."""


def scratch_name(folder: Path, suffix: str = "") -> Path:
    """A temporary name in a folder, after removing the temporary files of dead processes there.

    Parameters
    ----------
    folder : must exist.
    suffix : of the name; libraries choose the file format by it.
    """
    sweep(folder)
    process = os.getpid()
    return folder / f"{PREFIX}{_machine()}-{process}-{_started(process)}-{os.urandom(6).hex()}{suffix}"


@contextmanager
def scratch_folder(folder: Path) -> Iterator[Path]:
    """A temporary folder within another one, removed at the end."""
    made = scratch_name(folder)
    made.mkdir(mode=0o700)
    try:
        yield made
    finally:
        shutil.rmtree(made, ignore_errors=True)


def sweep(folder: Path) -> None:
    """Remove temporary files of dead processes in a folder, once per process and folder; errors are ignored."""
    key = os.getpid(), folder.absolute()
    if key in _swept:
        return
    _swept.add(key)
    with suppress(OSError):
        for entry in list(os.scandir(folder)):
            named = NAME.fullmatch(entry.name)
            if named and named["machine"] == _machine() and _dead(int(named["process"]), named["started"]):
                _remove(Path(entry.path))


def _remove(left: Path) -> None:
    with suppress(OSError):
        if left.is_symlink() or not left.is_dir():
            left.unlink()
            return
        aside = left / SET_ASIDE
        for path in list(aside.iterdir()) if aside.is_dir() else ():
            if not (left.parent / path.name).exists():
                path.rename(left.parent / path.name)
        shutil.rmtree(left, ignore_errors=True)


def _dead(process: int, started: str) -> bool:
    if sys.platform == "win32":  # os.kill with signal 0 would not merely check the process
        return False
    try:
        os.kill(process, 0)
    except ProcessLookupError:
        return True
    except OSError:
        return False
    return _started(process) != started


@lru_cache
def _machine() -> str:
    """Hash of the host name and the namespace of process numbers: each container numbers its processes from 1."""
    import hashlib
    import socket

    try:
        numbering = os.readlink("/proc/self/ns/pid")
    except OSError:
        numbering = ""
    return hashlib.sha256(f"{socket.gethostname()} {numbering}".encode()).hexdigest()[:8]


def _started(process: int) -> str:
    """Start of a process in clock ticks since boot; "0" on systems without /proc."""
    try:
        stat = Path(f"/proc/{process}/stat").read_text("utf-8", "replace")
    except OSError:
        return "0"
    return stat.rpartition(")")[2].split()[19]


AT_CWD, EXCHANGE = -100, 2
"""AT_FDCWD, and RENAME_EXCHANGE of Linux, which macOS calls RENAME_SWAP."""
LOCK = ".lock"
"""File that a process locks to have a folder for itself."""
SMALL = 1 << 20
"""Largest parameter or tyre file, in bytes: usual ones have a few kilobytes."""
_batch: ContextVar[list[tuple[Path, Path]] | None] = ContextVar("batch", default=None)


def cache_folder() -> Path:
    """$GREYBOX_CACHE, else the folder greybox-id of $XDG_CACHE_HOME or ~/.cache; it need not exist.

    Raises `RuntimeError` if there is no home folder.
    """
    named = os.environ.get("GREYBOX_CACHE")
    return Path(named) if named else Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache", "greybox-id")


def write_atomically(path: Path, text: str, *, continued: bool = False) -> Path:
    """Write a text to a temporary file, then replace the target, as `replacing` does. Raises `BadInput` if refused."""
    with replacing(path, continued=continued) as beside:
        beside.write_text(text, encoding="utf-8", newline="\n")
    return path


def near_file(path: Path) -> str:
    """The question " Did you mean ...?" with the most similar file of the same folder; empty if none is similar.

    If the folder does not exist, a sentence that says so.
    """
    try:
        if path.exists():
            return ""
        if not path.parent.is_dir():
            return f" There is no folder {path.parent}."
        beside = {path.stem: path.name for path in path.parent.iterdir()}  # suffixes would make all names similar
        result = beside.get(nearest(path.stem, beside) or "")
    except (OSError, ValueError):  # ValueError: a null byte in the path
        return ""
    return f" Did you mean {path.parent / result}?" if result is not None else ""


def small_file(path: str | Path, what: str) -> bytes:
    """The bytes of a file that a command reads, at most 1 MB.

    Raises
    ------
    BadInput : the file cannot be read, or is larger.
    """
    protect(path)
    file = Path(path)
    try:
        with file.open("rb") as opened:
            held = opened.read(SMALL + 1)
    except (OSError, ValueError) as error:
        reason = error.strerror if isinstance(error, OSError) and error.strerror else "no valid path"
        raise BadInput(f"{path}: the {what} cannot be read ({reason}).{near_file(file)} Check the path.") from error
    if len(held) > SMALL:
        raise BadInput(f"{path}: larger than {SMALL >> 20} MB; that is no {what}.")
    return held


def ensure_writable(folder: Path, make: bool = True) -> None:
    """Raise `BadInput` if a folder cannot be written to; called before long work.

    Parameters
    ----------
    folder : the folder, made if it does not exist.
    make : whether a folder made for this check is kept.
    """
    new = [] if make else [place for place in (folder, *folder.parents) if not place.exists()]
    with writable(folder):
        folder.mkdir(parents=True, exist_ok=True)
        beside = scratch_name(folder)
        beside.touch()
        beside.unlink()
        for place in new:
            place.rmdir()


@contextmanager
def held(folder: Path) -> Iterator[None]:
    """Lock a folder for this process; the system releases the lock however the process ends.

    Raises
    ------
    BadInput : another process holds the lock, or the folder cannot be locked.
    """
    if sys.platform == "win32":
        yield
        return
    import fcntl

    with writable(folder):
        lock = (folder / LOCK).open("a")
    with lock:
        try:
            fcntl.flock(lock.fileno(), fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError as error:
            raise BadInput(f"Another run writes to {folder}; wait until it ends, or name another folder.") from error
        except OSError as error:
            if error.errno is None:
                raise
            raise BadInput(
                f"{folder} cannot be locked: {os.strerror(error.errno)}. Name a folder on another disk."
            ) from error
        yield


@contextmanager
def replacing(path: Path, *, continued: bool = False) -> Iterator[Path]:
    """A temporary file to write to; it replaces the target on success and is removed otherwise.

    Within `at_once` it replaces the target when all files are written.

    Parameters
    ----------
    path : the target.
    continued : whether the writer read the existing target to continue it; otherwise the guard must permit it.

    Raises
    ------
    BadInput : the file cannot be written, or the guard forbids it.
    """
    with writable(path):
        path.parent.mkdir(parents=True, exist_ok=True)
        beside = scratch_name(path.parent, path.suffix)
        beside.touch(0o600)
        waits = False
        try:
            yield beside
            if not continued:
                permit(beside, path)
            beside.chmod(0o644)
            _onto_disk(beside)
            batch = _batch.get()
            if batch is None:
                beside.replace(path)
                _onto_disk(path.parent)
            else:
                batch.append((beside, path))
                waits = True
        finally:
            if not waits:
                beside.unlink(missing_ok=True)


@contextmanager
def at_once() -> Iterator[None]:
    """Files written within the context replace their targets together at its end.

    A folder that would hold no other files is replaced as a whole, in one step. Elsewhere files are replaced one after
    the other, within microseconds; the file written first, which describes the others, is replaced last.
    """
    batch: list[tuple[Path, Path]] = []
    token = _batch.set(batch)
    try:
        yield
        for folder in dict.fromkeys(target.parent for _, target in reversed(batch)):
            files = [(beside, target) for beside, target in reversed(batch) if target.parent == folder]
            with writable(folder):
                if not _swapped(folder, files):
                    for beside, target in files:
                        beside.replace(target)
                _onto_disk(folder)
    finally:
        _batch.reset(token)
        for beside, _ in batch:
            beside.unlink(missing_ok=True)


@contextmanager
def new_folder(folder: Path) -> Iterator[Path]:
    """A temporary folder to write to; it replaces the target in one step on success.

    Raises
    ------
    BadInput : the folder cannot be written.
    """
    with writable(folder):
        folder.parent.mkdir(parents=True, exist_ok=True)
        beside = scratch_name(folder.parent)
        made = beside / "new"
        made.mkdir(parents=True)
        try:
            yield made
            for file in made.rglob("*"):
                _onto_disk(file)
            _take_place(made, folder, beside / SET_ASIDE)
            _onto_disk(folder.parent)
        finally:
            shutil.rmtree(beside, ignore_errors=True)


@contextmanager
def writable(path: Path) -> Iterator[None]:
    """Convert an `OSError` of writing into a `BadInput` that names the option to change."""
    try:
        yield
    except OSError as error:
        in_the_way = isinstance(error, FileExistsError | NotADirectoryError)
        why = "a file stands where a folder is needed" if in_the_way else error.strerror or error
        raise BadInput(f"{path} cannot be written: {why}. Name another place with {option_of(path)}.") from error


def _swapped(folder: Path, files: Sequence[tuple[Path, Path]]) -> bool:
    """Replace a folder that holds only the files' targets in one step; False if it holds more or that is impossible."""
    targets = {target.name for _, target in files}
    scratch = {beside.name for beside, _ in files}
    held = {item.name for item in os.scandir(folder)}
    if not held - scratch or held - targets - scratch or folder.is_symlink() or folder.absolute() == Path.cwd():
        return False
    beside = scratch_name(folder.parent)
    made = beside / "new"
    made.mkdir(parents=True)
    try:
        shutil.copystat(folder, made)
        for item, target in files:
            os.link(item, made / target.name)
        _onto_disk(made)
        return _exchanged(made, folder)
    except OSError:  # a file system without hard links, or no permission to write to the parent folder
        return False
    finally:
        shutil.rmtree(beside, ignore_errors=True)


def _take_place(made: Path, folder: Path, aside: Path) -> None:
    """Move a new folder to its target; an existing folder is exchanged, or set aside meanwhile."""
    if not folder.exists():
        made.rename(folder)
    elif not _exchanged(made, folder):
        aside.mkdir()
        folder.rename(aside / folder.name)
        try:
            made.rename(folder)
        except OSError:
            (aside / folder.name).rename(folder)
            raise


def _exchanged(one: Path, other: Path) -> bool:
    """Exchange two folders in one step; False if the system or the file system cannot."""
    import ctypes

    with suppress(AttributeError, OSError):
        system = ctypes.CDLL(None, use_errno=True)
        if sys.platform.startswith("linux"):
            return int(system.renameat2(AT_CWD, bytes(one), AT_CWD, bytes(other), EXCHANGE)) == 0
        if sys.platform == "darwin":
            return int(system.renamex_np(bytes(one), bytes(other), EXCHANGE)) == 0
    return False


def _onto_disk(path: Path) -> None:
    """Flush a file's content, or a folder's entries, to disk, so that they survive a power failure."""
    if sys.platform == "win32":
        return
    handle = os.open(path, os.O_RDONLY)
    try:
        os.fsync(handle)
    except OSError as error:
        if error.errno not in (errno.EINVAL, errno.ENOTSUP):  # raised by file systems without fsync
            raise
    finally:
        os.close(handle)
