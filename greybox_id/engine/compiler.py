"""C compiled with the machine's compiler, each source once: shared libraries cached by content.

The compiler is $CC, else cc, gcc or clang. Libraries are in the folder kernels of $GREYBOX_CACHE, else of the folder
greybox-id in $XDG_CACHE_HOME or ~/.cache. The folder must belong to this user alone, since its files are executed. If
it belongs to another user, or others can write to it, or it is not writable, a temporary folder of the process replaces
it. A library's name ends in the checksum of its content; a file that does not match its name is compiled again.
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

FLAGS = (
    *("-O1", "-fno-dse", "-fno-tree-dse", "-ftree-vectorize", "-ffp-contract=off", "-w", "-fPIC"),
    *("-fno-math-errno", "-fno-trapping-math"),
)
"""-O2 takes half as long again and gains nothing: the code is already vectorised. Stores that are never read are not
looked for: that took a fifth of the time, and straight-line code has none. No contraction of a b + c, which can make
x x - y y negative where x = y. The last two flags preserve infinities and NaN."""

MACHINES = (("-march=native", "-mprefer-vector-width=512"), ("-march=native",), ("-mcpu=native",), ())
"""Flags for this machine's instructions; the first that the compiler accepts is used."""

PROBE = "#include <math.h>\n"

NOTICED = 1.0
"""Seconds after which a waiting user needs an explanation (Nielsen, Usability Engineering, 1993, Sec. 5.5)."""


class CannotCompile(GreyboxError):
    """No compiler, or it failed, or the model uses an operation without an equivalent in C."""


class Compiler:
    """A C compiler and the flags it understands.

    Attributes
    ----------
    command : command line with flags.
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
        """Name of a library: the same for the same source, compiler, flags and machine."""
        return hashlib.sha256("\0".join([known_by, *self.command, self.identity]).encode()).hexdigest()[:32]

    def compile(self, sources: Sequence[str], folder: Path, name: str) -> Path:
        """Compile a library in a scratch folder, then move it to its place: another process may be compiling it too.

        Parameters
        ----------
        sources : texts of the C files.
        folder : folder of the library.
        name : beginning of the library's name; the checksum of its content follows.

        Raises
        ------
        CannotCompile : the compiler failed, or the folder is not writable.
        """
        try:
            with scratch_folder(folder) as place:
                built = place / "kernel.so"
                texts = [place / f"kernel{k}.c" for k in range(len(sources))]
                for text, source in zip(texts, sources, strict=True):
                    text.write_text(source, encoding="utf-8")
                command = [*self.command, "-shared", *map(str, texts), "-o", str(built), "-lm"]
                environment = {
                    **os.environ,
                    "TMPDIR": str(place),
                }  # files of an interrupted compiler vanish with the folder
                failed, complaint = _run(command, environment)
                if failed:
                    raise CannotCompile(f"The C compiler {command[0]} failed: {complaint.strip()}")
                built.chmod(0o600)
                target = folder / f"{name}-{_checksum(built)}.so"
                built.replace(target)
                return target
        except OSError as error:
            raise CannotCompile(f"Nothing can be compiled in {folder}: {error.strerror or error}.") from error


def _run(command: Sequence[str], environment: Mapping[str, str]) -> tuple[int, str]:
    """Exit code and error output of a command; a noticeable wait is explained, once per process."""
    with subprocess.Popen(
        command, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True, env=environment
    ) as working:
        try:
            try:
                _, complaint = working.communicate(timeout=NOTICED)
            except subprocess.TimeoutExpired:
                _log_once("Waiting for the C compiler; the compiled code is kept for the next time.", logging.INFO)
                _, complaint = working.communicate()
        except BaseException:
            working.kill()
            raise
    return working.returncode, complaint


def compiler() -> Compiler:
    """The compiler of this machine. Raises `CannotCompile`."""
    return _compiler(compiler_command())


def compiler_command() -> tuple[str, ...]:
    """Command of this machine's C compiler. Raises `CannotCompile`."""
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
    """The library of the compiled sources, from the cache or compiled now.

    Parameters
    ----------
    sources : writes the C files; called only if the library is not cached, since writing takes a second for large
        models.
    known_by : text that determines the sources, for the cache key.

    Raises
    ------
    CannotCompile : there is no compiler, or it failed, or the library cannot be loaded.
    """
    c_compiler = compiler()
    name = f"kernel-{c_compiler.key(known_by)}"
    folder = _kernels()
    if folder is not None:
        with suppress(CannotCompile, OSError):  # a full disk, or a folder from which nothing may be executed
            return ctypes.CDLL(str(_cached(folder, name) or c_compiler.compile(elsewhere(sources), folder, name)))
    own_folder = Path(_own_folder().name)
    path = _cached(own_folder, name) or c_compiler.compile(elsewhere(sources), own_folder, name)
    try:
        return ctypes.CDLL(str(path))
    except OSError as error:
        raise CannotCompile(f"What the C compiler made cannot be loaded: {error}.") from error


