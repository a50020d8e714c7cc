"""Whether what was read from a file has the types that a dataclass declares: files may be forged or mended by hand."""

from __future__ import annotations

import types
from collections.abc import Mapping
from dataclasses import fields, is_dataclass
from typing import Any, Union, get_args, get_origin, get_type_hints


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
        for key, own in value.items():
            must_be(key, get_args(kind)[0], f"a key of {name}")
            must_be(own, get_args(kind)[1], f"{name}.{key}")
    elif isinstance(kind, type) and is_dataclass(kind):
        _hold(isinstance(value, kind), name, kind.__name__)
        hints = get_type_hints(kind)
        for own in fields(kind):
            must_be(getattr(value, own.name), hints[own.name], f"{name}.{own.name}")


def _any_of(value: Any, kind: Any, name: str) -> None:
    refused: TypeError | None = None
    for own in get_args(kind):
        try:
            must_be(value, own, name)
        except TypeError as error:
            refused = refused if own is type(None) and refused else error
        else:
            return
    assert refused is not None
    raise refused


def _tuple(value: Any, kinds: tuple[Any, ...], name: str) -> None:
    _hold(isinstance(value, tuple), name, "a list")
    if len(kinds) == 2 and kinds[1] is Ellipsis:
        kinds = (kinds[0],) * len(value)
    _hold(len(value) == len(kinds), name, f"a list of {len(kinds)}")
    for k, (own, kind) in enumerate(zip(value, kinds, strict=True)):
        must_be(own, kind, f"{name}[{k}]")


def _hold(condition: bool, name: str, words: str) -> None:
    if not condition:
        raise TypeError(f"its {name} is not {words}")
