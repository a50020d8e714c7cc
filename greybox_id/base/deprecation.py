"""Public functions that are going to be removed still work, and warn."""

from __future__ import annotations

import functools
import warnings
from collections.abc import Callable
from typing import ParamSpec, TypeVar

P = ParamSpec("P")
R = TypeVar("R")


def deprecated(*, since: str, remove: str, use: str = "") -> Callable[[Callable[P, R]], Callable[P, R]]:
    """Mark a public function as one that a later version removes.

    Parameters
    ----------
    since, remove : versions: the first that warns, and the first without the function.
    use : what to call instead, such as "gb.fit"; "" where nothing replaces it.

    Returns
    -------
    A decorator: the function works as before, warns with `DeprecationWarning`, and its docstring says it.

    Examples
    --------
    >>> @deprecated(since="1.1", remove="2.0", use="gb.fit")
    ... def estimate(): ...
    """

    def marked(function: Callable[P, R]) -> Callable[P, R]:
        instead = f"; use {use}" if use else ""
        sentence = f"{function.__name__} is deprecated since {since} and goes with {remove}{instead}."

        @functools.wraps(function)
        def warning(*args: P.args, **kwargs: P.kwargs) -> R:
            warnings.warn(sentence, DeprecationWarning, stacklevel=2)
            return function(*args, **kwargs)

        first, _, rest = (function.__doc__ or "").partition("\n")
        warning.__doc__ = f"{first}\n\n.. deprecated:: {since}\n   {sentence}\n{rest}"
        return warning

    return marked
