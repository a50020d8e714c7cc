"""From equations to functions: what is accepted, what is refused."""

from dataclasses import replace

import numpy as np
import pytest
from toys import linear_toy, tiny

from greybox_id.base.errors import BadModel
from greybox_id.engine.trace import Trace


def test_memory_is_the_longest_window():
    assert Trace(tiny("msnn_full")).memory == 5
    assert Trace(linear_toy(7)).memory == 7


def test_a_model_without_windows_has_a_memory_of_one_sample():
    model = replace(linear_toy(), equations=lambda u, p, past: {"yaw_rate": p.F[0] * u.steer})
    assert Trace(model).memory == 1


def test_equations_that_forget_an_output_are_refused_by_name():
    with pytest.raises(BadModel, match="yaw_rate"):
        Trace(replace(linear_toy(), equations=lambda u, p, past: {}))


def test_a_window_over_a_window_is_refused():
    nested = replace(linear_toy(), equations=lambda u, p, past: {"yaw_rate": past(past(u.steer, p.F), p.F)})
    with pytest.raises(BadModel, match="window looks at another window"):
        Trace(nested)


def test_windows_of_different_lengths_end_at_the_same_present():
    model = replace(
        linear_toy(1), equations=lambda u, p, past: {"yaw_rate": past(u.steer, [1, 2, 3]) - past(2 * u.steer, [5])}
    )
    trace = Trace(model)
    weights = trace.weights(model.values).reshape(2, 3)
    np.testing.assert_array_equal(weights, [[1, 2, 3], [0, 0, 5]])


def test_only_what_feeds_back_is_fed_back():
    assert Trace(tiny("msnn_lat")).fed_back == ()
    assert set(Trace(tiny("msnn_full")).fed_back) == {"a_x", "a_y"}
