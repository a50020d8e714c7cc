"""Compiling what is exported, with the flags a careful user has."""

import ctypes
import shutil
import subprocess

import numpy as np
import pytest

from greybox_id.engine import compiler
from greybox_id.engine.compiler import CannotCompile

STRICT = ("-std=c99", "-O2", "-Wall", "-Wextra", "-Wpedantic", "-Werror")
COMPILERS = ("gcc", "clang")


def there_is_a_compiler():
    try:
        compiler.compiler()
    except CannotCompile:
        return False
    return True


needs_compiler = pytest.mark.skipif(not there_is_a_compiler(), reason="there is no C compiler here")


def needed(program):
    """Skip, saying so, where a program is missing."""
    if shutil.which(program) is None:
        pytest.skip(f"{program} is not installed")
    return program


def run(*command, cwd=None):
    """A program's output; fails with what it said."""
    done = subprocess.run([str(word) for word in command], capture_output=True, text=True, cwd=cwd, check=False)
    assert done.returncode == 0, (done.stdout + done.stderr)[:4000]
    return done.stdout


def compiled(sources, target, *flags, compiler="gcc"):
    """A program of C sources."""
    run(needed(compiler), *STRICT, *flags, *sources, "-lm", "-o", target)
    return target


class Library:
    """An export as a shared library, its functions called row by row."""

    def __init__(self, folder, name="car"):
        target = folder / f"lib{name}.so"
        compiled([folder / f"{name}.c"], target, "-shared", "-fPIC")
        self.library = ctypes.CDLL(str(target))
        self.name = name

    def __call__(self, function, arguments, sizes):
        """Rows of results of the given sizes; arguments are (rows, entries), or (rows,) for numbers."""
        called = getattr(self.library, f"{self.name}_{function}")
        found = [np.full((len(arguments[0]), size), np.nan) for size in sizes]
        given = [*(np.ascontiguousarray(own, dtype=float) for own in arguments), *found]
        called.restype = None
        called.argtypes = [ctypes.c_double if own.ndim == 1 else ctypes.c_void_p for own in given]
        for row in zip(*map(_words, given), strict=True):
            called(*row)
        return found


def _words(array):
    """What C is given for each row: a number, or the row's address."""
    if array.ndim == 1:
        return array.tolist()
    first, length = array.ctypes.data, array.nbytes // max(len(array), 1)
    return [first + k * length for k in range(len(array))]
