"""Profiles: the covariance's interval where a model is linear, the right one where it is not, or none at all."""

import copy
from types import SimpleNamespace

import numpy as np
import pytest
import scipy.sparse as sp
from scipy.optimize import brentq
from scipy.signal import lfilter
from toys import drive, linear_toy, looping, speed_toy

import greybox_id as gb
from greybox_id.base.errors import BadInput
from greybox_id.engine.shooting import Problem
from greybox_id.engine.solvers.gauss_newton import gauss_newton
from greybox_id.engine.trace import Trace
from greybox_id.fitting.uncertainty import uncertainty
from greybox_id.fitting.uncertainty.profile import End, profile
from greybox_id.models.parameter import Prior


class Curve:
    """Readings of a curve of p: residuals(p) (rows,), its derivative by small steps, and priors R x - r."""

    def __init__(self, residuals, start, R=None, r=None, bounds=None):
        self.of, self.start = residuals, np.asarray(start, dtype=float)
        size = len(self.start)
        self.layout, self.copies = SimpleNamespace(index=(np.arange(size),), size=size), 1
        self.free = np.ones(size, dtype=bool)
        self.bounds = bounds or (np.full(size, -np.inf), np.full(size, np.inf))
        self.R, self.r = (sp.csr_matrix((0, size)), np.empty(0)) if R is None else (sp.csr_matrix(R), r)
        solution = gauss_newton(self, self.start, tolerance=1e-14)
        self.x = solution.x
        self.told = uncertainty(self, self.x, None)

    def simulated_nodes(self, x):
        return None

    def residuals(self, x, nodes):
        J = np.zeros((len(self.of(x)), len(x)))
        for k in np.flatnonzero(self.free):
            step = np.zeros(len(x))
            step[k] = 1e-6 * max(1.0, abs(x[k]))
            J[:, k] = (self.of(x + step) - self.of(x - step)) / (2 * step[k])
        yield self.of(x)[:, None], J[:, None]

    def objective(self, x, nodes):
        total = 0.5 * np.sum(self.of(x) ** 2) + 0.5 * np.sum((self.R @ x - self.r) ** 2)
        return float(total) if np.isfinite(total) else np.inf

    def normal_equations(self, x, nodes):
        ((r, J),) = self.residuals(x, nodes)
        H = J[:, 0].T @ J[:, 0] + self.R.T @ self.R
        return SimpleNamespace(H=np.asarray(H), g=J[:, 0].T @ r[:, 0] + self.R.T @ (self.R @ x - self.r))

    def profile(self, index, **options):
        return profile(self, self.x, None, index, known=self.told, **options)


def line(rng, rho=0.0, **options):
    """A straight line far from zero: offset and slope are strongly correlated."""
    t = 3.0 + np.linspace(0.0, 1.0, 400)
    noise = lfilter([np.sqrt(1 - rho**2)], [1.0, -rho], rng.standard_normal(400))
    y = 1.0 + 2.0 * t + noise
    return Curve(lambda p: p[0] + p[1] * t - y, [0.0, 0.0], **options)


def decay(rng, first=0.2, noise=0.1, **options):
    """Readings of a exp(-b t), the rate b as its logarithm would not be: its interval leans."""
    t = np.linspace(first, 3.0, 60)
    y = 2.0 * np.exp(-1.5 * t) + noise * rng.standard_normal(60)
    return Curve(lambda p: (p[0] * np.exp(-p[1] * t) - y) / noise, [1.0, 1.0], **options), t, y


@pytest.mark.parametrize("rho", [0.0, 0.8])
@pytest.mark.parametrize("believed", [False, True])
@pytest.mark.parametrize("index", [0, 1])
def test_of_a_linear_model_the_profile_is_the_covariances_parabola_and_interval(index, believed, rho):
    prior = {"R": [[0.3, 0.0], [1.0, -1.0]], "r": np.array([0.6, 0.1])} if believed else {}
    curve = line(np.random.default_rng(0), rho, **prior)
    found = curve.profile(index)
    away = found.values - curve.x[index]
    np.testing.assert_allclose(found.rise, 0.5 * away**2 / curve.told.independent[index, index], atol=1e-6)
    np.testing.assert_allclose(found.interval, curve.told.interval()[index], rtol=1e-5)
    assert found.ends == (End.CROSSED, End.CROSSED)
    assert found.identifiable
    assert found.settled
    assert np.all(np.diff(found.values) > 0)
    np.testing.assert_allclose(found.unknowns[:, index], found.values)


def test_the_confidence_sets_the_width():
    curve = line(np.random.default_rng(0))
    np.testing.assert_allclose(curve.profile(1, confidence=0.5).interval, curve.told.interval(0.5)[1], rtol=1e-5)


