"""Standard deviations and intervals against Monte Carlo and textbook formulas, where the truth is known."""

from dataclasses import replace

import numpy as np
import pytest
import scipy.linalg as la
from linear_problem import Linear, coloured
from scipy import stats
from toys import DT, drive, joined, linear_toy, obeying_toy

from greybox_id.datasets.recording import Recording
from greybox_id.engine.shooting import Problem
from greybox_id.engine.solvers.gauss_newton import gauss_newton
from greybox_id.engine.trace import Trace
from greybox_id.fitting.uncertainty import covariance, uncertainty
from greybox_id.models.parameter import Parameter, Prior

STATIC = replace(
    linear_toy(1), name="static", parameters=(Parameter("gain", "1/s", 0.0), Parameter("offset", "rad/s", 0.0)),
    equations=lambda u, p, past: {"yaw_rate": p.gain * u.steer + p.offset},
)  # fmt: skip


def estimate(model, recordings, noise=0.1):
    trace = model if isinstance(model, Trace) else Trace(model)
    problem = Problem(trace, recordings, noise=np.array([noise]))
    solution = gauss_newton(problem, problem.start, tolerance=1e-12)
    return solution.x, covariance(problem, solution.x, solution.nodes)


# What the intervals are for: covering the truth


STEP, SPEED, NOISE = 0.02, 15.0, np.array([0.1, 0.03, 0.5])
TRUE = np.array([-6.0, -14.0, 3.0, -7.0, 60.0, 45.0, 0.05, 0.01, 0.2])


def single_track(p, steer):
    """Side-slip velocity, yaw rate and lateral acceleration of many cars at once, and their derivatives.

    p (cars, 9): four of dynamics, two of steering, three sensors' offsets; steer (cars, rows).
    """
    cars, rows = steer.shape
    A, b = p[:, :4].reshape(-1, 2, 2), p[:, 4:6]
    state, by_p = np.zeros((cars, 2)), np.zeros((cars, 2, 6))
    y, J = np.zeros((cars, rows, 3)), np.zeros((cars, rows, 3, 9))
    for k in range(rows):
        rate, rate_by_p = np.einsum("cij,cj->ci", A, state) + b * steer[:, k, None], A @ by_p
        rate_by_p[:, 0, 0:2] += state
        rate_by_p[:, 1, 2:4] += state
        rate_by_p[:, [0, 1], [4, 5]] += steer[:, k, None]
        y[:, k, :2], y[:, k, 2] = state, rate[:, 0] + SPEED * state[:, 1]
        J[:, k, :2, :6], J[:, k, 2, :6] = by_p, rate_by_p[:, 0] + SPEED * by_p[:, 1]
        state, by_p = state + STEP * rate, by_p + STEP * rate_by_p
    J[:, :, [0, 1, 2], [6, 7, 8]] = 1.0
    return y + p[:, None, 6:], J


def fitted_cars(rng, cars, rows, rho):
    """Recordings of one car under random steering, fitted: estimates, residuals and derivatives."""
    steer = coloured(rng, (cars, rows), np.exp(-STEP / 0.4), 0.05)
    noise = np.moveaxis(coloured(rng, (cars, 3, rows), rho, 1.0), 1, 2)
    p = np.tile(TRUE, (cars, 1))
    measured = single_track(p, steer)[0] + NOISE * noise
    for _ in range(2):
        y, J = single_track(p, steer)
        r, J = (y - measured) / NOISE, J / NOISE[:, None]
        flat = J.reshape(cars, -1, 9)
        back = flat.transpose(0, 2, 1)
        p = p - np.linalg.solve(back @ flat, back @ r.reshape(cars, -1, 1))[..., 0]
    y, J = single_track(p, steer)
    return p, (y - measured) / NOISE, J / NOISE[:, None]


SLOW = pytest.mark.slow
SIXTY = pytest.param(60, 600, marks=SLOW)


