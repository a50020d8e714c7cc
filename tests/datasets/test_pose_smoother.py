"""The smoother of poses, against the same Gaussian vector conditioned all at once."""

import numpy as np
import pytest

from greybox_id.datasets.pose_smoother import log_likelihood, smooth


def problem(axes):
    """Two runs of uneven steps, a row without a reading; an acceleration that turns where there are two axes."""
    rng, n = np.random.default_rng(axes), 9
    begins = np.isin(np.arange(n), [0, 5]).astype(float)
    steps = np.where(begins == 1, 0.0, rng.uniform(0.02, 0.2, n))
    seen = (np.arange(n) != 3).astype(float)
    columns = [steps, begins, seen, *rng.standard_normal((axes, n))]
    if axes == 2:
        by = rng.uniform(-0.5, 0.5, (2, n))
        columns += [np.cos(by[0]), np.sin(by[0]), np.cos(by[1]), np.sin(by[1])]
    return np.column_stack(columns), np.array([*[0.7, 1.9][:axes], 0.3, 4.0, 2.0, 1.0])


def moved(row, q, axes):
    """Transition and covariance of a step, as the docstring of `poses` states them."""
    h, one, none = row[0], np.eye(axes), np.zeros((axes, axes))
    R, twice = one, one
    if axes == 2:
        R, twice = (np.array([[c, -s], [s, c]]) for c, s in (row[5:7], row[7:9]))
    F = np.block([[one, h * one, h**2 / 2 * twice], [none, one, h * R], [none, none, one]])
    W, D = R @ np.diag(q) @ R.T, np.diag(q)
    Q = np.block([
        [h**5 / 20 * W, h**4 / 8 * W, h**3 / 6 * R @ D],
        [h**4 / 8 * W, h**3 / 3 * W, h**2 / 2 * R @ D],
        [h**3 / 6 * D @ R.T, h**2 / 2 * D @ R.T, h * D],
    ])  # fmt: skip
    return F, Q


def conditioned(rows, variances, axes):
    """Mean and covariance of all states, log-likelihood, and each reading against all others, densely."""
    q, r, loose = variances[:axes], variances[axes], np.repeat(variances[axes + 1 :], axes)
    n, count = 3 * axes, len(rows)
    C = np.zeros((n * count, n * count))
    for k, row in enumerate(rows):
        part = slice(n * k, n * k + n)
        if row[1]:
            C[part, part] = np.diag(loose)
            continue
        F, Q = moved(row, q, axes)
        before = slice(n * k - n, n * k)
        C[part, : n * k] = F @ C[before, : n * k]
        C[: n * k, part] = C[part, : n * k].T
        C[part, part] = F @ C[before, before] @ F.T + Q
    at = [(k, axis) for k in range(count) if rows[k, 2] for axis in range(axes)]
    H = np.zeros((len(at), n * count))
    H[np.arange(len(at)), [n * k + axis for k, axis in at]] = 1.0
    y = np.array([rows[k, 3 + axis] for k, axis in at])
    S = H @ C @ H.T + r * np.eye(len(at))
    gain = C @ H.T @ np.linalg.inv(S)
    inverse = np.linalg.inv(S)
    against = np.zeros((count, axes))
    against[tuple(np.array(at).T)] = inverse @ y / np.sqrt(np.diag(inverse))
    likelihood = -0.5 * (np.linalg.slogdet(S)[1] + y @ inverse @ y)
    P = C - gain @ H @ C
    blocks = np.array([P[n * k : n * k + n, n * k : n * k + n] for k in range(count)])
    return (gain @ y).reshape(count, n), blocks, likelihood, against


@pytest.mark.parametrize("axes", [1, 2])
def test_it_is_the_gaussian_vector_conditioned_on_all_readings(axes):
    rows, variances = problem(axes)
    state, covariance, likelihood, against = conditioned(rows, variances, axes)
    found = smooth(rows, variances, axes)
    np.testing.assert_allclose(found[0], state, rtol=1e-8, atol=1e-9)
    np.testing.assert_allclose(found[1], covariance, rtol=1e-8, atol=1e-9)
    np.testing.assert_allclose(found[2], against, rtol=1e-8, atol=1e-9)
    np.testing.assert_allclose(log_likelihood(rows, variances, axes), likelihood, rtol=1e-10)
