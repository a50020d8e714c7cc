"""C compiled with what compiler there is, each source once: shared libraries kept by content.

The compiler is $CC, else cc, gcc or clang. Libraries lie in the folder kernels of $GREYBOX_CACHE, else of the folder
greybox-id in $XDG_CACHE_HOME or ~/.cache. That folder is of this user alone: what lies there is executed. Where it
belongs to another one, or others can write to it, or it cannot be written to, a folder that goes with the process
takes its place. A library's name ends in the checksum of its content; one that is not what its name says is made again.
"""

from __future__ import annotations

import ctypes
import hashlib
import logging
import os
import shlex
import shutil
import stat
import subprocess
import tempfile
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from functools import lru_cache
from pathlib import Path

from ..base.errors import GreyboxError
from ..base.files import cache_folder, scratch_folder
from ..base.processes import elsewhere

FLAGS = ("-O1", "-ftree-vectorize", "-ffp-contract=off", "-w", "-fPIC", "-fno-math-errno", "-fno-trapping-math")
"""-O2 takes half as long again and gives nothing: the code is vectors already. No contraction of a b + c, which can
make x x - y y negative where x = y. The last two flags leave infinities and NaN as they are."""

MACHINES = (("-march=native", "-mprefer-vector-width=512"), ("-march=native",), ("-mcpu=native",), ())
"""Ways to ask for this machine's instructions; the first that a compiler understands is taken."""

PROBE = "#include <math.h>\n"

NOTICED = 1.0
"""Seconds after which somebody who waits wonders what for (Nielsen, Usability Engineering, 1993, Sec. 5.5)."""


class CannotCompile(GreyboxError):
    """There is no compiler, or it failed, or something there is no C for was asked of it."""


class Compiler:
    """A C compiler and the flags it understands.

    Attributes
    ----------
    command : how it is called.
    identity : all macros it defines: its version, the machine's instructions and the C library's version.
    """

    def __init__(self, command: tuple[str, ...]) -> None:
        for machine in MACHINES:
            self.command = (*command, *FLAGS, *machine)
            probe = [*self.command, "-dM", "-E", "-x", "c", "-"]
            try:
                result = subprocess.run(probe, input=PROBE, capture_output=True, text=True, check=False)
            except OSError as error:
                raise CannotCompile(str(error)) from error
            if result.returncode == 0:
                self.identity = result.stdout
                return
        raise CannotCompile(f"The C compiler {command[0]} does not work: {result.stderr.strip()}")

    def key(self, known_by: str) -> str:
        """What a library is called: the same for the same source, compiler, flags and machine."""
        return hashlib.sha256("\0".join([known_by, *self.command, self.identity]).encode()).hexdigest()[:32]

    def compile(self, sources: Sequence[str], folder: Path, name: str) -> Path:
        """Make a library of some files, beside its place first: another process may be making the same one.

        Parameters
        ----------
        sources : texts of the files.
        folder : where to.
        name : how the library's name begins; the checksum of its content follows.

        Raises
        ------
        CannotCompile : the compiler failed, or nothing can be written there.
        """
        try:
            with scratch_folder(folder) as place:
                made = place / "kernel.so"
                texts = [place / f"kernel{k}.c" for k in range(len(sources))]
                for text, source in zip(texts, sources, strict=True):
                    text.write_text(source, encoding="utf-8")
                command = [*self.command, "-shared", *map(str, texts), "-o", str(made), "-lm"]
                value = {**os.environ, "TMPDIR": str(place)}  # an interrupted compiler leaves its files where it works
                failed, complaint = _run(command, value)
                if failed:
                    raise CannotCompile(f"The C compiler {command[0]} failed: {complaint.strip()}")
                made.chmod(0o600)
                target = folder / f"{name}-{_checksum(made)}.so"
                made.replace(target)
                return target
        except OSError as error:
            raise CannotCompile(f"Nothing can be compiled in {folder}: {error.strerror or error}.") from error


def _run(command: Sequence[str], environment: Mapping[str, str]) -> tuple[int, str]:
    """How a command ended and what it complained about; a wait that is noticed is explained, once for each process."""
    with subprocess.Popen(
        command, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True, env=environment
    ) as working:
        try:
            try:
                _, complaint = working.communicate(timeout=NOTICED)
            except subprocess.TimeoutExpired:
                _told_once("Waiting for the C compiler; the compiled code is kept for the next time.", logging.INFO)
                _, complaint = working.communicate()
        except BaseException:
            working.kill()
            raise
    return working.returncode, complaint


