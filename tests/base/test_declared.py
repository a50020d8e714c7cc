"""What a file says is of the types that are declared, or a sentence says what is not."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal

import numpy as np
import pytest

from greybox_id.base.declared import of_plain, understood
from greybox_id.base.errors import BadInput
from greybox_id.base.shorthands import Array


@dataclass(frozen=True)
class Inner:
    words: tuple[str, ...]


@dataclass(frozen=True)
class Outer:
    number: float
    count: int
    inner: Inner | None
    pairs: tuple[tuple[Mapping[str, float], bool], ...] = ()


def test_plain_data_become_what_is_declared():
    assert of_plain(Outer, {"number": 1, "count": 2, "inner": None}, "it") == Outer(1.0, 2, None)
    plain = {"number": 1.5, "count": 2, "inner": {"words": ["a"]}, "pairs": [[{"a": 1}, True]], "more": 7}
    assert of_plain(Outer, plain, "it") == Outer(1.5, 2, Inner(("a",)), (({"a": 1.0}, True),))
    assert np.array_equal(of_plain(Mapping[str, Array], {"x": [1, 2]}, "it")["x"], [1.0, 2.0])
    assert of_plain(tuple[float, ...], [None, 1], "it", null=np.inf) == (np.inf, 1.0)


@pytest.mark.parametrize(
    ("odd", "says"),
    [
        ({"number": "1"}, "its it.number is not a number"),
        ({"number": True}, "its it.number is not a number"),
        ({"number": None}, "its it.number is not a number"),
        ({"count": 2.0}, "its it.count is not a whole number"),
        ({"inner": {"words": "a"}}, "its it.inner.words is not a list"),
        ({"inner": {"words": ["a", 1]}}, r"its it.inner.words\[1\] is not text"),
        ({"inner": 7}, "its it.inner is not Inner"),
        ({"inner": {}}, "words"),
        ({"pairs": [[{"a": None}, True]]}, r"its it.pairs\[0\]\[0\].a is not a number"),
        ({"pairs": [[{}, True, 1]]}, r"its it.pairs\[0\] is not a list of 2"),
    ],
)
def test_what_is_not_is_named(odd, says):
    with pytest.raises(TypeError, match=says):
        of_plain(Outer, {"number": 1.0, "count": 2, "inner": None} | odd, "it")


def test_what_is_no_table_or_none_of_some_words_is_named():
    with pytest.raises(TypeError, match="its it is not Outer"):
        of_plain(Outer, None, "it")
    with pytest.raises(TypeError, match="its way is not up or down"):
        of_plain(Literal["up", "down"], "left", "way")


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
