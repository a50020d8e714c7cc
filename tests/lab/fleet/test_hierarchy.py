"""Vehicles of a population: intervals hold, poor recordings borrow from good ones, priors are counted once."""

import numpy as np
import pytest
from scipy.special import stdtrit

from greybox_lab.fleet.hierarchy import Informed, informed, population


def fleet(rng, vehicles=40, each=12, spread=0.1, scatter=0.02, size=3):
    """True vehicles, and what recordings say, half of them poorly excited."""
    truth = rng.normal(0.3, spread, (vehicles, size))
    information, vector, of = [], [], []
    for v in range(vehicles):
        for r in range(each):
            sd = np.linspace(0.03, 0.06, size) * (rng.uniform(5, 20) if r % 2 else 1.0)
            mixed = np.eye(size) + 0.5 * rng.normal(size=(size, size))
            own = mixed @ mixed.T
            own *= np.outer(sd, sd) / np.sqrt(np.outer(np.diag(own), np.diag(own)))
            read = rng.multivariate_normal(truth[v] + scatter * rng.normal(size=size), own)
            information.append(np.linalg.inv(own))
            vector.append(information[-1] @ read)
            of.append(v)
    return truth, Informed(np.array(information), np.array(vector), np.array(of), vehicles)


def test_intervals_of_vehicles_hold_and_spreads_are_found():
    held, spread, scatter, mean = [], [], [], []
    for seed in range(6):
        truth, seen = fleet(np.random.default_rng(seed))
        found = population(seen)
        sd = np.sqrt(np.diagonal(found.covariance, axis1=1, axis2=2))
        held.append(np.abs(found.vehicle - truth) < 1.96 * sd)
        spread.append(found.spread)
        scatter.append(found.scatter)
        mean.append((found.mean - 0.3) / np.sqrt(np.diag(found.mean_covariance)))
    assert 0.92 < np.mean(held) < 0.98  # 720 intervals: 95 % within 1.6 % twice
    assert np.allclose(np.sqrt(np.mean(spread, axis=0)), 0.1, rtol=0.15)
    assert np.allclose(np.sqrt(np.mean(scatter, axis=0)), 0.02, rtol=0.3)
    assert np.max(np.abs(mean)) < 3.5


def test_directions_that_no_recording_informs_count_nothing():
    rng = np.random.default_rng(3)
    truth, seen = fleet(rng, vehicles=10)
    blind = seen.information.copy()
    blind[::2, 0, :] = blind[::2, :, 0] = 0.0
    vector = seen.vector.copy()
    vector[::2] = 0.0
    blind[::2] = 0.0
    half = Informed(blind, vector, seen.vehicle, seen.vehicles)
    only = Informed(seen.information[1::2], seen.vector[1::2], seen.vehicle[1::2], seen.vehicles)
    assert np.allclose(population(half).vehicle, population(only).vehicle, atol=2e-2)
    assert truth.shape == (10, 3)


def test_the_prior_of_a_fit_is_taken_off():
    data, prior_sd, prior_mean = np.array([[4.0, 1.0], [1.0, 3.0]]), np.array([0.5, np.inf]), np.array([2.0, 0.0])
    estimate = np.array([1.0, -1.0])
    prior = np.diag([4.0, 0.0])
    covariance = np.linalg.inv(data + prior)
    centre = covariance @ (data @ estimate + prior @ prior_mean)
    information, vector = informed(covariance, centre, prior_mean, prior_sd, np.full(2, np.inf))
    assert np.allclose(information, data)
    assert np.allclose(np.linalg.solve(information, vector), estimate)


def test_what_a_prior_alone_says_is_no_information():
    information, vector = informed(np.diag([0.25, 0.01]), np.array([2.0, 1.0]), np.array([2.0, 0.0]),
                                   np.array([0.5, np.inf]), np.full(2, np.inf))  # fmt: skip
    assert np.allclose(information, np.diag([0.0, 100.0]))
    assert np.allclose(vector, [0.0, 100.0])


