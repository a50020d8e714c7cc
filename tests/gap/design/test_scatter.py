"""How far a fit scatters under model error, against all readings' covariance written out."""

import numpy as np
import pytest

from greybox_id.gap.design.scatter import _shaken, sandwich


def test_the_adjoint_is_the_covariance_of_all_readings_written_out():
    """Errors of three states under two forces that fade, read at every segment; two predictions start afresh."""
    rng = np.random.default_rng(3)
    S, n, forces, channels, q = 12, 3, 2, 2, 4
    A, B = 0.6 * rng.standard_normal((S, n, n)), rng.standard_normal((S, n, forces))
    C, D = rng.standard_normal((S, channels, n)), rng.standard_normal((S, channels, forces))
    fade = rng.uniform(0.3, 0.9, (S, forces))
    begins = np.isin(np.arange(S), [0, 7])
    pointer, channel = 2 * np.arange(S + 1), np.tile([0, 1], S)
    G = rng.standard_normal((2 * S, q))

    def readings(xi, shocks):
        """What one realisation of starts and shocks is read as."""
        z, found = np.zeros(n), []
        for k in range(S):
            z = np.zeros(n) if begins[k] else z
            found.append(C[k] @ z + D[k] @ xi)
            z = A[k] @ z + B[k] @ xi
            xi = fade[k] * xi + np.sqrt(1.0 - fade[k] ** 2) * shocks[k]
        return np.ravel(found)

    none = np.zeros((S, forces))
    parts = [readings(unit, none) for unit in np.eye(forces)]
    for k in range(S):
        for j in range(forces):
            one = none.copy()
            one[k, j] = 1.0
            parts.append(readings(np.zeros(forces), one))
    V = np.sum([np.outer(own, own) for own in parts], axis=0)
    assert _shaken(A, B, C, D, fade, begins, pointer, channel, G) == pytest.approx(G.T @ V @ G)


def test_scores_that_scatter_as_the_curvature_says_leave_the_information_as_it_is():
    J = np.random.default_rng(1).standard_normal((9, 3)) * [1.0, 1e3, 1e-4]
    H = J.T @ J
    assert sandwich(H, H) == pytest.approx(H)
    assert sandwich(H, 4.0 * H) == pytest.approx(0.25 * H)
    assert not np.any(sandwich(np.full((2, 2), np.nan), np.eye(2)))
