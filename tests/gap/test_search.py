"""What a search knows of single columns to first order, of tolerances, and of what they are charged."""

import numpy as np
import pytest
from gap_cases import GivenBench, alone, axis, linear_bench, search_on, smooth_columns, weighted

from greybox_id.gap.axes import Candidate
from greybox_id.gap.refit import refit

SD = np.array([0.1, 0.4])


def test_a_projected_gain_is_the_exact_one_where_everything_is_linear():
    X = smooth_columns(5)
    bench = linear_bench(X, [0.3, 0.1, -0.2, 0.0, 0.0], SD)
    search = search_on(bench, SD, [axis(0, sd=0.2), axis(1, sd=0.05)])
    (base,) = refit(search, [search.start_of(search.at_means())])
    found = search.project(base.e, X[:, :, 2:], base.theta, base.linear)
    prior = np.diag([1 / 0.2, 1 / 0.05])
    for k, index in enumerate((2, 3, 4)):
        costs = []
        for own in ((0, 1), (0, 1, index)):
            W, y = weighted(bench, own, SD)
            H = np.vstack([W, np.hstack([prior, np.zeros((2, len(own) - 2))])])
            x = np.linalg.lstsq(H, np.append(y, [0.0, 0.0]))[0]
            costs.append(0.5 * np.sum((H @ x - np.append(y, [0.0, 0.0])) ** 2))
        assert found.gain[k] == pytest.approx(costs[0] - costs[1], rel=1e-6, abs=1e-6)
        assert found.step[k] == pytest.approx(x[2], rel=1e-6, abs=1e-8)
        W, _ = weighted(bench, (0, 1, index), SD)
        information = W.T @ W + np.diag([1 / 0.2**2, 1 / 0.05**2, 0.0])
        assert found.curve[k] == pytest.approx(1 / np.linalg.inv(information)[2, 2], rel=1e-6)
        assert found.raw[k] == pytest.approx(np.sum(W[:, 2] ** 2))


def test_a_column_that_a_tolerance_explains_promises_nothing_unless_the_tolerance_is_tight():
    X = smooth_columns(2)
    X[:, :, 1] = 3 * X[:, :, 0]
    for sd, told in ((100.0, 1e-4), (1e-4, 0.9)):
        search = search_on(linear_bench(X, [0.0, 0.0], SD), SD, [axis(0, sd=sd)])
        base = search.at_means()
        found = search.project(-search.bench.measured, X[:, :, 1:], base.theta, base.linear)
        assert (found.curve[0] / found.raw[0] > 0.5) == (told > 0.5)
        assert found.curve[0] / found.raw[0] == pytest.approx(told, abs=0.1)


def test_a_tolerance_that_is_freed_is_charged_nothing_and_held_to_nothing():
    X = smooth_columns(2)
    bench = linear_bench(X, [2.0, 0.0], SD)
    search = search_on(bench, SD, [axis(0, sd=0.005), axis(1, sd=0.1)])
    (base,) = refit(search, [search.start_of(search.at_means())])
    (found,) = refit(search, [alone(search, Candidate("freed", (axis(0),)))])
    assert abs(base.theta[0]) < 1.5
    assert search.charge(base) > 1000
    assert found.m[0] == pytest.approx(2.0, abs=0.05)
    assert found.theta[0] == 0.0  # moves as the candidate, not as the tolerance
    assert search.charge(found) == pytest.approx((found.theta[1] / 0.1) ** 2)
    assert found.cost == pytest.approx(bench.measured.size / 2, rel=0.15)


def test_an_abrupt_tolerance_enters_to_first_order_and_at_once():
    rng = np.random.default_rng(0)
    X = smooth_columns(2)

    def respond(p):
        return X[:, :, 0] * p[0] + 0.2 * X[:, :, 1] * (p[0] > 0)

    bench = GivenBench(respond, np.zeros((400, 2)), 1)
    bench.measured = respond(np.array([0.9])) + SD * rng.standard_normal((400, 2))
    search = search_on(bench, SD, [axis(0, sd=1.0, low=0.0, shift=True)])
    assert search.moving == ()
    (base,) = refit(search, [search.start_of(search.at_means())])
    assert base.linear[0] == pytest.approx(0.9, abs=0.05)
    assert base.linear[1] == pytest.approx(1.0, abs=0.1)
    assert search.vector(base)[0] == 0.0
    np.testing.assert_allclose(search.first_order(base), respond(base.linear[:1]), atol=0.1)
