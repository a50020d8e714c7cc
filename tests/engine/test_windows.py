"""Sliding windows against naive loops."""

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from greybox_id.engine.series import weighted_windows, windows

sizes = st.tuples(st.integers(1, 130), st.integers(1, 5), st.integers(1, 25), st.integers(0, 999)).filter(
    lambda s: s[0] >= s[2]
)


@given(sizes, st.booleans())
@settings(max_examples=80, deadline=None)
def test_weighted_windows_are_the_naive_loop(size, strided):
    rows, columns, length, seed = size
    rng = np.random.default_rng(seed)
    values = rng.standard_normal((rows, 2 * columns))[:, ::2] if strided else rng.standard_normal((rows, columns))
    weights = rng.standard_normal(length)
    naive = [
        [sum(weights[k] * values[row + k, column] for k in range(length)) for column in range(columns)]
        for row in range(rows - length + 1)
    ]
    np.testing.assert_allclose(weighted_windows(values, weights), naive, atol=1e-12)


@given(sizes)
@settings(max_examples=30, deadline=None)
def test_windows_are_oldest_first(size):
    rows, columns, length, _ = size
    values = np.arange(rows * columns, dtype=float).reshape(rows, columns)
    found = windows(values, length)
    assert found.shape == (rows - length + 1, columns, length)
    for row in range(rows - length + 1):
        assert np.array_equal(found[row], values[row : row + length].T)