@pytest.mark.parametrize("wider", [1.0, 1.0003, 1.3, 20.0])
def test_of_a_linear_model_the_interval_is_as_much_wider_as_the_fits(wider):
    curve = line(np.random.default_rng(0), 0.8)
    found = curve.profile(1, wider=wider)
    away = np.array([-1.0, 1.0]) * curve.told.quantile()[1] * curve.told.sd[1]
    np.testing.assert_allclose(found.interval, curve.x[1] + wider * away, rtol=1e-5)
    np.testing.assert_allclose(found.noise_alone.interval, curve.x[1] + away, rtol=1e-5)
    assert found.allowed == pytest.approx(wider**2 * found.noise_alone.allowed)
    assert np.all(np.diff(found.values) > 0)


def test_the_interval_of_the_noise_alone_is_what_it_were_without_the_wider_one():
    curve, t, y = decay(np.random.default_rng(1))

    def rise(b):
        shape = np.exp(-b * t)
        a = shape @ y / (shape @ shape)
        return 0.5 * np.sum(((a * shape - y) / 0.1) ** 2) - curve.objective(curve.x, None)

    alone, found, b = curve.profile(1), curve.profile(1, wider=2.5), curve.x[1]
    np.testing.assert_allclose(found.noise_alone.interval, alone.interval, rtol=2e-3)
    expected = (brentq(lambda v: rise(v) - found.allowed, 0.01, b), brentq(lambda v: rise(v) - found.allowed, b, b + 9))
    np.testing.assert_allclose(found.interval, expected, rtol=5e-3)


def test_what_ends_an_interval_ends_the_wider_one():
    bound = decay(np.random.default_rng(1))[0].profile(1).interval[0] - 0.05
    curve, _, _ = decay(np.random.default_rng(1), bounds=(np.array([-np.inf, bound]), np.full(2, np.inf)))
    found = curve.profile(1, wider=4.0)
    assert (found.noise_alone.ends[0], found.ends[0]) == (End.CROSSED, End.BOUND)
    assert found.interval[0] == bound < found.noise_alone.interval[0]
    assert not found.identifiable


def test_of_a_nonlinear_model_the_interval_ends_where_the_best_fit_has_become_too_bad():
    curve, t, y = decay(np.random.default_rng(1))

    def rise(b):
        shape = np.exp(-b * t)
        a = shape @ y / (shape @ shape)
        return 0.5 * np.sum(((a * shape - y) / 0.1) ** 2) - curve.objective(curve.x, None)

    found, b = curve.profile(1), curve.x[1]
    expected = (
        brentq(lambda v: rise(v) - found.allowed, b - 1, b),
        brentq(lambda v: rise(v) - found.allowed, b, b + 5),
    )
    half = 0.5 * (expected[1] - expected[0])
    np.testing.assert_allclose(found.interval, expected, atol=0.002 * half)
    assert expected[1] - b > 1.05 * (b - expected[0])  # it leans, and a covariance does not see it
    np.testing.assert_allclose(found.rise, [rise(v) for v in found.values], atol=1e-5)


def test_the_others_follow_the_unknown_along_the_profile():
    curve, t, y = decay(np.random.default_rng(1))
    for a, b in curve.profile(1).unknowns:
        shape = np.exp(-b * t)
        assert a == pytest.approx(shape @ y / (shape @ shape), rel=1e-4)


def test_a_side_that_meets_its_bound_first_ends_there_and_says_so():
    curve, _, _ = decay(np.random.default_rng(1), bounds=(np.array([-np.inf, 1.5]), np.array([np.inf, np.inf])))
    found = curve.profile(1)
    assert found.ends == (End.BOUND, End.CROSSED)
    assert found.interval[0] == 1.5
    assert not found.identifiable
    assert "Its lower side ends at the bound; the recording alone does not limit it there." in found.about("b")


def test_an_unknown_at_its_bound_has_a_profile_to_the_other_side():
    curve, _, _ = decay(np.random.default_rng(1), bounds=(np.array([-np.inf, 1.8]), np.array([np.inf, np.inf])))
    assert curve.x[1] == 1.8
    found = curve.profile(1)
    assert found.ends == (End.BOUND, End.CROSSED)
    assert found.interval[0] == 1.8
    assert found.interval[1] > 1.8


def test_another_unknown_stops_at_its_bound_along_the_way():
    curve, _, _ = decay(np.random.default_rng(1), bounds=(np.full(2, -np.inf), np.array([2.05, np.inf])))
    found = curve.profile(1)
    assert np.max(found.unknowns[:, 0]) == 2.05
    assert found.identifiable


def test_a_rate_too_fast_to_be_seen_has_no_upper_end():
    rng = np.random.default_rng(2)
    t = np.linspace(1.0, 5.0, 60)
    y = 2.0 * (1 - np.exp(-3.0 * t)) + 0.1 * rng.standard_normal(60)
    found = Curve(lambda p: (p[0] * (1 - np.exp(-p[1] * t)) - y) / 0.1, [1.9, 2.0], R=[[0.0, 1e-3]], r=np.zeros(1))
    found = found.profile(1)
    assert found.ends == (End.CROSSED, End.FLAT)
    assert 0.5 < found.interval[0] < 3.0
    assert found.interval[1] == np.inf
    assert "Its upper side has no end: the recording does not limit it there." in found.about("rate", "1/s")


