"""Steps within bounds, against SciPy's bounded-variable least squares."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import lsq_linear

from greybox_id.engine.solvers.gauss_newton import least_within


def quadratic(size, seed, wide):
    rng = np.random.default_rng(seed)
    A, b = rng.standard_normal((3 * size, size)), rng.standard_normal(3 * size)
    low, high = -wide * rng.random(size), wide * rng.random(size)
    return A, b, low, high


def all_free(size):
    return np.ones(size, dtype=bool)


@settings(max_examples=150)
@given(
    size=st.integers(1, 40),
    seed=st.integers(0, 10_000),
    wide=st.sampled_from([0.05, 0.3, 10.0]),
    mixed=st.sampled_from([0.0, 0.9, 0.999]),
)
def test_a_step_is_the_least_within_bounds(size, seed, wide, mixed):
    A, b, low, high = quadratic(size, seed, wide)
    A = (1 - mixed) * A + mixed * A[:, :1]  # columns nearly alike
    d = least_within(A.T @ A, A.T @ b, low, high, all_free(size))
    assert np.all(d >= low)
    assert np.all(d <= high)
    best = lsq_linear(A, -b, (low, high), method="bvls", tol=1e-15)
    assert 0.5 * np.sum((A @ d + b) ** 2) <= best.cost * (1 + 1e-12)
    if mixed < 0.99:  # else what is told apart least is told to five digits
        np.testing.assert_allclose(d, best.x, atol=1e-6 * wide)


@settings(max_examples=60)
@given(size=st.integers(1, 12), seed=st.integers(0, 10_000))
def test_a_start_outside_of_bounds_ends_at_the_least_within_them(size, seed):
    A, b, low, high = quadratic(size, seed, 0.3)
    off = np.random.default_rng(seed).choice([-0.5, 0.0, 0.5], size)
    low, high = low + off, high + off
    d = least_within(A.T @ A, A.T @ b, low, high, all_free(size))
    np.testing.assert_allclose(d, lsq_linear(A, -b, (low, high), method="bvls", tol=1e-15).x, atol=1e-7)


@pytest.mark.parametrize("wide", [np.inf, 1e3])
def test_a_step_that_no_bound_stops_is_the_minimiser(wide):
    A, b, _, _ = quadratic(6, 1, 1.0)
    d = least_within(A.T @ A, A.T @ b, np.full(6, -wide), np.full(6, wide), all_free(6))
    np.testing.assert_allclose(d, np.linalg.lstsq(A, -b)[0], atol=1e-9)


def test_what_is_held_does_not_move_and_the_rest_makes_the_best_of_it():
    A, b, _, _ = quadratic(5, 3, 1.0)
    free = np.array([True, False, True, True, False])
    d = least_within(A.T @ A, A.T @ b, np.full(5, -np.inf), np.full(5, np.inf), free)
    assert not np.any(d[~free])
    np.testing.assert_allclose(d[free], np.linalg.lstsq(A[:, free], -b)[0], atol=1e-9)
    assert not np.any(least_within(A.T @ A, A.T @ b, np.full(5, -1.0), np.full(5, 1.0), ~all_free(5)))


def test_what_bounds_leave_one_value_has_it_and_the_rest_follows():
    A, b, low, high = quadratic(5, 5, 10.0)
    low[2] = high[2] = 0.25
    d = least_within(A.T @ A, A.T @ b, low, high, all_free(5))
    assert d[2] == 0.25
    others = np.arange(5) != 2
    expected = lsq_linear(A[:, others], -(b + 0.25 * A[:, 2]), (low[others], high[others]), method="bvls").x
    np.testing.assert_allclose(d[others], expected, atol=1e-9)


def test_units_do_not_matter():
    A, b, _, _ = quadratic(4, 4, 1.0)
    units = np.array([1e-6, 1.0, 1e4, 1e7])
    low, high = np.full(4, -0.2), np.full(4, 0.2)
    d = least_within(A.T @ A, A.T @ b, low, high, all_free(4))
    B = A * units
    other = least_within(B.T @ B, B.T @ b, low / units, high / units, all_free(4))
    np.testing.assert_allclose(other * units, d, rtol=1e-9)


def test_damping_adds_to_each_unknowns_own_curvature():
    A, b, low, high = quadratic(6, 7, 0.5)
    H = A.T @ A
    damped = least_within(H, A.T @ b, low, high, all_free(6), 3.0)
    np.testing.assert_allclose(damped, least_within(H + 3.0 * np.diag(np.diag(H)), A.T @ b, low, high, all_free(6)))


def test_of_unknowns_that_are_the_same_a_finite_step_remains():
    A, b, low, high = quadratic(3, 8, 5.0)
    A = A[:, [0, 1, 1, 2]]  # two unknowns that nothing tells apart
    low, high = np.append(low, -5.0), np.append(high, 5.0)
    d = least_within(A.T @ A, A.T @ b, low, high, all_free(4), 1e-9)
    best = lsq_linear(A, -b, (low, high), method="trf", tol=1e-12)
    assert 0.5 * np.sum((A @ d + b) ** 2) <= best.cost + 1e-6