def compiler() -> Compiler:
    """The compiler of this machine. Raises `CannotCompile`."""
    return _compiler(compiler_command())


def compiler_command() -> tuple[str, ...]:
    """How the C compiler of this machine is called. Raises `CannotCompile`."""
    named = os.environ.get("CC")
    try:
        candidates = [tuple(shlex.split(named))] if named and named.strip() else [("cc",), ("gcc",), ("clang",)]
    except ValueError as error:
        raise CannotCompile(f"CC is {named!r}, which is no command: {error}.") from error
    for command in candidates:
        path = shutil.which(command[0])
        if path is not None:
            return (path, *command[1:])
    raise CannotCompile(f"There is no C compiler: looked for {', '.join(command[0] for command in candidates)}.")


def library(sources: Callable[[], Sequence[str]], known_by: str) -> ctypes.CDLL:
    """The compiled sources, from the cache or made now.

    Parameters
    ----------
    sources : writes the files it is made of; not asked for where the library is in the cache, as writing takes a second
        for large models.
    known_by : what they follow from.

    Raises
    ------
    CannotCompile : there is no compiler, or it failed, or what it made cannot be loaded.
    """
    chosen = compiler()
    name = f"kernel-{chosen.key(known_by)}"
    folder = _kernels()
    if folder is not None:
        with suppress(CannotCompile, OSError):  # a full disk, or a folder from which nothing may be executed
            return ctypes.CDLL(str(_found(folder, name) or chosen.compile(elsewhere(sources), folder, name)))
    value = Path(_own_folder().name)
    path = _found(value, name) or chosen.compile(elsewhere(sources), value, name)
    try:
        return ctypes.CDLL(str(path))
    except OSError as error:
        raise CannotCompile(f"What the C compiler made cannot be loaded: {error}.") from error


def tell_slow(what: str, times: str, error: CannotCompile) -> None:
    """Say once for each process and reason that something runs without compiled code, and why."""
    _told_once(
        f"{what} runs without compiled code, about {times} times slower. {error} Install a C compiler, or name it in "
        "CC. With GREYBOX_COMPILE=0 nothing is compiled, and this message is not printed."
    )


@lru_cache
def _told_once(sentence: str, level: int = logging.WARNING) -> None:
    logging.getLogger("greybox_id").log(level, sentence)


@lru_cache
def _compiler(command: tuple[str, ...]) -> Compiler:
    return Compiler(command)


def _found(folder: Path, name: str) -> Path | None:
    """A library of this user whose content is what its name says; damaged ones are removed."""
    for path in folder.glob(f"{name}-*.so"):
        with suppress(OSError):
            if not (stat.S_ISREG(path.lstat().st_mode) and _ours(path.lstat())):
                continue
            if path.stem.removeprefix(f"{name}-") == _checksum(path):
                return path
            path.unlink()
    return None


def _checksum(path: Path) -> str:
    with path.open("rb") as opened:
        return hashlib.file_digest(opened, "sha256").hexdigest()[:32]


def _ours(known: os.stat_result) -> bool:
    """Whether nobody else can change a file or folder; a link is none."""
    if not hasattr(os, "geteuid"):
        return True
    alone = not known.st_mode & (stat.S_IWGRP | stat.S_IWOTH)
    return alone and known.st_uid == os.geteuid() and not stat.S_ISLNK(known.st_mode)


def _stays(about: os.stat_result) -> bool:
    """Whether nobody else can put another folder in the place of one that is in this one."""
    if not hasattr(os, "geteuid"):
        return True
    alone = bool(about.st_mode & stat.S_ISVTX) or not about.st_mode & (stat.S_IWGRP | stat.S_IWOTH)
    return alone and about.st_uid in (0, os.geteuid())


def _kernels() -> Path | None:
    """The folder of libraries, which is made; None where it may not be used, which is said, or cannot be."""
    try:
        folder = cache_folder() / "kernels"
        folder.parent.mkdir(parents=True, exist_ok=True)
        with suppress(FileExistsError):
            folder.mkdir(mode=0o700)
        if not (_ours(folder.lstat()) and _stays(folder.parent.stat())):
            _told_once(
                f"{folder} is not used: it belongs to another user, or others can write to it or to the folder above "
                "it, and its files would be executed. Remove it, or name another cache in GREYBOX_CACHE."
            )
            return None
        with tempfile.TemporaryFile(dir=folder):
            return folder
    except (OSError, RuntimeError):  # not writable, or nobody's home
        return None


@lru_cache
def _own_folder() -> tempfile.TemporaryDirectory[str]:
    return tempfile.TemporaryDirectory(prefix="greybox-id-")
