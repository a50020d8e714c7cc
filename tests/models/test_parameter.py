"""Parameters: what they refuse, and how they are laid out as one vector."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from greybox_id.base.errors import BadInput
from greybox_id.models.parameter import Parameter, Prior, Stated, pack, unpack

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


@pytest.mark.parametrize(
    ("given", "says"),
    [
        ({"sd": -1.0}, "Prior, sd: standard deviations above zero are needed, not -1.0"),
        ({"sd": 0.0}, "known exactly, fix the parameter"),
        ({"sd": np.nan}, "above zero"),
        ({"sd": [1.0, -1.0]}, "above zero"),
        ({"sd": "wide"}, "Prior, sd: a number or an array of numbers is needed, not 'wide'"),
        ({"sd": None}, "above zero"),
        ({"sd": 1.0, "mean": np.nan}, "Prior, mean: finite numbers"),
        ({"sd": 1.0, "mean": "middle"}, "Prior, mean: a number"),
        ({"sd": 1.0, "step_sd": 0.4}, "step_sd: one entry for each axis"),
        ({"sd": 1.0, "step_sd": (None, -0.4)}, r"step_sd\[1\]: standard deviations above zero"),
    ],
)
def test_an_impossible_prior_is_refused_when_it_is_made(given, says):
    with pytest.raises(BadInput, match=says):
        Prior(**given)


def test_what_a_prior_leaves_free_is_infinite():
    assert Prior([np.inf, 0.5], mean=[0.0, 1.0], step_sd=(None,)).mean == [0.0, 1.0]


@pytest.mark.parametrize(
    ("more", "says"),
    [
        ({"value": "heavy"}, "Parameter m, value: a number"),
        ({"bounds": (2.0,)}, "Parameter m, bounds: a lowest and a highest value"),
        ({"scope": "lap"}, "scope must be one of model, run, not 'lap'"),
        ({"prior": 3.0}, "prior: a Prior is needed"),
        ({"prior": Prior([1.0, 2.0])}, r"has shape \(\); the sd of its prior has shape \(2,\)"),
        ({"value": [1.0, 2.0], "prior": Prior(1.0, mean=[1.0, 2.0, 3.0])}, "the mean of its prior"),
        ({"prior": Prior(1.0, step_sd=(0.4,))}, "its prior's step_sd has 1 axes"),
        ({"name": ""}, "a name is needed"),
    ],
)
def test_an_impossible_parameter_is_refused_when_it_is_made(more, says):
    with pytest.raises(BadInput, match=says):
        Parameter(**{"name": "m", "unit": "kg", "value": 1.0, **more})


@pytest.mark.parametrize(
    ("given", "says"),
    [
        ({"value": "heavy"}, "value: a number or None"),
        ({"value": np.inf}, "value: a number or None"),
        ({"value": 1.0, "sd": -0.1}, "cannot be negative"),
        ({"value": 1.0, "sd": np.nan}, "sd: a number or None"),
        ({"min": 2.0, "max": 1.0}, "min = 2 is above max = 1"),
    ],
)
def test_an_impossible_statement_is_refused_when_it_is_made(given, says):
    with pytest.raises(BadInput, match=says):
        Stated(**given)


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
