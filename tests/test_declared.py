"""What a file says is of the types that are declared, or a sentence says what is not."""

from collections.abc import Mapping
from dataclasses import dataclass

import pytest

from greybox_id.declared import must_be


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
