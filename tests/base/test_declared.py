"""What a file says is of the types that are declared, or a sentence says what is not."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal

import numpy as np
import pytest

from greybox_id.base.declared import must_be, understood
from greybox_id.base.errors import BadInput


@dataclass(frozen=True)
class Inner:
    words: tuple[str, ...]


@dataclass(frozen=True)
class Outer:
    number: float
    count: int
    inner: Inner | None
    pairs: tuple[tuple[Mapping[str, float], bool], ...] = ()


def test_what_is_as_declared_passes():
    must_be(Outer(1, 2, None), Outer, "it")
    must_be(Outer(1.5, 2, Inner(("a",)), (({"a": 1}, True),)), Outer, "it")


@pytest.mark.parametrize(
    ("made", "says"),
    [
        (Outer("1", 2, None), "its it.number is not a number"),
        (Outer(True, 2, None), "its it.number is not a number"),
        (Outer(1.0, 2.0, None), "its it.count is not a whole number"),
        (Outer(1.0, 2, Inner(["a"])), "its it.inner.words is not a list"),
        (Outer(1.0, 2, Inner(("a", 1))), r"its it.inner.words\[1\] is not text"),
        (Outer(1.0, 2, {}), "its it.inner is not Inner"),
        (Outer(1.0, 2, None, (({"a": None}, True),)), r"its it.pairs\[0\]\[0\].a is not a number"),
        (Outer(1.0, 2, None, (({1: 1.0}, True),)), r"a key of it.pairs"),
        (Outer(1.0, 2, None, (({}, True, 1),)), r"its it.pairs\[0\] is not a list of 2"),
        (None, "its it is not Outer"),
    ],
)
def test_what_is_not_is_named(made, says):
    with pytest.raises(TypeError, match=says):
        must_be(made, Outer, "it")


@understood
def halved(number: float, names: Mapping[str, float] | None = None, way: Literal["up", "down"] = "up") -> float:
    """Half of it."""
    if way not in ("up", "down") or number == 7:
        raise ValueError(way)
    return number / 2 + len(dict(names or {}))


def test_what_works_is_not_refused():
    assert halved(np.int64(4), {"a": 1.0}) == 3.0
    assert halved(True) == 0.5  # of another type than declared, but nothing went wrong


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (("a",), "number: a number is needed, not 'a'"),
        ((1.0, 5), "names: a mapping of names to values or None is needed, not 5"),
        ((1.0, {1: 2}, "left"), "names: a mapping of names to values or None is needed"),
        ((1.0, None, "left"), "way: 'up' or 'down' is needed, not 'left'"),
    ],
)
def test_an_argument_of_another_type_is_named_where_a_function_fails(arguments, says):
    with pytest.raises(BadInput, match=says):
        halved(*arguments)


def test_errors_of_another_cause_stay_what_they_are():
    with pytest.raises(ValueError, match="up"):
        halved(7)
    with pytest.raises(TypeError, match="missing 1 required"):
        halved()
