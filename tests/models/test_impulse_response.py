"""Impulse responses and their prior."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from greybox_id.engine.least_squares import prior_rows
from greybox_id.models.msnn_parts import fading, fading_prior
from greybox_id.parameter import Parameter


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