@pytest.mark.parametrize(("vehicles", "each"), [(1, 1), (1, 8), (5, 8)])
def test_directions_that_no_recording_informs_are_left_to_the_prior_which_counts_once(vehicles, each):
    of, along = np.repeat(np.arange(vehicles), each), np.array([1.0, 1.0])
    information = np.tile(100.0 * np.outer(along, along), (len(of), 1, 1))
    vector = np.tile(100.0 * along * (along @ [1.4, 0.8]), (len(of), 1))
    found = population(Informed(information, vector, of, vehicles, prior=(np.full(2, 4.0), 4.0 * np.array([1.0, 1.0]))))
    across = np.array([1.0, -1.0]) / np.sqrt(2.0)
    assert across @ found.mean_covariance @ across == pytest.approx(0.25, rel=0.01)
    assert across @ found.mean == pytest.approx(0.0, abs=1e-3)
    assert along @ found.mean == pytest.approx(2.2, abs=0.05)
    assert np.all(np.diagonal(found.covariance, axis1=1, axis2=2) > 0)


def test_few_degrees_of_freedom_widen_what_a_fit_says():
    wide, _ = informed(np.eye(1), np.ones(1), np.zeros(1), np.array([np.inf]), np.array([6.0]))
    assert np.isclose(wide[0, 0], 4.0 / 6.0)  # the variance of Student's t is dof / (dof - 2)


def test_one_vehicle_is_a_population_of_one():
    truth, seen = fleet(np.random.default_rng(5), vehicles=1, each=20)
    found = population(seen)
    assert np.all(np.abs(found.vehicle[0] - truth[0]) < 0.1)


@pytest.mark.parametrize(("vehicles", "each", "spread"), [(4, 6, 0.1), (5, 3, 0.1), (6, 6, 0.05)])
def test_intervals_of_few_vehicles_know_that_spreads_were_estimated(vehicles, each, spread):
    held, known = [], []
    for seed in range(30):
        truth, seen = fleet(np.random.default_rng(seed), vehicles, each, spread=spread)
        found = population(seen)
        off = np.abs(found.vehicle - truth)
        held.append(off < stdtrit(found.dof, 0.975) * np.sqrt(np.diagonal(found.covariance, axis1=1, axis2=2)))
        given = found.covariance - found.unsure
        known.append(off < 1.96 * np.sqrt(np.diagonal(given, axis1=1, axis2=2)))
    assert 0.92 <= np.mean(held) <= 0.99
    assert np.mean(held) > np.mean(known) + 0.02  # which is what they are there for


def test_the_likelihood_is_flat_where_scoring_ends():
    _, seen = fleet(np.random.default_rng(8), vehicles=15)
    found = population(seen)
    again = population(seen, found)
    assert np.allclose(found.spread, again.spread, rtol=1e-2)
    assert np.allclose(found.scatter, again.scatter, rtol=1e-2)
    best = restricted(seen, found.spread, found.scatter)
    for k in range(3):
        for factor in (0.7, 1.4):
            other = found.spread.copy()
            other[k] *= factor
            assert restricted(seen, other, found.scatter) < best


def restricted(seen, spread, scatter):
    """The restricted likelihood, from whole covariance matrices."""
    size, total, left, right, square = len(spread), 0.0, 0.0, 0.0, 0.0
    for rows in seen.groups:
        count = len(rows)
        covariance = np.kron(np.ones((count, count)), np.diag(spread))
        y = np.zeros(count * size)
        for k, j in enumerate(rows):
            here = slice(k * size, (k + 1) * size)
            own = np.linalg.inv(seen.information[j])
            covariance[here, here] += own + np.diag(scatter)
            y[here] = own @ seen.vector[j]
        design = np.tile(np.eye(size), (count, 1))
        inverse = np.linalg.inv(covariance)
        total -= 0.5 * np.linalg.slogdet(covariance)[1]
        left, right, square = (
            left + design.T @ inverse @ design,
            right + design.T @ inverse @ y,
            square + y @ inverse @ y,
        )
    mean = np.linalg.solve(left, right)
    return total - 0.5 * np.linalg.slogdet(left)[1] - 0.5 * (square - right @ mean)
