"""C compiled with what compiler there is, each source once: shared libraries kept by content.

The compiler is $CC, else cc, gcc or clang. Libraries lie in $GREYBOX_CACHE, else in the folder greybox-id of
$XDG_CACHE_HOME or ~/.cache, else, where none can be written to, in a folder that goes with the process.
"""

from __future__ import annotations

import ctypes
import hashlib
import os
import shlex
import shutil
import subprocess
import tempfile
from collections.abc import Callable, Sequence
from functools import lru_cache
from pathlib import Path

from ..errors import GreyboxError
from ..files import cache_folder

FLAGS = ("-O1", "-ftree-vectorize", "-ffp-contract=off", "-w", "-fPIC", "-fno-math-errno", "-fno-trapping-math")
"""-O2 takes half as long again and gives nothing: the code is vectors already. No contraction of a b + c, which can
make x x - y y negative where x = y. The last two flags leave infinities and NaN as they are."""

MACHINES = (("-march=native", "-mprefer-vector-width=512"), ("-march=native",), ("-mcpu=native",), ())
"""Ways to ask for this machine's instructions; the first that a compiler understands is taken."""

PROBE = "#include <math.h>\n"


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
                found = subprocess.run(probe, input=PROBE, capture_output=True, text=True, check=False)
            except OSError as error:
                raise CannotCompile(str(error)) from error
            if found.returncode == 0:
                self.identity = found.stdout
                return
        raise CannotCompile(f"The C compiler {command[0]} does not work: {found.stderr.strip()}")

    def key(self, known_by: str) -> str:
        """What a library is called: the same for the same source, compiler, flags and machine."""
        return hashlib.sha256("\0".join([known_by, *self.command, self.identity]).encode()).hexdigest()[:32]

    def compile(self, sources: Sequence[str], target: Path) -> None:
        """Make a library of some files, beside its place first: another process may be making the same one."""
        with tempfile.TemporaryDirectory(dir=target.parent, prefix=".kernel-") as folder:
            library = Path(folder, "kernel.so")
            texts = [Path(folder, f"kernel{k}.c") for k in range(len(sources))]
            for text, source in zip(texts, sources, strict=True):
                text.write_text(source, encoding="utf-8")
            command = [*self.command, "-shared", *map(str, texts), "-o", str(library), "-lm"]
            try:
                made = subprocess.run(command, capture_output=True, text=True, check=False)
            except OSError as error:
                raise CannotCompile(str(error)) from error
            if made.returncode != 0:
                raise CannotCompile(f"The C compiler {command[0]} failed: {made.stderr.strip()}")
            library.replace(target)


def compiler() -> Compiler:
    """The compiler of this machine. Raises `CannotCompile`."""
    named = os.environ.get("CC")
    candidates = [tuple(shlex.split(named))] if named else [("cc",), ("gcc",), ("clang",)]
    for command in candidates:
        path = shutil.which(command[0])
        if path is not None:
            return _compiler((path, *command[1:]))
    raise CannotCompile(f"There is no C compiler: looked for {', '.join(command[0] for command in candidates)}.")


def library(sources: Callable[[], Sequence[str]], known_by: str, *, compile_it: bool) -> ctypes.CDLL | None:
    """The compiled sources; None if that is not there yet and not to be made.

    Parameters
    ----------
    sources : writes the files it is made of; not asked for where the library is in the cache, as writing takes a second
        for large models.
    known_by : what they follow from.
    compile_it : whether a library that is missing is made.

    Raises
    ------
    CannotCompile : there is no compiler, or it failed.
    """
    chosen = compiler()
    path = _folder() / f"kernel-{chosen.key(known_by)}.so"
    if not path.exists():
        if not compile_it:
            return None
        chosen.compile(sources(), path)
    try:
        return ctypes.CDLL(str(path))
    except OSError as error:  # a truncated file, or a folder from which nothing may be executed
        raise CannotCompile(str(error)) from error


@lru_cache
def _compiler(command: tuple[str, ...]) -> Compiler:
    return Compiler(command)


def _folder() -> Path:
    try:
        folder = cache_folder()
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder):
            return folder
    except (OSError, RuntimeError):  # not writable, or nobody's home
        return Path(_own_folder().name)


@lru_cache
def _own_folder() -> tempfile.TemporaryDirectory[str]:
    return tempfile.TemporaryDirectory(prefix="greybox-id-")
