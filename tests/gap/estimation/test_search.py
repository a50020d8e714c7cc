"""What a search knows of tolerances, and of what they are charged."""

from dataclasses import replace

import numpy as np
import pytest
from gap_cases import GivenBench, alone, axis, candidate, linear_bench, search_on, smooth_columns, weighted
from hypothesis import given
from hypothesis import strategies as st

from greybox_id.gap.estimation.axes import Candidate
from greybox_id.gap.estimation.calibration import CAL
from greybox_id.gap.estimation.hypothesis import Start
from greybox_id.gap.estimation.noise import white_noise
from greybox_id.gap.estimation.refit import refit, settled

SD = np.array([0.1, 0.4])


def test_what_is_counted_otherwise_for_a_while_counts_as_before_afterwards():
    search = search_on(linear_bench(smooth_columns(2), [2.0, 0.0], SD), SD, [axis(0, sd=0.005), axis(1, sd=0.1)])
    gram, nominal = search.gram.copy(), search.nominal.copy()
    with search.counted(white_noise(3 * SD, search.bench.counted, search.bench.rows)):
        search.nominal[0] = 1.0
        search.about(None)
        np.testing.assert_allclose(search.gram, gram / 9, rtol=1e-6)
    np.testing.assert_array_equal(search.gram, gram)
    np.testing.assert_array_equal(search.nominal, nominal)


def test_a_tolerance_that_is_freed_is_charged_nothing_and_held_to_nothing():
    X = smooth_columns(2)
    bench = linear_bench(X, [2.0, 0.0], SD)
    search = search_on(bench, SD, [axis(0, sd=0.005), axis(1, sd=0.1)])
    (base,) = refit(search, [search.start_of(search.at_means())])
    (found,) = refit(search, [alone(search, Candidate("freed", (axis(0),)))])
    assert search.charge(base) > CAL.tolerated_sd**2
    assert found.m[0] == pytest.approx(2.0, abs=0.05)
    assert found.theta[0] == 0.0  # moves as the candidate, not as the tolerance
    assert search.charge(found) == pytest.approx((found.theta[1] / 0.1) ** 2)
    assert found.cost == pytest.approx(bench.measured.size / 2, rel=0.15)


def test_tolerances_cost_as_many_as_the_readings_tell_of_where_all_are_as_believed():
    X = smooth_columns(3)
    beliefs = np.array([0.3, 1e-6, 0.005])  # told by the readings; not at all; in part
    nuisances = [axis(k, sd=sd) for k, sd in enumerate(beliefs)]
    rng, found = np.random.default_rng(5), []
    for seed in range(200):
        search = search_on(linear_bench(X, beliefs * rng.standard_normal(3), SD, seed=seed), SD, nuisances)
        (base,) = refit(search, [search.start_of(search.at_means())])
        found.append((search.charge(base), search.expected_charge(base)))
    charges, expected = np.array(found).T
    np.testing.assert_allclose(expected, expected[0])
    assert 1.1 < expected[0] < 1.9
    assert charges.mean() == pytest.approx(expected[0], abs=3 * charges.std() / np.sqrt(200))


@pytest.mark.parametrize("sizes", [(1e20, 1.0, 1.0), (1e150, 1e60, 1e140), (1e3, 1e200, 1e-3)])
def test_the_readings_tell_of_no_fewer_than_none_and_no_more_than_all(sizes):
    """Derivatives of what spins leave rounding, even less than nothing: a diagnosis once ended with its root."""
    nuisances = [axis(k, sd=0.3) for k in range(3)]
    search = search_on(linear_bench(smooth_columns(3), np.zeros(3), SD), SD, nuisances)
    base = search.at_means()
    for seed in range(50):
        columns = np.random.default_rng(seed).standard_normal((3, 2)) * np.sqrt(sizes)[:, None]
        search.gram = columns @ columns.T  # of rank two
        search.gram += 1e-14 * np.abs(search.gram) * np.random.default_rng(seed).standard_normal((3, 3))
        assert 0.0 <= search.expected_charge(base) <= 3.0


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
    np.testing.assert_allclose(search.first_orders([base.linear])[:, :, 0], respond(base.linear[:1]), atol=0.1)


