"""How the simulator is compiled, and where what was compiled is kept."""

from __future__ import annotations

from collections.abc import Callable
from hashlib import sha256
from pathlib import Path
from typing import Any, TypeAlias, TypeVar, cast

from numba import njit
from numpy import dtype, float64, ndarray

AnyFunction = TypeVar("AnyFunction", bound=Callable[..., Any])

Row = ndarray[tuple[int], dtype[float64]]
"""(n,) numbers."""
Grid = ndarray[tuple[int, int], dtype[float64]]
"""(n, k) numbers."""

Car: TypeAlias = Any
"""A numpy record with the fields of `record.FIELDS`, which compiled code reads by name."""


def compiled(function: AnyFunction) -> AnyFunction:
    """The function in machine code, made when it is first called; division by zero is infinite, as in numpy."""
    return cast(AnyFunction, njit(error_model="numpy")(function))


def kept(function: AnyFunction) -> AnyFunction:
    """The same, and kept on disk: beside this file or, where nothing can be written, in the user's cache.

    Everything the function calls is kept with it, so only the outermost one need be. It must be made inside another
    function that takes `source()`, and mention that: what is enclosed is part of the key under which numba keeps
    machine code, and the file's own time, which numba looks at, says nothing of the files it calls.
    """
    try:
        return cast(AnyFunction, njit(error_model="numpy", cache=True)(function))
    except RuntimeError:  # no folder to keep it in
        return compiled(function)


def source() -> str:
    """What all files of the simulator are at this moment, as a hash."""
    files = sorted(Path(__file__).parent.glob("*.py"))
    return sha256(b"\0".join(file.read_bytes() for file in files)).hexdigest()
