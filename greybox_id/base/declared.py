"""Checks of values against declared types: of data from files, which may have been edited by hand, and of arguments."""

from __future__ import annotations

import types
from collections.abc import Callable, Iterable, Mapping
from contextlib import suppress
from dataclasses import fields, is_dataclass
from functools import wraps
from inspect import signature
from numbers import Integral, Real
from pathlib import Path
from typing import Any, Literal, ParamSpec, TypeVar, Union, get_args, get_origin, get_type_hints

import numpy as np

from .errors import BadInput, GreyboxError

P = ParamSpec("P")
Returned = TypeVar("Returned")
WORDS: Mapping[Any, str] = {
    float: "a number", int: "a whole number", str: "a text", bool: "True or False", Path: "a path",
    type(None): "None", Mapping: "a mapping of names to values", Callable: "a function",
}  # fmt: skip
"""Names of types in errors."""


def understood(function: Callable[P, Returned]) -> Callable[P, Returned]:
    """Decorate a function: if it fails and an argument is not of its declared type, the error names that argument.

    Types are checked only after a failure, so that no call that works is refused.
    """

    @wraps(function)
    def told(*args: P.args, **kwargs: P.kwargs) -> Returned:
        try:
            return function(*args, **kwargs)
        except GreyboxError:
            raise
        except (AttributeError, TypeError, ValueError) as error:
            text = _mistaken(function, args, kwargs)
            if not text:
                raise
            raise BadInput(text) from error

    return told


def _mistaken(function: Callable[..., Any], args: Any, kwargs: Any) -> str:
    """Sentence about the first argument that is not of its declared type; empty if all are."""
    try:
        given = signature(function).bind(*args, **kwargs).arguments
    except TypeError:  # the call does not match the signature
        return ""
    for name, value in given.items():
        stated = types.SimpleNamespace(__annotations__={name: function.__annotations__.get(name, Any)})
        with suppress(NameError):  # types of modules that only type checkers import
            kind = get_type_hints(stated, function.__globals__)[name]
            if not _suits(value, kind):
                return f"‹{name}›: {' or '.join(_words(kind))} is needed, not {value!r:.40}."
    return ""


def _suits(value: Any, kind: Any) -> bool:
    origin = get_origin(kind)
    if origin in (Union, types.UnionType):
        return any(_suits(value, get_arg) for get_arg in get_args(kind))
    if origin is Literal:
        return value in get_args(kind)
    bare = origin or kind
    if isinstance(value, Mapping) and bare is Mapping and get_args(kind):
        names, values = get_args(kind)
        return all(_suits(name, names) and _suits(item, values) for name, item in value.items())
    if bare in (float, int):
        return isinstance(value, Real if bare is float else Integral) and not isinstance(value, bool)
    return bare is Any or not isinstance(bare, type) or isinstance(value, bare)


def _words(kind: Any) -> list[str]:
    origin = get_origin(kind)
    if origin in (Union, types.UnionType):
        return list(dict.fromkeys(words for get_arg in get_args(kind) for words in _words(get_arg)))
    if origin is Literal:
        return [repr(get_arg) for get_arg in get_args(kind)]
    bare = origin or kind
    several = isinstance(bare, type) and issubclass(bare, Iterable) and bare not in WORDS and origin is not None
    return [WORDS.get(bare) or ("a list" if several else f"a {getattr(bare, '__name__', bare)}")]


def of_plain(kind: Any, value: Any, name: str, *, null: float | None = None) -> Any:
    """Plain data of a file converted to a declared type: lists become tuples or arrays, tables become dataclasses.

    Parameters
    ----------
    kind : annotated type: plain types, literals, unions, tuples, mappings, arrays of numbers, dataclasses. Values of
        other types are returned unchecked.
    value : plain data; keys of a table that are no fields of the dataclass are ignored.
    name : the value's name in errors.
    null : number that replaces null where a number is declared; None raises `TypeError` for null.

    Raises
    ------
    TypeError : the value, or a part of it, is not of the declared type.
    ValueError : a dataclass rejects its values, or an array holds something other than numbers.
    """
    origin, inside = get_origin(kind), get_args(kind)

    def of(kind: Any, value: Any, name: str) -> Any:
        return of_plain(kind, value, name, null=null)

    if origin in (Union, types.UnionType):
        return _first(of, inside, value, name)
    if origin is Literal:
        _hold(value in inside, name, " or ".join(map(str, inside)))
    elif kind is float:
        value = null if value is None else value
        _hold(isinstance(value, (int, float)) and not isinstance(value, bool), name, "a number")
        return float(value)
    elif kind is int:
        _hold(isinstance(value, int) and not isinstance(value, bool), name, "a whole number")
    elif kind in (str, bool, type(None)):
        _hold(isinstance(value, kind), name, {str: "text", bool: "true or false"}.get(kind, "nothing"))
    elif origin is np.ndarray:
        return np.array(value, dtype=float)
    elif origin is tuple:
        _hold(isinstance(value, (list, tuple)), name, "a list")
        kinds = (inside[0],) * len(value) if inside[1:] == (Ellipsis,) else inside
        _hold(len(value) == len(kinds), name, f"a list of {len(kinds)}")
        return tuple(of(kind, item, f"{name}[{k}]") for k, (kind, item) in enumerate(zip(kinds, value, strict=True)))
    elif isinstance(origin, type) and issubclass(origin, Mapping):
        _hold(isinstance(value, Mapping), name, "a table")
        return {
            of(inside[0], key, f"a key of {name}"): of(inside[1], item, f"{name}.{key}") for key, item in value.items()
        }
    elif isinstance(kind, type) and is_dataclass(kind):
        _hold(isinstance(value, Mapping), name, kind.__name__)
        hints = get_type_hints(kind)
        held = {item.name: of(hints[item.name], value[item.name], f"{name}.{item.name}")
                for item in fields(kind) if item.name in value}  # fmt: skip
        return kind(**held)
    return value


def _first(of: Callable[[Any, Any, str], Any], kinds: tuple[Any, ...], value: Any, name: str) -> Any:
    """The value converted to the first type of a union that accepts it."""
    refused: TypeError | None = None
    for kind in sorted(kinds, key=lambda kind: kind is not type(None)):
        try:
            return of(kind, value, name)
        except TypeError as error:
            refused = error
    assert refused is not None
    raise refused


def _hold(condition: bool, name: str, words: str) -> None:
    if not condition:
        raise TypeError(f"its {name} is not {words}")