def warn_slow(what: str, times: str, error: CannotCompile) -> None:
    """Warn once per process and reason that something runs without compiled code, and why."""
    _log_once(
        f"{what} runs without compiled code, about {times} times slower. {error} Install a C compiler, or name it in "
        "CC. With GREYBOX_COMPILE=0 nothing is compiled, and this message is not printed."
    )


@lru_cache
def _log_once(sentence: str, level: int = logging.WARNING) -> None:
    logging.getLogger("greybox_id").log(level, sentence)


@lru_cache
def _compiler(command: tuple[str, ...]) -> Compiler:
    return Compiler(command)


def _cached(folder: Path, name: str) -> Path | None:
    """A library of this user whose content matches its name; damaged ones are removed."""
    for path in folder.glob(f"{name}-*.so"):
        with suppress(OSError):
            if not (stat.S_ISREG(path.lstat().st_mode) and _only_ours(path.lstat())):
                continue
            if path.stem.removeprefix(f"{name}-") == _checksum(path):
                return path
            path.unlink()
    return None


def _checksum(path: Path) -> str:
    with path.open("rb") as opened:
        return hashlib.file_digest(opened, "sha256").hexdigest()[:32]


def _only_ours(status: os.stat_result) -> bool:
    """Whether nobody else can change this file or folder; a symbolic link does not count."""
    if not hasattr(os, "geteuid"):
        return True
    alone = not status.st_mode & (stat.S_IWGRP | stat.S_IWOTH)
    return alone and status.st_uid == os.geteuid() and not stat.S_ISLNK(status.st_mode)


def _irreplaceable(status: os.stat_result) -> bool:
    """Whether nobody else can replace a folder inside this one."""
    if not hasattr(os, "geteuid"):
        return True
    alone = bool(status.st_mode & stat.S_ISVTX) or not status.st_mode & (stat.S_IWGRP | stat.S_IWOTH)
    return alone and status.st_uid in (0, os.geteuid())


def _kernels() -> Path | None:
    """The folder of libraries, created if missing; None if it cannot be used (a warning says why) or created."""
    try:
        folder = cache_folder() / "kernels"
        folder.parent.mkdir(parents=True, exist_ok=True)
        with suppress(FileExistsError):
            folder.mkdir(mode=0o700)
        if not (_only_ours(folder.lstat()) and _irreplaceable(folder.parent.stat())):
            _log_once(
                f"{folder} is not used: it belongs to another user, or others can write to it or to the folder above "
                "it, and its files would be executed. Remove it, or name another cache in GREYBOX_CACHE."
            )
            return None
        with tempfile.TemporaryFile(dir=folder):
            return folder
    except (OSError, RuntimeError):  # not writable, or no home folder
        return None


@lru_cache
def _own_folder() -> tempfile.TemporaryDirectory[str]:
    return tempfile.TemporaryDirectory(prefix="greybox-id-")
