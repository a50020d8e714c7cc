"""Files and folders under way: named so that whoever comes next can tell what a killed process left behind.

A name says on which machine and by which process it was made. Where that process is no more, what it left is removed
the next time something is written to the same folder.
"""

from __future__ import annotations

import os
import re
import shutil
import sys
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from functools import lru_cache
from pathlib import Path

PREFIX = ".greybox-"
NAME = re.compile(r"\.greybox-(?P<machine>[0-9a-f]{8})-(?P<process>\d+)-(?P<started>\d+)-[0-9a-f]{12}(\..*)?")
SET_ASIDE = "old"
"""In a folder under way, the folder with what has to come back if nothing takes its place."""

_swept: set[tuple[int, Path]] = set()
"""Process and folder in which leftovers were looked for already."""


def scratch_name(folder: Path, suffix: str = "") -> Path:
    """A name for something under way in a folder, after what dead processes left there has been removed.

    Parameters
    ----------
    folder : must be there.
    suffix : of the name; libraries go by it.
    """
    sweep(folder)
    process = os.getpid()
    return folder / f"{PREFIX}{_machine()}-{process}-{_started(process)}-{os.urandom(6).hex()}{suffix}"


@contextmanager
def scratch_folder(folder: Path) -> Iterator[Path]:
    """A folder under way in another one, gone at the end."""
    made = scratch_name(folder)
    made.mkdir(mode=0o700)
    try:
        yield made
    finally:
        shutil.rmtree(made, ignore_errors=True)


def sweep(folder: Path) -> None:
    """Remove what dead processes left in a folder, once for each process and folder; nothing fails over it."""
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
    if sys.platform == "win32":  # where signal 0 is no question
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
    """This machine and its numbering of processes: containers number theirs from 1."""
    import hashlib
    import socket

    try:
        numbering = os.readlink("/proc/self/ns/pid")
    except OSError:
        numbering = ""
    return hashlib.sha256(f"{socket.gethostname()} {numbering}".encode()).hexdigest()[:8]


def _started(process: int) -> str:
    """When a process started, in ticks since the machine did; "0" where the system does not tell."""
    try:
        stat = Path(f"/proc/{process}/stat").read_text("utf-8", "replace")
    except OSError:
        return "0"
    return stat.rpartition(")")[2].split()[19]
