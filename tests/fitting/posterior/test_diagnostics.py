"""R-hat and effective sample sizes of chains whose truth is known."""

import numpy as np
import pytest
from scipy.signal import lfilter

from greybox_id.fitting.posterior.posterior import effective_sample_size, r_hat, weighted_quantile


def chains(rho, count=8, length=4000, seed=0):
    """Autoregressive chains with a variance of one, (chains, draws)."""
    noise = np.random.default_rng(seed).standard_normal((count, length + 500)) * np.sqrt(1 - rho**2)
    return lfilter([1.0], [1.0, -rho], noise, axis=1)[:, 500:]


def test_chains_that_have_met_have_an_r_hat_of_one():
    assert r_hat(chains(0.5)) == pytest.approx(1.0, abs=0.005)


def test_a_chain_apart_is_seen_by_its_mean_or_by_its_spread():
    apart, wide = chains(0.0), chains(0.0)
    apart[0] += 3.0
    wide[0] *= 5.0
    assert r_hat(apart) > 1.1
    assert r_hat(wide) > 1.02


@pytest.mark.parametrize("rho", [0.0, 0.5, 0.9])
def test_autocorrelation_costs_what_theory_says(rho):
    own = chains(rho)
    assert effective_sample_size(own) == pytest.approx(own.size * (1 - rho) / (1 + rho), rel=0.15)


def test_too_short_chains_say_nothing():
    assert np.isnan(r_hat(np.zeros((4, 3))))
    assert np.isnan(effective_sample_size(np.zeros((4, 3))))


def test_quantiles_follow_the_weights():
    values, weight = np.array([3.0, 1.0, 2.0]), np.array([0.0, 0.5, 0.5])
    assert weighted_quantile(values, weight, 0.25) == 1.0
    assert weighted_quantile(values, weight, 0.5) == 1.5
