"""Conditions on signals: what people write holds where it should, and nothing else is understood."""

from contextlib import suppress

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from greybox_id.base.condition import holds
from greybox_id.base.errors import BadInput

SIGNALS = {"v_x": np.array([1.0, 6.0, np.nan, 9.0]), "steer": np.array([0.0, -0.2, 0.0, 0.05])}


@pytest.mark.parametrize(
    ("condition", "rows"),
    [
        ("v_x > 5", [1, 3]),
        ("not v_x > 5", [0]),  # missing is not known to be below
        ("v_x > 5 and abs(steer) < 0.1", [3]),
        ("v_x <= 1 or steer < -0.1", [0, 1]),
        ("1 < v_x < 9", [1]),
        ("v_x * 2 - 3 >= 9 - 0", [1, 3]),
        ("(v_x == 1) or not (steer != 0.05)", [0, 3]),
        ("-steer > 0.1", [1]),
        ("steer / 0 > 1", [3]),
        ("  v_x>5\n", [1, 3]),
    ],
)
def test_conditions_hold_where_they_should(condition, rows):
    np.testing.assert_array_equal(np.flatnonzero(holds(condition, SIGNALS)), rows)


@pytest.mark.parametrize(
    ("condition", "words"),
    [
        ("v > 5", "names v, which is not recorded"),
        ("v_x", "is no comparison"),
        ("v_x > 5; 1", "cannot be understood"),
        ("", "cannot be understood"),
        ("__import__('os').system('true') > 0", "cannot be understood as a number"),
        ("v_x.real > 1", "cannot be understood as a number"),
        ("v_x[0] > 1", "cannot be understood as a number"),
        ("v_x ** 9 > 1", "cannot be understood as a number"),
        ("abs(v_x, v_x) > 1", "cannot be understood as a number"),
        ("v_x > 'a'", "cannot be understood as a number"),
        ("v_x > True", "cannot be understood as a number"),
        ("v_x in (1, 2)", "cannot be understood as a number"),
        ("v_x is 1", "is no comparison"),
        ("(lambda: 1)() > 0", "cannot be understood as a number"),
        ("v_x > " + "9" * 600, "at most 500 are allowed"),
        ("(" * 300 + "v_x" + ")" * 100, "cannot be understood"),
    ],
)
def test_anything_else_is_refused_in_a_sentence(condition, words):
    with pytest.raises(BadInput, match=words.replace("(", r"\(")):
        holds(condition, SIGNALS)


@given(st.text(st.sampled_from("v_xster<>=!()+-*/ .0195andortbs,'[]:"), max_size=40))
def test_any_text_holds_somewhere_or_is_refused(text):
    with suppress(BadInput):
        assert holds(text, SIGNALS).shape == (4,)
