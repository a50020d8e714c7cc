"""The smoother against all readings at once, and against filterpy's."""

import numpy as np
import pytest
from compiled import needs_compiler
from filter_cases import LinearCase, driven_space, driving, filtered
from filterpy.kalman import KalmanFilter

from greybox_id.filters.filtering import smoothed

both_kinds = pytest.mark.parametrize("kind", ["ekf", "ukf"])
pytestmark = needs_compiler


def at_once(case, x, P, s, y):
    """Means and covariances of all states given all readings: one problem of least squares over the whole run."""
    n, rows = case.space.size, len(s)
    blocks, right = [], []

    def add(columns, value, covariance):
        root = np.linalg.inv(np.linalg.cholesky(covariance))
        line = np.zeros((len(value), n * rows))
        for k, block in columns.items():
            line[:, n * k : n * (k + 1)] = block
        blocks.append(root @ line)
        right.append(root @ value)

    add({0: np.eye(n)}, x[0], P[0])
    for k, own in enumerate(s):
        there = np.isfinite(y[k])
        if there.any():
            add({k: case.H[there]}, (y[k] - np.array([0.0, 0.3]) * own[1])[there], case.R[np.ix_(there, there)])
        if k + 1 < rows:
            F, given, Q = case.step(own[0], own[1])
            add({k: -F, k + 1: np.eye(n)}, given, Q)
    A = np.vstack(blocks)
    covariance = np.linalg.inv(A.T @ A)
    mean = np.linalg.lstsq(A, np.concatenate(right), rcond=None)[0]
    each = [covariance[n * k : n * (k + 1), n * k : n * (k + 1)] for k in range(rows)]
    return mean.reshape(rows, n), np.array(each)


@both_kinds
@pytest.mark.parametrize("T", [None, 0.8])
def test_it_is_the_least_squares_solution_over_the_whole_run(kind, T):
    case = LinearCase(T)
    given = case.given(rows=40)
    x, P = at_once(case, *given)
    found, found_P = smoothed(filtered(case.space, kind, *given, case.p)[1])
    np.testing.assert_allclose(found, x, atol=1e-8 * np.abs(x).max())
    np.testing.assert_allclose(found_P, P, atol=1e-8 * np.abs(P).max())


def test_it_is_filterpy_s_smoother():
    case = LinearCase(None)
    x, P, s, y = case.given(missing=0.0)
    s[:, 0] = 0.05
    F, _, Q = case.step(0.05, 0.0)
    s[:, 1] = 0.0
    other = KalmanFilter(4, 2)
    other.x, other.P, other.F, other.Q, other.H, other.R = x[0], P[0], F, Q, case.H, case.R
    means, covariances = [], []
    for k, read in enumerate(y):
        if k:
            other.predict()
        other.update(read)
        means.append(other.x.copy())
        covariances.append(other.P.copy())
    expected, expected_P, *_ = other.rts_smoother(np.array(means), np.array(covariances))
    found, found_P = smoothed(filtered(case.space, "ekf", x, P, s, y, case.p)[1])
    np.testing.assert_allclose(found, expected, atol=1e-9 * np.abs(expected).max())
    np.testing.assert_allclose(found_P, expected_P, atol=1e-9 * np.abs(expected_P).max())


@both_kinds
def test_the_last_row_is_the_filter_s_and_no_variance_grows(kind):
    """Also where actuators and relaxed quantities have none of their own."""
    space, p = driven_space(effects={"steering_lag": 0.05, "tyre_relaxation": 0.4}, coloured=("a_y",))
    _, told = filtered(space, kind, *driving(space, p), p, 5.0)
    x, P = smoothed(told)
    np.testing.assert_array_equal(x[-1], told.filtered[-1])
    np.testing.assert_array_equal(P[-1], told.filtered_P[-1])
    variance, before = (np.einsum("kii->ki", own) for own in (P, told.filtered_P))
    assert np.all(variance <= before * (1 + 1e-6) + 1e-14)
    assert np.all(variance > -1e-14)
    assert np.median(variance[:, 1] / before[:, 1]) < 0.8


@both_kinds
def test_what_it_was_given_is_left_as_it_is(kind):
    case = LinearCase()
    _, told = filtered(case.space, kind, *case.given(), case.p)
    before = {name: value.copy() for name, value in vars(told).items()}
    smoothed(told)
    for name, value in before.items():
        np.testing.assert_array_equal(getattr(told, name), value)
