"""Parameters: what they refuse, and how they are laid out as one vector."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from greybox_id.errors import BadInput
from greybox_id.parameter import Parameter, pack, unpack

shapes = st.lists(st.sampled_from([(), (1,), (3,), (2, 3), (2, 1, 2), (0,)]), max_size=5)


@given(shapes, st.integers(0, 99))
def test_unpacking_a_packed_vector_gives_the_parameters_back(forms, seed):
    rng = np.random.default_rng(seed)
    parameters = [Parameter(f"p{k}", "1", rng.standard_normal(shape)) for k, shape in enumerate(forms)]
    vector = pack(parameters)
    assert len(vector) == sum(p.size for p in parameters)
    for before, after in zip(parameters, unpack(parameters, vector), strict=True):
        assert np.array_equal(before.array, after.array)
        assert before.shape == after.shape


def test_arrays_are_packed_row_by_row_in_order():
    parameters = [Parameter("a", "1", [[1, 2], [3, 4]]), Parameter("b", "1", 5)]
    assert pack(parameters).tolist() == [1, 2, 3, 4, 5]


@pytest.mark.parametrize(
    ("value", "bounds", "says"),
    [
        (1.0, (2.0, 0.0), "above the upper bound"),
        (1.0, (np.nan, 0.0), "above the upper bound"),
        (3.0, (0.0, 2.0), "outside its bounds"),
        ([1.0, -1.0], (0.0, 2.0), "outside its bounds"),
        (np.nan, (-np.inf, np.inf), "not a number"),
        ([0.0, np.nan], (-np.inf, np.inf), "not a number"),
    ],
)
def test_an_impossible_value_is_refused_in_a_sentence(value, bounds, says):
    with pytest.raises(BadInput, match=says):
        Parameter("m", "kg", value, bounds)


def test_a_value_of_another_shape_is_refused_in_a_sentence():
    with pytest.raises(BadInput, match="shape"):
        Parameter("m", "kg", 1.0).with_value([1.0, 2.0])


def test_a_value_cannot_be_changed_in_place_nor_from_outside():
    given_value = np.array([1.0, 2.0])
    parameter = Parameter("m", "kg", given_value)
    given_value[0] = 9.0
    assert parameter.array.tolist() == [1.0, 2.0]
    with pytest.raises(ValueError, match="read-only"):
        parameter.array[0] = 3.0


def test_a_new_value_leaves_the_old_parameter_alone():
    old = Parameter("m", "kg", 1.0, about="mass")
    new = old.with_value(2.0)
    assert (float(old.array), float(new.array), new.about) == (1.0, 2.0, "mass")