def test_a_tolerance_reaches_so_far_and_what_is_further_off_is_a_gap():
    X = smooth_columns(2)
    X[:, :, 1] = X[:, :, 0]
    bench = linear_bench(X, [1.0, 0.0], SD)
    search = search_on(bench, SD, [axis(0, sd=0.01)])
    (base,) = refit(search, [search.start_of(search.at_means())])
    assert base.theta[0] == pytest.approx(CAL.reach_sd * 0.01)
    (gap,) = refit(search, [Start((candidate(1),), np.array([0.0]), base.theta, base.linear)])
    assert gap.m[0] == pytest.approx(1.0, abs=0.02)
    assert abs(gap.theta[0]) < 0.01
    assert base.cost > gap.cost


def test_readings_that_count_for_less_are_as_if_noise_were_larger():
    X = smooth_columns(3)
    bench = linear_bench(X, [0.25, 0.0, 0.3], SD)
    less, louder = (search_on(bench, sd, [axis(0, sd=0.1), axis(1, sd=0.1)]) for sd in (SD, SD / np.sqrt(0.005)))
    less.trusting(0.005)
    one, other = (refit(own, [alone(own, candidate(2))])[0] for own in (less, louder))
    assert one.cost == pytest.approx(other.cost)
    np.testing.assert_allclose(one.theta, other.theta)
    np.testing.assert_allclose(less.covariance(one), louder.covariance(other))
    assert less.charge(one) == pytest.approx(louder.charge(other))  # beliefs keep their weight
    less.trusting(1.0)
    (again,) = refit(less, [less.start_of(one)])
    assert again.theta[0] > one.theta[0] + 0.02


def test_a_lag_is_expanded_where_it_is_found():
    rng = np.random.default_rng(0)
    X = rng.standard_normal((400, 2))
    bench = GivenBench(lambda p: np.tanh(8 * p[0]) * X, np.zeros((400, 2)), 1)
    bench.measured = bench.respond(np.array([0.2])) + SD * rng.standard_normal((400, 2))
    lag = axis(0, sd=0.1, low=0.0, gradual=False)
    search = search_on(bench, SD, [lag])
    (first,) = refit(search, [search.start_of(search.at_means())])
    then = settled(search, first)
    assert search.expanded[0] == pytest.approx(then.linear[0], abs=0.06)
    assert then.linear[0] == pytest.approx(0.2, abs=0.05)
    assert then.cost == pytest.approx(400, rel=0.1)
    assert abs(then.linear[0] - 0.2) < abs(first.linear[0] - 0.2)
    search.about(None)
    assert search.expanded[0] == 0.0


def test_abrupt_tolerances_are_expanded_about_the_magnitude_of_an_abrupt_candidate():
    """Each is a tolerance of the file, too: a lag of a cause was once taken away where a delay's column was made."""
    X = np.random.default_rng(0).standard_normal((400, 2))
    bench = GivenBench(lambda p: np.tanh(3 * p[0] + 2 * p[1]) * X, np.zeros((400, 2)), 2)
    lag, delay = (axis(k, sd=0.05, low=0.0, gradual=False) for k in (0, 1))
    search = search_on(bench, SD, [lag, delay])
    about = alone(search, Candidate("lag", (axis(0, low=0.0, gradual=False),)))
    search.about(replace(search.at_means(), candidates=about.candidates, m=np.array([0.3])))
    step = np.array([0.0, 0.01])  # of the delay, beside a lag of 0.3
    change = bench.respond(np.array([0.3, 0.01])) - bench.respond(np.array([0.3, 0.0]))
    np.testing.assert_allclose(search.first_orders([np.append(step, [0.0, 0.0])])[:, :, 0], change, rtol=0.1)
    without = np.array([0.01, 0.0])  # of the lag itself: what hypotheses without the candidate need
    change = bench.respond(np.array([0.01, 0.0])) - bench.respond(np.array([0.0, 0.0]))
    np.testing.assert_allclose(search.first_orders([np.append(without, [0.0, 0.0])])[:, :, 0], change, rtol=0.1)


