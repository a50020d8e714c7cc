"""Whether values have the types that are declared: files may be forged or mended by hand, arguments may be mistaken."""

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

from .errors import BadInput, GreyboxError

P = ParamSpec("P")
Returned = TypeVar("Returned")
WORDS: Mapping[Any, str] = {
    float: "a number", int: "a whole number", str: "a text", bool: "True or False", Path: "a path",
    type(None): "None", Mapping: "a mapping of names to values", Callable: "a function",
}  # fmt: skip
"""What types are called."""


def understood(function: Callable[P, Returned]) -> Callable[P, Returned]:
    """A function that names the argument where it fails because that is of another type than declared.

    What works is not refused: types are only looked at when something went wrong.
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
    """What is wrong with the first argument of another type than declared; empty where none is."""
    try:
        given = signature(function).bind(*args, **kwargs).arguments
    except TypeError:  # it is not called so at all
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


def must_be(value: Any, kind: Any, name: str) -> None:
    """Raise `TypeError` where a value, or anything in it, is not of the type that is declared.

    Parameters
    ----------
    value : the value; of a dataclass, each field is looked at.
    kind : a type as annotations state it: plain types, unions, tuples, mappings, dataclasses. Other types are not
        looked at.
    name : what the value is called in the sentence.
    """
    origin = get_origin(kind)
    if origin in (Union, types.UnionType):
        _any_of(value, kind, name)
    elif kind is float:
        _hold(isinstance(value, (int, float)) and not isinstance(value, bool), name, "a number")
    elif kind is int:
        _hold(isinstance(value, int) and not isinstance(value, bool), name, "a whole number")
    elif kind in (str, bool, type(None)):
        _hold(isinstance(value, kind), name, {str: "text", bool: "true or false"}.get(kind, "nothing"))
    elif origin is tuple:
        _tuple(value, get_args(kind), name)
    elif isinstance(origin, type) and issubclass(origin, Mapping):
        _hold(isinstance(value, Mapping), name, "a table")
        for key, field in value.items():
            must_be(key, get_args(kind)[0], f"a key of {name}")
            must_be(field, get_args(kind)[1], f"{name}.{key}")
    elif isinstance(kind, type) and is_dataclass(kind):
        _hold(isinstance(value, kind), name, kind.__name__)
        hints = get_type_hints(kind)
        for field in fields(kind):
            must_be(getattr(value, field.name), hints[field.name], f"{name}.{field.name}")


def _any_of(value: Any, kind: Any, name: str) -> None:
    refused: TypeError | None = None
    for get_arg in get_args(kind):
        try:
            must_be(value, get_arg, name)
        except TypeError as error:
            refused = refused if get_arg is type(None) and refused else error
        else:
            return
    assert refused is not None
    raise refused


def _tuple(value: Any, kinds: tuple[Any, ...], name: str) -> None:
    _hold(isinstance(value, tuple), name, "a list")
    if len(kinds) == 2 and kinds[1] is Ellipsis:
        kinds = (kinds[0],) * len(value)
    _hold(len(value) == len(kinds), name, f"a list of {len(kinds)}")
    for k, (item, kind) in enumerate(zip(value, kinds, strict=True)):
        must_be(item, kind, f"{name}[{k}]")


def _hold(condition: bool, name: str, words: str) -> None:
    if not condition:
        raise TypeError(f"its {name} is not {words}")
