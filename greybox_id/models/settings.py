"""Hyperparameters of models as plain data: read from files and options, checked field by field."""

from __future__ import annotations

import types
from collections.abc import Mapping
from dataclasses import dataclass, fields, is_dataclass
from typing import Any, TypeVar, Union, cast, get_args, get_origin, get_type_hints

from ..base.errors import BadInput, near

T = TypeVar("T")


@dataclass(frozen=True)
class NoSettings:
    """Hyperparameters of models that have none."""


def from_mapping(kind: type[T], values: Mapping[str, Any], where: str = "") -> T:
    """A settings dataclass from plain data.

    Raises
    ------
    BadInput : an unknown name, or a value of the wrong kind; the sentence says which and what would do.
    """
    hints = get_type_hints(kind)
    known = [f.name for f in fields(cast(Any, kind))]
    there_are = f"there are {', '.join(where + name for name in known)}" if known else "there are none"
    for name in values:
        if name not in known:
            raise BadInput(
                f"There is no setting {where}{name}; {there_are}.{near(where + name, (where + one for one in known))}"
            )
    return kind(**{name: _value(hints[name], value, where + name) for name, value in values.items()})


def within(settings: object, **limits: tuple[float, float]) -> None:
    """Raise `BadInput` where a hyperparameter lies outside what can be built."""
    for name, (low, high) in limits.items():
        value = getattr(settings, name)
        if not low <= value <= high:
            raise BadInput(f"Setting {name} must lie between {low:g} and {high:g}; {value:g} was given.")


def _value(hint: Any, value: Any, name: str) -> Any:
    origin = get_origin(hint)
    if origin in (Union, types.UnionType):
        if value is None and type(None) in get_args(hint):
            return None
        hint = next(h for h in get_args(hint) if h is not type(None))
        origin = get_origin(hint)
    if is_dataclass(hint) and isinstance(hint, type):
        if not isinstance(value, Mapping):
            raise BadInput(f"Setting {name} is a group of settings, but {value!r} was given.")
        return from_mapping(hint, value, f"{name}.")
    if origin is tuple:
        if not isinstance(value, (list, tuple)) or not value:
            raise BadInput(f"Setting {name} is a list of numbers, but {value!r} was given.")
        return tuple(_value(float, v, name) for v in value)
    if hint is bool and isinstance(value, bool):
        return value
    if hint is int and isinstance(value, int) and not isinstance(value, bool):
        return value
    if hint is float and isinstance(value, (int, float)) and not isinstance(value, bool):
        return float(value)
    if hint is str and isinstance(value, str):
        return value
    raise BadInput(f"Setting {name} is a {getattr(hint, '__name__', hint)}, but {value!r} was given.")
