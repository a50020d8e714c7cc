"""ABC-SMC against posteriors that are known in closed form."""

import numpy as np
import pytest
from scipy.stats import truncnorm

from greybox_id.fitting.posterior import abc_smc
from greybox_id.fitting.posterior.abc_smc import ParticlePrior, begin, first, grow

NOISE, SEEN, PARTICLES = 0.6, np.array([0.9, -0.4]), 3000


def reached(distances, priors, targets, monkeypatch):
    """The last population of a schedule."""
    monkeypatch.setattr(abc_smc, "TARGETS", targets)
    population = first(distances, priors, PARTICLES, seed=1)
    for _ in targets:
        population = grow(distances, begin(distances, population, priors, 1), priors, 1, lambda own: False)
    return population


def test_it_draws_from_the_conjugate_posterior(monkeypatch):
    """Normal priors, two readings of sums of two numbers: the posterior is normal."""
    H, sd = np.array([[1.0, 0.0], [1.0, 1.0]]), np.array([1.0, 2.0])
    priors = [ParticlePrior(0.0, float(own), -np.inf, np.inf) for own in sd]
    rng = np.random.default_rng(5)

    def distances(at):
        return np.max(np.abs(at @ H.T + NOISE * rng.standard_normal(at.shape) - SEEN), axis=1)

    own = reached(distances, priors, (0.5, 0.3, 0.2, 0.1, 0.05), monkeypatch)
    assert own.threshold < NOISE
    variance = NOISE**2 + own.threshold**2 / 3  # what is accepted is off by an error that is uniform
    covariance = np.linalg.inv(np.diag(1 / sd**2) + H.T @ H / variance)
    mean = covariance @ H.T @ SEEN / variance
    found = own.weight @ own.at
    off = own.at - found
    spread = (off * own.weight[:, None]).T @ off
    assert found == pytest.approx(mean, abs=0.08)
    assert np.sqrt(np.diag(spread)) == pytest.approx(np.sqrt(np.diag(covariance)), rel=0.08)
    correlation = covariance[0, 1] / np.sqrt(covariance[0, 0] * covariance[1, 1])
    assert spread[0, 1] / np.sqrt(spread[0, 0] * spread[1, 1]) == pytest.approx(correlation, abs=0.08)


def test_a_prior_that_ends_at_a_bound_is_cut_there(monkeypatch):
    """One number that cannot be negative, read at -0.4 and believed about 0: a normal posterior, cut at zero."""
    priors = [ParticlePrior(0.0, 1.0, 0.0, np.inf)]
    rng = np.random.default_rng(6)

    def distances(at):
        return np.abs(at[:, 0] + NOISE * rng.standard_normal(len(at)) + 0.4)

    own = reached(distances, priors, (0.5, 0.3, 0.2, 0.1), monkeypatch)
    variance = 1 / (1 + 1 / NOISE**2)
    mean, sd = -0.4 / NOISE**2 * variance, np.sqrt(variance)
    exact = truncnorm(-mean / sd, np.inf, mean, sd)
    found = float(own.weight @ own.at[:, 0])
    assert found == pytest.approx(exact.mean(), abs=0.03)
    assert np.sqrt(own.weight @ (own.at[:, 0] - found) ** 2) == pytest.approx(exact.std(), rel=0.08)
