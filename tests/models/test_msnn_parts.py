"""Membership functions and their centres; impulse responses and their prior."""

from itertools import pairwise

import casadi as cs
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from greybox_id.base.errors import BadInput
from greybox_id.engine.least_squares import prior_rows
from greybox_id.models.msnn_parts import centres, evenly, fading, fading_prior, memberships, over
from greybox_id.models.parameter import Parameter

rising = st.lists(st.floats(-50, 50), min_size=1, max_size=6, unique=True).map(sorted).filter(
    lambda c: all(b - a > 1e-3 for a, b in pairwise(c))
)  # fmt: skip


def at(x, where):
    return np.array([float(cs.DM(m)) for m in memberships(cs.DM(x), where)])


@given(rising, st.floats(-200, 200))
def test_memberships_are_triangles_held_outside(where, x):
    expected = [np.interp(x, where, row) for row in np.eye(len(where))]
    np.testing.assert_allclose(at(x, where), expected, atol=1e-9)


def test_centres_that_do_not_increase_are_refused():
    with pytest.raises(BadInput, match="must increase"):
        memberships(cs.SX.sym("x"), (0.0, 0.0, 1.0))


def test_even_spacing():
    assert evenly(-1.0, 3.0, 3) == (-1.0, 1.0, 3.0)
    assert evenly(-1.0, 3.0, 1) == (1.0,)


@given(st.lists(st.floats(-100, 100), min_size=1, max_size=20), st.integers(2, 6))
def test_centres_over_recorded_values_increase_and_symmetric_ones_mirror(values, count):
    for symmetric in (False, True):
        where = over(np.array([*values, np.nan]), count, symmetric)
        assert len(where) == count
        assert np.all(np.diff(where) > 0)
        if symmetric:
            np.testing.assert_allclose(where, -np.array(where)[::-1], atol=1e-9)


def test_a_channel_without_a_single_value_still_gives_centres():
    assert np.all(np.diff(over(np.full(5, np.nan), 3)) > 0)


def test_given_centres_must_be_as_many_as_local_models():
    assert centres("v_x", (1.0, 2.0), 2, 0.0, 1.0) == (1.0, 2.0)
    with pytest.raises(BadInput, match="3 local models over v_x"):
        centres("v_x", (1.0, 2.0), 3, 0.0, 1.0)


@given(st.integers(1, 15), st.floats(0.1, 3.0), st.floats(0.4, 0.95), st.floats(0.5, 4.0))
def test_the_fading_priors_covariance_is_the_tc_kernel(length, sd, decay, strength):
    prior = fading_prior(length, sd=sd, decay=decay, axes=1, strength="transient")
    R, _ = prior_rows([Parameter("F", "1", fading(length), prior=prior)], {"transient": strength})
    found = np.linalg.inv((R.T @ R).toarray()) * strength**2
    age = np.arange(length)[::-1]
    expected = sd**2 * np.minimum(decay ** age[:, None], decay ** age[None, :])
    np.testing.assert_allclose(found, expected, rtol=1e-6, atol=1e-9 * sd**2)


def test_rows_of_a_matrix_of_responses_are_independent():
    prior = fading_prior(4, sd=1.0, decay=0.7, axes=2)
    R, _ = prior_rows([Parameter("F", "1", np.zeros((3, 4)), prior=prior)])
    covariance = np.linalg.inv((R.T @ R).toarray())
    for row in range(3):
        covariance[4 * row : 4 * row + 4, 4 * row : 4 * row + 4] = 0
    np.testing.assert_allclose(covariance, 0, atol=1e-12)


def test_the_prior_is_met_exactly_at_its_mean():
    F = fading(6)
    R, r = prior_rows([Parameter("F", "1", F, prior=fading_prior(6, sd=0.5, decay=0.7, axes=1))])
    np.testing.assert_allclose(R @ F - r, 0, atol=1e-12)


@given(st.integers(1, 40), st.floats(0.5, 10))
def test_a_fading_response_has_unit_gain_and_grows_towards_the_present(length, samples):
    weights = fading(length, samples)
    assert np.sum(weights) == pytest.approx(1.0)
    assert np.all(np.diff(weights) > 0)
