"""Functions in machine code, compiled by Numba on their first call and cached on disk."""

from __future__ import annotations

import threading
from collections.abc import Callable
from functools import wraps
from pathlib import Path
from typing import Any, TypeVar, cast

from .processes import elsewhere

AnyFunction = TypeVar("AnyFunction", bound=Callable[..., Any])


def compiled(function: AnyFunction) -> AnyFunction:
    """The function compiled, to be called by other compiled functions; division by zero is infinite, as in numpy."""
    from numba import njit

    return cast(AnyFunction, njit(error_model="numpy")(function))


def kept(function: AnyFunction) -> AnyFunction:
    """The function compiled and cached on disk: next to its file or, if that is read-only, in the user's cache.

    The functions it calls are cached with it, so only the outermost one needs this. Numba compares the time stamp of
    the function's file only. A function that calls functions of other files must therefore be defined in a function
    that takes a hash of those files, and use that hash: enclosed variables are part of the cache's key.
    """
    from numba import njit

    try:
        return cast(AnyFunction, njit(error_model="numpy", cache=True)(function))
    except RuntimeError:  # no writable folder for the cache
        return compiled(function)


def begun(function: Callable[..., Any]) -> Any:
    """A cached function to be called from Python, not from compiled code: Ctrl-C ends it also while it is compiled.

    Compiling a large function takes ten seconds, in which an interrupt is late or lost: another process compiles it.
    """
    inner: Any = None  # compiled on the first call: loading Numba takes as long as a small fit, and is often not needed

    @wraps(function)
    def call(*arguments: Any) -> Any:
        nonlocal inner
        if inner is None:
            machine: Any = kept(function)
            if threading.current_thread() is threading.main_thread() and _is_to_be_kept(machine):
                elsewhere(lambda: _compile(machine, arguments))
            inner = machine
        return inner(*arguments)

    return call


def _compile(function: Any, arguments: tuple[Any, ...]) -> None:
    from numba import typeof

    function.compile(tuple(map(typeof, arguments)))


def _is_to_be_kept(function: Any) -> bool:
    """Whether the function can be cached on disk and has not been since its file last changed."""
    folder, code = function.stats.cache_path, function.py_func.__code__
    if folder is None:
        return False
    name = f"*{function.py_func.__qualname__.replace('<locals>', 'locals')}-{code.co_firstlineno}.*.nbi"
    written = [index.stat().st_mtime for index in Path(folder).glob(name)]
    return max(written, default=0.0) <= Path(code.co_filename).stat().st_mtime