def test_magnitudes_scatter_more_where_residuals_stay_alike():
    X = smooth_columns(1, rows=4000)
    for lasting, least, most in ((1, 1.0, 1.35), (50, 1.8, 9.0)):
        noise = np.repeat(np.random.default_rng(1).standard_normal((4000 // lasting, 2)), lasting, axis=0)
        X_of = np.ones_like(X) if lasting > 1 else X
        bench = GivenBench(lambda p, X=X_of: X @ p, X_of @ np.array([0.5]) + SD * noise, 1)
        search = search_on(bench, SD)
        (found,) = refit(search, [alone(search, candidate(0))])
        by_readings, by_priors = search.scatter(found)
        assert least <= np.sqrt(by_readings[0, 0] / search.covariance(found)[0, 0]) < most
        assert by_priors[0, 0] == 0.0  # there are no tolerances


@given(st.floats(0.02, 2.0), st.floats(-0.9, 0.9))
def test_scatter_due_to_priors_is_that_over_draws_of_tolerances(sd, alike):
    """Estimates move by what tolerances are off, as far as a magnitude acts like them, whatever the noise is."""
    X = smooth_columns(2)
    X[:, :, 1] = alike * X[:, :, 0] + np.sqrt(1 - alike**2) * X[:, :, 1]
    bench = linear_bench(X, [0.0, 0.5], SD)
    search = search_on(bench, SD, [axis(0, sd=sd)])
    (found,) = refit(search, [alone(search, candidate(1))])
    by_readings, by_priors = search.scatter(found)
    W = weighted(bench, range(2), SD)[0]
    H = W.T @ W + np.diag([1 / sd**2, 0.0])
    moved = np.linalg.solve(H, W.T @ W)[1, 0]  # of the estimate, per unit that the tolerance is off
    assert by_priors[0, 0] == pytest.approx((moved * sd) ** 2, rel=1e-6, abs=1e-15)
    assert by_readings[0, 0] + by_priors[0, 0] >= search.covariance(found)[0, 0] * (1 - 1e-9)


def test_an_effect_within_its_own_tolerance_is_no_gap():
    X = smooth_columns(2)
    search = search_on(linear_bench(X, [0.0, 0.0], SD), SD, [axis(0, sd=0.1)])
    (base,) = refit(search, [search.start_of(search.at_means())])
    for m, expected in ((0.29, True), (-0.29, True), (0.31, False), (-0.31, False)):
        assert search.tolerated(replace(base, candidates=(candidate(0),), m=np.array([m]))) == expected
    assert not search.tolerated(replace(base, candidates=(candidate(1),), m=np.array([0.0])))


def test_tolerances_begin_where_another_model_has_them():
    X = smooth_columns(3)
    names = ("B_f", "C_f", "E_f")
    means = dict(zip(names, (9.0, 1.4, 0.1), strict=True))
    curve = [replace(axis(k, sd=0.05), name=name, mean=means[name]) for k, name in enumerate(names)]
    search = search_on(linear_bench(X, [9.2, 1.38, 0.2], np.array([0.1, 0.1])), np.array([0.1, 0.1]), tuple(curve))
    wanted = {"B_f": 9.3, "C_f": 1.42, "E_f": 0.05, "of another model": 3.0}
    found = search.moved(search.at_values(wanted).theta)  # B, C and E of a curve are mixed
    np.testing.assert_allclose(found[:3], [wanted[name] for name in names])
    far = search.at_values({"B_f": 90.0}).theta
    assert np.all((far >= search.low[:3]) & (far <= search.high[:3]))
    np.testing.assert_array_equal(search.at_values({}).theta, search.at_means().theta)


def test_tolerances_of_positive_numbers_move_by_shares_and_are_differentiated_so():
    X = smooth_columns(2)
    own = axis(0, null=2.0, sd=0.4, low=0.0)
    search = search_on(linear_bench(X, [3.0, 0.0], SD), SD, [own])
    at = search.at_values({"p_0": 2.5})
    assert search.moved(at.theta)[0] == pytest.approx(2.5)
    assert search.values(at)["p_0"] == pytest.approx(2.5)
    assert search.where(at, axis(0)) == pytest.approx(2.5)  # as an effect's own coordinate
    search.about(at)
    h = 1e-6
    one, other = search.residuals([search.moved(at.theta + step) for step in (h, -h)])
    np.testing.assert_allclose(
        search.white[:, 0], search.weighed((one - other)[:, :, None] / (2 * h)).ravel(), rtol=1e-6
    )
    (found,) = refit(search, [search.start_of(at)])
    found = settled(search, found)
    assert search.moved(found.theta)[0] == pytest.approx(3.0, rel=0.02)
    assert search.charge(found) == pytest.approx((np.log(search.moved(found.theta)[0] / 2.0) / 0.2) ** 2)


def test_derivatives_beyond_all_numbers_leave_squares_finite():
    X = smooth_columns(2)
    bench = linear_bench(X, [1.0, 0.0], SD)
    exact = bench.linearise
    bench.linearise = lambda p, columns: (exact(p, columns)[0], np.full((len(X), 2, 1), np.inf), exact(p, columns)[2])
    search = search_on(bench, SD, [axis(0, sd=0.1)])
    assert np.all(np.isfinite(search.gram))
