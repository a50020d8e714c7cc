"""Priors as rows against Gaussians written out."""

import numpy as np
import pytest

from greybox_id.engine.least_squares import prior_rows
from greybox_id.models.parameter import Parameter, Prior


def half_squares(parameters, p, strengths=None):
    R, r = prior_rows(parameters, strengths)
    return 0.5 * np.sum((R @ p - r) ** 2)


def test_a_prior_is_a_gaussian_about_its_mean():
    parameters = [Parameter("a", "1", 1.0, prior=Prior(0.5)), Parameter("b", "1", 2.0, prior=Prior(3.0, mean=-1.0))]
    p = np.array([1.7, 0.4])
    expected = 0.5 * ((1.7 - 1.0) / 0.5) ** 2 + 0.5 * ((0.4 + 1.0) / 3.0) ** 2
    assert half_squares(parameters, p) == pytest.approx(expected)


def test_steps_are_gaussian_about_the_means_own_steps_along_each_axis():
    rng = np.random.default_rng(1)
    mean, p, sd = rng.standard_normal((2, 3)), rng.standard_normal((2, 3)), np.array([0.2, 0.7])
    prior = Prior(2.0, mean=mean, step_sd=(0.4, sd))
    expected = 0.5 * np.sum(((p - mean) / 2.0) ** 2)
    for row in (0, 1):
        for k in (0, 1):
            expected += 0.5 * (((p - mean)[row, k + 1] - (p - mean)[row, k]) / sd[k]) ** 2
    expected += 0.5 * np.sum((((p - mean)[1] - (p - mean)[0]) / 0.4) ** 2)
    assert half_squares([Parameter("a", "1", np.zeros((2, 3)), prior=prior)], p.ravel()) == pytest.approx(expected)


def test_an_infinite_standard_deviation_says_nothing():
    parameter = Parameter("a", "1", [0.0, 0.0], prior=Prior([np.inf, 1.0]))
    assert half_squares([parameter], np.array([1e6, 0.0])) == 0.0


def test_a_strength_divides_the_standard_deviations_of_its_own_priors_only():
    parameters = [
        Parameter("a", "1", [0.0, 0.0], prior=Prior(1.0, step_sd=(1.0,), strength="s")),
        Parameter("b", "1", 0.0, prior=Prior(1.0)),
    ]
    assert half_squares(parameters, np.array([1.0, 2.0, 3.0]), {"s": 2.0}) == pytest.approx(
        4 * 0.5 * (1 + 4 + 1) + 0.5 * 9
    )


def test_parameters_without_priors_have_no_rows():
    R, r = prior_rows([Parameter("a", "1", [1.0, 2.0]), Parameter("b", "1", 0.0)])
    assert R.shape == (0, 3)
    assert r.shape == (0,)