@pytest.mark.parametrize("rho", [0.0, 0.8])
@pytest.mark.parametrize(("seconds", "recordings"), [(20, 300), pytest.param(20, 900, marks=SLOW), SIXTY])
def test_intervals_of_a_vehicles_nine_parameters_cover_the_truth_in_92_to_98_of_100_fits(seconds, rho, recordings):
    rng, inside = np.random.default_rng(seconds), []
    for _ in range(recordings // 60):
        for x, residuals, J in zip(*fitted_cars(rng, 60, round(seconds / STEP), rho), strict=True):
            problem = Linear([J @ x - residuals], [J])
            low, high = uncertainty(problem, x, []).interval().T
            inside.append((low < TRUE) & (high > TRUE))
    cover = np.mean(inside, axis=0)
    assert np.all((cover >= 0.92) & (cover <= 0.98)), cover


@pytest.mark.parametrize("rows", [pytest.param(200, marks=SLOW), 400])
def test_intervals_cover_at_their_nominal_rate_on_a_recording_of_ten_or_twenty_seconds(rows):
    rng, inside = np.random.default_rng(1), []
    for _ in range(400):
        steer = np.convolve(rng.standard_normal(rows + 9), np.ones(10) / 10, "valid") + 0.1
        J = np.column_stack([steer, np.ones(rows)])[:, None]
        told = Linear([J @ [3.0, 0.5] + coloured(rng, rows, 0.0)[:, None]], [J]).told()
        low, high = told.interval().T
        inside.append((low < [3.0, 0.5]) & (high > [3.0, 0.5]))
    assert np.all(np.abs(np.mean(inside, axis=0) - 0.95) < 0.03)


@pytest.mark.parametrize("rho", [0.0, 0.8])
def test_standard_deviations_agree_with_monte_carlo(rho):
    rng = np.random.default_rng(0)
    rows, true = 2400, np.array([3.0, 0.5])
    steer = np.convolve(rng.standard_normal(rows + 9), np.ones(10) / 10, "valid") + 0.1
    J = np.column_stack([steer, np.ones(rows)])[:, None]
    found, stated = [], []
    for _ in range(300):  # a spread known to 4 %
        problem = Linear([J @ true + coloured(rng, rows, rho)[:, None]], [J])
        found.append(problem.x)
        stated.append(np.diag(problem.told().covariance))
    np.testing.assert_allclose(np.sqrt(np.mean(stated, axis=0)), np.std(found, axis=0), rtol=0.12)


def test_correlated_noise_widens_the_intervals():
    rng = np.random.default_rng(1)
    steer = np.convolve(rng.standard_normal(2009), np.ones(10) / 10, "valid")
    sd = []
    for rho in (0.0, 0.8):
        yaw_rate = np.append(0.0, 3 * steer[:-1]) + coloured(rng, 2000, rho)
        recording = Recording("r", DT * np.arange(2000), {"steer": steer, "yaw_rate": yaw_rate})
        sd.append(np.sqrt(np.diag(estimate(STATIC, [recording])[1])))
    assert np.all(sd[1] > 1.5 * sd[0])


def test_a_recording_too_short_for_its_correlation_has_few_degrees_of_freedom_and_wide_intervals():
    rng = np.random.default_rng(2)
    J = np.ones((400, 1, 1))
    told = Linear([coloured(rng, 400, 0.97)[:, None]], [J]).told()
    assert told.blocks == 8
    assert told.dof[0] == pytest.approx(7.0)
    assert told.quantile()[0] == pytest.approx(stats.t.ppf(0.975, 7))
    assert told.sd[0] > 3 * 0.1 / np.sqrt(400)


# The formulas, written out


def by_the_book(problem, edges, factor):
    """CR2 and Bell & McCaffrey's degrees of freedom with every matrix in full."""
    X, data = problem.X, len(problem.X) - problem.R.shape[0]
    bread = la.inv(X.T @ X)
    pass_on = np.eye(len(X)) - X @ bread @ X.T
    e = pass_on @ problem.data
    rows = [np.arange(a, b) for a, b in zip(edges[:-1], edges[1:], strict=True)]
    assert rows[-1][-1] == data - 1
    G = []
    for own in rows:
        values, vectors = la.eigh(pass_on[np.ix_(own, own)])
        G.append(pass_on[:, own] @ (vectors / np.sqrt(values)) @ vectors.T @ X[own] @ bread)
    V = sum(np.outer(g.T @ problem.data, g.T @ problem.data) for g in G) / factor
    assert np.allclose(pass_on @ e, e)
    degrees = []
    for j in range(X.shape[1]):
        M = np.array([[one[:, j] @ other[:, j] for other in G] for one in G])
        degrees.append(np.trace(M) ** 2 / np.sum(M**2))
    R = problem.R.toarray()
    prior = bread @ R.T @ R @ bread
    return V + prior, np.array(degrees) * (np.diag(V + prior) / np.diag(V)) ** 2


@pytest.mark.parametrize("believed", [False, True])
def test_covariance_and_degrees_of_freedom_are_those_of_the_textbook(believed):
    rng = np.random.default_rng(3)
    rows, outputs = 120, 2
    J = rng.standard_normal((rows, outputs, 4)) * np.exp(rng.standard_normal((rows, 1, 4)))
    R = np.array([[3.0, 0, 0, 0], [5.0, -5.0, 0, 0]]) if believed else None
    problem = Linear([rng.standard_normal((rows, outputs)) + J @ [1.0, 0, 2.0, 0]], [J], R)
    told = problem.told()
    t = told.correlation_rows
    edges = np.round(rows * np.arange(told.blocks + 1) / told.blocks).astype(int) * outputs
    C, degrees = by_the_book(problem, edges, 1.0 - (t - 1.0 / t) / (2.0 * told.block_rows))
    assert told.blocks > 5
    np.testing.assert_allclose(told.covariance, C, rtol=1e-6)
    np.testing.assert_allclose(told.dof, degrees, rtol=1e-6)
    np.testing.assert_allclose(told.independent, la.inv(problem.X.T @ problem.X), rtol=1e-6)
    np.testing.assert_allclose(told.inflation, np.diag(C) / np.diag(told.independent), rtol=1e-6)


# Priors, bounds, mirrors, and what is not told


def test_the_assumed_noise_does_not_matter_where_there_is_no_prior():
    one, other = (estimate(linear_toy(2), [drive(300)], noise)[1] for noise in (0.01, 1.0))
    np.testing.assert_allclose(one, other, rtol=1e-6)


def test_a_mirror_image_tells_nothing_new():
    plain, mirrored = (estimate(linear_toy(3, symmetric=s), [drive(400)])[1] for s in (False, True))
    np.testing.assert_allclose(mirrored, plain, rtol=1e-6)


def test_where_only_the_prior_speaks_its_standard_deviation_is_stated():
    silent = Parameter("silent", "1", 0.0, prior=Prior(0.7))
    model = linear_toy(2)
    _, C = estimate(replace(model, parameters=(*model.parameters, silent)), [drive(200)])
    assert np.sqrt(C[2, 2]) == pytest.approx(0.7)


def test_what_nothing_tells_is_infinitely_uncertain():
    model = linear_toy(2)
    _, C = estimate(replace(model, parameters=(*model.parameters, Parameter("silent", "1", 0.0))), [drive(200)])
    _, without = estimate(model, [drive(200)])
    assert np.isinf(C[2, 2])
    np.testing.assert_allclose(C[:2, :2], without)


def test_what_nothing_tells_lies_anywhere_within_its_bounds():
    bounds = (np.array([-np.inf, -1.0]), np.array([np.inf, np.inf]))
    J = np.ones((200, 1, 2)) * [1.0, 0.0]
    told = Linear([np.random.default_rng(0).standard_normal((200, 1))], [J], bounds=bounds).told()
    assert np.isinf(told.sd[1])
    np.testing.assert_array_equal(told.interval()[1], [-1.0, np.inf])


def test_what_is_held_has_no_uncertainty():
    model = STATIC.with_parameters(replace(STATIC["offset"], fixed=True))
    _, C = estimate(model, [drive(200)])
    assert C[0, 0] > 0
    assert not np.any(C[1])
    assert not np.any(C[:, 1])


def test_what_stands_for_each_other_exactly_is_told_together_but_not_alone():
    rng = np.random.default_rng(9)
    J = rng.standard_normal((300, 1, 1))
    y = 3.0 * J[..., 0] + rng.standard_normal((300, 1))
    both, total = Linear([y], [J * [[[1.0, 1.0]]]]).told(), Linear([y], [J]).told()
    assert np.all(both.sd > 1e4)
    assert np.sqrt(np.sum(both.covariance)) == pytest.approx(total.sd[0], rel=0.01)


def test_with_everything_held_nothing_is_uncertain():
    model = STATIC.with_parameters(*(replace(p, fixed=True) for p in STATIC.parameters))
    assert not np.any(estimate(model, [drive(200)])[1])


def test_four_times_the_data_halve_the_standard_deviation():
    F = np.array([0.2, 1.0])
    short, long = (estimate(linear_toy(2), [obeying_toy(F, rows, noise=0.1)])[1] for rows in (2000, 8000))
    np.testing.assert_allclose(np.sqrt(np.diag(short) / np.diag(long)), 2.0, rtol=0.25)


def bounded(rng, at):
    """A gain and an offset of 0.01 that cannot be below 0; correlated, so that one at its bound moves the other."""
    J = np.column_stack([1.0 + rng.standard_normal(300), np.ones(300)])[:, None]
    y = J @ [2.0, 0.01] + 0.3 * rng.standard_normal((300, 1))
    problem = Linear([y], [J], bounds=(np.array([-np.inf, 0.0]), np.array([np.inf, np.inf])))
    free = problem.x
    if free[1] < 0.0 or at:
        problem.x = np.array([np.sum(J[:, 0, 0] * y[:, 0]) / np.sum(J[:, 0, 0] ** 2), 0.0])
    return problem, free


def test_a_parameter_at_its_bound_leaves_the_others_between_held_there_and_free():
    problem, _ = bounded(np.random.default_rng(0), at=True)
    told = problem.told()
    problem.free = np.array([True, False])
    held = problem.told()
    problem.free, problem.bounds = np.array([True, True]), (np.full(2, -np.inf), np.full(2, np.inf))
    free = problem.told()
    np.testing.assert_array_equal(told.at_bound, [False, True])
    assert held.covariance[0, 0] <= told.covariance[0, 0] <= 1.1 * free.covariance[0, 0]


def test_of_a_parameter_at_its_bound_the_interval_is_that_of_the_optimum_without_bounds_cut_there():
    rng = np.random.default_rng(5)
    problem, free = next(found for found in (bounded(rng, at=False) for _ in range(50)) if found[1][1] < 0.0)
    told = problem.told()
    problem.x, problem.bounds = free, (np.full(2, -np.inf), np.full(2, np.inf))
    without = problem.told()
    assert told.centre[1] == pytest.approx(free[1], abs=1e-9)
    assert told.sd[1] == pytest.approx(without.sd[1], rel=0.05)  # the correlation time is that of other residuals
    np.testing.assert_allclose(told.released, without.covariance, rtol=0.1)
    np.testing.assert_allclose(told.released_independent, without.independent, rtol=1e-6)
    np.testing.assert_array_equal(without.released, without.covariance)
    np.testing.assert_array_equal(without.released_independent, without.independent)
    low, high = told.interval()[1]
    assert low == 0.0
    assert high == pytest.approx(without.interval()[1, 1], rel=0.1)


def test_intervals_of_a_parameter_near_its_bound_cover_at_their_nominal_rate():
    rng = np.random.default_rng(6)
    intervals = [bounded(rng, at=False)[0].told().interval()[1] for _ in range(400)]
    assert abs(np.mean([low <= 0.01 <= high for low, high in intervals]) - 0.95) < 0.03


def test_runs_with_offsets_of_their_own_have_blocks_enough_to_tell_them():
    offset = Parameter("offset", "rad/s", 0.0, scope="run")
    model = STATIC.with_parameters(offset)
    trace, recording = Trace(model), joined(300, 300, 300, 300, 300, 300, 300, 300)
    problem = Problem(trace, [recording], noise=np.array([0.1]))
    solution = gauss_newton(problem, problem.start)
    told = uncertainty(problem, solution.x, solution.nodes)
    assert told.dof.shape == (9,)
    assert np.min(told.dof[1:]) > 3.0
