"""Weighted draws against distributions that are known in closed form."""

import numpy as np
import pytest
from scipy.stats import gamma, genpareto, norm, truncnorm

from greybox_id.base.errors import BadInput
from greybox_id.fitting.posterior.density import DrawnNumber, Target
from greybox_id.fitting.posterior.laplace import BATCH, ROUNDS, pareto_shape, smoothed, trusted, weighted_draws

SD = np.array([0.3, 0.5])


class Known:
    """A density of two lengths about (0, 0), whose covariance a fit would have told as that of `SD`."""

    coordinates = tuple(DrawnNumber(name, "m", name) for name in "ab")
    centre = np.zeros(2)

    def __init__(self, log_density, low=-100.0, high=100.0):
        self._log_density, self.bounds, self.calls = log_density, (np.full(2, low), np.full(2, high)), 0

    def __call__(self, points):
        self.calls += 1
        return np.sum(self._log_density(points / SD), axis=1)

    def within(self, points):
        return np.all((points >= self.bounds[0]) & (points <= self.bounds[1]), axis=1)


def drawn(density, draws=4000, seed=0, tell=lambda number, done: None):
    target = Target(density, np.diag(SD**2), np.diag(SD**2))
    return weighted_draws(target, draws, seed, tell)


def quantiles(found, shares):
    order = np.argsort(found.u[:, 0])
    return np.interp(shares, np.cumsum(found.weight[order]), found.u[order, 0]) / SD[0]


@pytest.mark.parametrize("k", [0.2, 0.5, 0.9])
def test_the_shape_of_a_tail_is_found(k):
    found = [pareto_shape(np.sort(genpareto.rvs(k, scale=2.0, size=2000, random_state=seed))) for seed in range(20)]
    shape, scale = np.mean(found, axis=0)
    assert shape == pytest.approx(k, abs=0.02)
    assert scale == pytest.approx(2.0, rel=0.03)


def test_smoothing_keeps_the_order_and_no_weight_exceeds_the_largest_ratio():
    ratio = np.random.default_rng(0).standard_t(3, 1000)
    log_weight, k = smoothed(ratio)
    assert np.sum(np.exp(log_weight)) == pytest.approx(1.0)
    assert np.array_equal(np.argsort(log_weight), np.argsort(ratio))
    assert np.ptp(log_weight) <= np.ptp(ratio) + 1e-9
    assert 0.0 < k < np.inf
    even, k = smoothed(np.zeros(1000))
    assert even == pytest.approx(np.log(1e-3))
    assert k == -np.inf
    assert np.isnan(smoothed(ratio[:20])[1])


def test_a_normal_posterior_needs_one_round():
    density = Known(lambda z: -0.5 * z**2)
    found = drawn(density)
    assert density.calls == 4000 / BATCH
    assert found.k < 0.3
    assert quantiles(found, [0.05, 0.5, 0.95]) == pytest.approx(norm.ppf([0.05, 0.5, 0.95]), abs=0.08)
    assert 1 / np.sum(found.weight**2) > 2500


def test_a_skewed_posterior_is_put_right():
    """Gamma distributions about their mode, as wide there as the fit's covariance tells."""
    shape = 10.0
    scale = 1 / np.sqrt(shape - 1)  # second derivative one at the mode

    def log_density(z):
        at = z + (shape - 1) * scale
        with np.errstate(invalid="ignore", divide="ignore"):
            return np.where(at > 0, (shape - 1) * np.log(at) - at / scale, -np.inf)

    found = drawn(Known(log_density))
    exact = gamma.ppf([0.05, 0.5, 0.95], shape, scale=scale) - (shape - 1) * scale
    assert found.k < trusted(4000)
    assert quantiles(found, [0.05, 0.5, 0.95]) == pytest.approx(exact, abs=0.1)
    assert abs(exact[2] - norm.ppf(0.95)) > 0.5  # what a normal distribution would say


def test_a_bound_cuts_it():
    found = drawn(Known(lambda z: -0.5 * z**2, low=0.0))
    assert np.all(found.u >= 0.0)
    assert found.within == pytest.approx(0.25, abs=0.02)
    exact = truncnorm.ppf([0.05, 0.5, 0.95], 0.0, np.inf)
    assert quantiles(found, [0.05, 0.5, 0.95]) == pytest.approx(exact, abs=0.1)


def test_a_posterior_elsewhere_takes_more_rounds():
    """Three standard deviations off and half as wide: the first round finds out where, the next ones draw there."""
    density = Known(lambda z: -0.5 * ((z - 3.0) / 0.5) ** 2)
    found = drawn(density)
    assert 4000 / BATCH < density.calls <= ROUNDS * 4000 / BATCH
    assert found.k <= trusted(4000)
    assert quantiles(found, [0.05, 0.5, 0.95]) == pytest.approx(3.0 + 0.5 * norm.ppf([0.05, 0.5, 0.95]), abs=0.1)


def test_what_no_weights_make_right_is_the_normal_distribution_and_is_told():
    """Nearly all of it is on a line of a thousandth of the width."""
    found = drawn(Known(lambda z: -0.5 * (1e4 * (z[:, :1] - z[:, 1:] ** 3)) ** 2 - 0.01 * z**4))
    assert found.k > trusted(4000)
    assert found.weight == pytest.approx(1 / 4000)
    assert np.std(found.u, axis=0) == pytest.approx(SD, rel=0.05)
    nowhere = drawn(Known(lambda z: np.full(z.shape, -np.inf)))
    assert nowhere.k == np.inf
    assert nowhere.weight == pytest.approx(1 / 4000)
    with pytest.raises(BadInput, match="beyond the parameters' bounds"):
        drawn(Known(lambda z: -0.5 * z**2, low=50.0))


def test_ctrl_c_leaves_the_draws_that_were_weighted():
    def tell(number, done):
        if done == 2 * BATCH:
            raise KeyboardInterrupt

    found = drawn(Known(lambda z: -0.5 * z**2), tell=tell)
    assert not found.complete
    assert len(found.u) == len(found.weight) == 2 * BATCH
    assert np.sum(found.weight) == pytest.approx(1.0)
