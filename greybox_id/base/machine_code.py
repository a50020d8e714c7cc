"""Functions in machine code, made by Numba when they are first called and kept on disk."""

from __future__ import annotations

import threading
from collections.abc import Callable
from functools import wraps
from pathlib import Path
from typing import Any, TypeVar, cast

from .processes import elsewhere

AnyFunction = TypeVar("AnyFunction", bound=Callable[..., Any])


def compiled(function: AnyFunction) -> AnyFunction:
    """The function in machine code, for others that are; division by zero is infinite, as in numpy."""
    from numba import njit

    return cast(AnyFunction, njit(error_model="numpy")(function))


def kept(function: AnyFunction) -> AnyFunction:
    """The same, kept on disk: beside its file or, where nothing can be written, in the user's cache.

    Everything the function calls is kept with it, so only the outermost one need be. Numba looks at the time of its
    file alone: where it calls functions of other files, it must be made inside another function that takes a hash of
    them, and mention that, for what is enclosed is part of the key.
    """
    from numba import njit

    try:
        return cast(AnyFunction, njit(error_model="numpy", cache=True)(function))
    except RuntimeError:  # no folder to keep it in
        return compiled(function)


def begun(function: Callable[..., Any]) -> Any:
    """A kept function that Python calls, and no machine code: Ctrl-C ends it also while it is first compiled.

    That takes ten seconds in a large function, and an interrupt meanwhile is late or lost; another process compiles it.
    """
    inner: Any = None  # Numba takes as long to load as a small fit, and most who import this never call it

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
    """Whether it can be kept on disk and is not yet, in its file's present state."""
    folder, code = function.stats.cache_path, function.py_func.__code__
    if folder is None:
        return False
    name = f"*{function.py_func.__qualname__.replace('<locals>', 'locals')}-{code.co_firstlineno}.*.nbi"
    written = [index.stat().st_mtime for index in Path(folder).glob(name)]
    return max(written, default=0.0) <= Path(code.co_filename).stat().st_mtime