def test_a_factor_of_a_product_is_limited_by_its_bound_alone():
    rng = np.random.default_rng(3)
    t = np.linspace(0.0, 1.0, 50)
    y = 6.0 * t + 0.1 * rng.standard_normal(50)
    curve = Curve(
        lambda p: (p[0] * p[1] * t - y) / 0.1, [2.0, 3.0], bounds=(np.array([1e-3, -np.inf]), np.full(2, np.inf))
    )
    found = curve.profile(0)
    assert found.ends == (End.BOUND, End.FLAT)
    assert np.max(found.rise) < 1e-3 * found.allowed


def test_what_nothing_tells_is_flat_on_both_sides():
    t = np.linspace(0.0, 1.0, 50)
    y = np.random.default_rng(4).standard_normal(50)
    found = Curve(lambda p: p[0] * t - y, [0.0, 7.0]).profile(1)
    assert found.ends == (End.FLAT, End.FLAT)
    assert found.interval == (-np.inf, np.inf)


def test_where_the_model_ends_the_profile_ends_and_says_so():
    t = np.linspace(1.0, 2.0, 40)
    noise = 2.0 * np.random.default_rng(5).standard_normal(40)
    y = 0.3 * t + noise - t * (t @ noise) / (t @ t)

    def residuals(p):
        return (np.sqrt(p[0] - 0.05) * t - y) / 2.0 if p[0] >= 0.05 else np.full(40, np.nan)

    curve = Curve(residuals, [0.1])
    found = curve.profile(0)
    assert found.ends == (End.NOT_FINITE, End.CROSSED)
    assert 0.05 <= found.interval[0] < curve.x[0]
    assert "the model is not finite" in found.about("level")


def test_a_profile_that_finds_a_better_fit_says_so():
    curve = Curve(lambda p: 5.0 * np.array([p[0] ** 2 - 1.0, 0.3 * (p[0] + 1.0), p[1], *np.zeros(7)]), [0.9, 0.0])
    assert curve.x[0] > 0.0
    told = SimpleNamespace(sd=np.ones(2), inflation=np.ones(2), quantile=lambda c: np.full(2, 6.0))
    found = profile(curve, curve.x, None, 0, known=told)
    assert found.at_a_better_optimum
    assert "fit again from there" in found.about("p")


def test_a_curved_valley_is_followed_to_its_floor():
    curve = Curve(lambda p: np.array([10.0 * (p[1] - p[0] ** 2), 1.0 - p[0], *np.zeros(8)]), [1.0, 1.0])
    told = SimpleNamespace(sd=np.ones(2), inflation=np.ones(2), quantile=lambda c: np.full(2, 2.0))
    found = profile(curve, curve.x, None, 0, known=told)
    np.testing.assert_allclose(found.rise, 0.5 * (found.values - 1.0) ** 2, atol=1e-6)
    np.testing.assert_allclose(found.interval, [-1.0, 3.0], atol=1e-4)


def test_what_is_held_has_no_profile():
    curve = copy.copy(line(np.random.default_rng(0)))
    curve.free = np.array([True, False])
    with pytest.raises(BadInput, match="is fixed; only quantities that are fitted"):
        curve.profile(1)


def test_the_problem_itself_stays_as_it_was():
    curve = line(np.random.default_rng(0))
    curve.profile(1)
    assert np.all(curve.free)


def test_a_network_that_is_linear_in_its_weights_has_the_covariances_intervals():
    problem = Problem(Trace(linear_toy(3, prior=Prior(2.0))), [drive(300)], noise=np.array([0.1]))
    solution = gauss_newton(problem, problem.start, tolerance=1e-12)
    told = uncertainty(problem, solution.x, solution.nodes)
    for index in range(3):
        found = profile(problem, solution.x, solution.nodes, index)
        np.testing.assert_allclose(found.interval, told.interval()[index], rtol=1e-4)


def test_a_closed_loops_pole_has_a_profile_within_its_bounds():
    problem = Problem(
        Trace(speed_toy()), [looping(drive(200), 0.7, 0.4, noise=0.3)], closed_loop=True, noise=np.array([0.3])
    )
    solution = gauss_newton(problem, problem.start)
    found = profile(problem, solution.x, solution.nodes, 0)
    assert found.identifiable
    assert found.interval[0] < solution.x[0] < found.interval[1] < 0.95


def test_physical_parameters_of_a_fit_with_memory_have_profiles():
    """One sample ahead the loop is linear in them, so that profile and covariance say the same."""
    lap = looping(drive(300), pole=0.6, gain=0.5, noise=0.05)
    fit = gb.fit(speed_toy(), lap, options=gb.FitOptions(strengths=1.0))
    for name in ("pole", "gain"):
        found = fit.profile(name)
        assert found.interval == pytest.approx(fit.conf_int().loc[name].to_numpy(), rel=0.02)
        assert found.identifiable
    with pytest.raises(BadInput, match="no free number that is the same in all runs"):
        gb.fit(linear_toy(), drive(), options=gb.FitOptions(strengths=1.0)).profile("F")
