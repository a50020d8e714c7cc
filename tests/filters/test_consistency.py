"""Does a filter know how wrong it is: numbers of innovations that are known to be right, and wrong."""

import numpy as np
import pytest
from filter_cases import LinearCase, filtered, needs_compiler

from greybox_id.filters.findings import bounds, consistency, widening, windowed


def judged(off, spread=None, size=50, gate=5.0):
    return consistency(off, np.ones(len(off)) if spread is None else spread, size, gate)


def test_white_innovations_of_the_size_expected_are_consistent():
    random = np.random.default_rng(0)
    spread = random.uniform(0.5, 4.0, 20_000)
    found = judged(np.sqrt(spread) * random.standard_normal(20_000), spread)
    assert found.count == 20_000
    assert found.nis == pytest.approx(1.0, abs=0.03)
    assert found.inside == pytest.approx(0.95, abs=0.03)
    assert found.correlation_bound == pytest.approx(1.96 / np.sqrt(20_000))
    assert abs(found.correlation) < found.correlation_bound
    assert found.gated == 0


def test_innovations_twice_as_large_have_a_nis_of_four():
    found = judged(2 * np.random.default_rng(0).standard_normal(20_000), gate=50.0)
    assert found.nis == pytest.approx(4.0, rel=0.03)
    assert found.inside < 0.01
    assert found.rms == pytest.approx(2.0, rel=0.02)
    assert widening([found]) == pytest.approx(2.0, rel=0.02)


def test_coloured_innovations_are_told_by_their_correlation():
    random = np.random.default_rng(0)
    off = np.zeros(20_000)
    for k in range(1, len(off)):
        off[k] = 0.3 * off[k - 1] + np.sqrt(1 - 0.3**2) * random.standard_normal()
    found = judged(off)
    assert found.correlation == pytest.approx(0.3, abs=0.03)
    assert found.correlation > found.correlation_bound


def test_what_lies_beyond_the_gate_is_counted_and_weighs_as_if_it_lay_there():
    off = np.random.default_rng(0).standard_normal(10_000)
    off[::1000] = 100.0
    found = judged(off)
    assert found.gated == 10
    assert found.nis == pytest.approx(1.0 + 10 * 25 / 10_000, abs=0.05)


def test_rows_without_a_reading_do_not_count():
    off = np.random.default_rng(0).standard_normal(4000)
    sparse = np.full(8000, np.nan)
    sparse[::2] = off
    assert judged(sparse) == judged(off)


@pytest.mark.parametrize("count", [0, 1])
def test_of_hardly_any_reading_nothing_is_said(count):
    found = judged(np.concatenate([np.ones(count), np.full(5, np.nan)]))
    assert found.count == count
    assert np.isnan([found.nis, found.inside, found.correlation, found.rms]).all()
    assert widening([found]) == 1.0


def test_bands_are_never_narrowed():
    assert widening([judged(0.1 * np.random.default_rng(0).standard_normal(1000))]) == 1.0


def test_windows_are_whole_and_their_bounds_hold_95_percent():
    np.testing.assert_array_equal(windowed(np.arange(7.0), 3), [1.0, 4.0])
    assert len(windowed(np.arange(2.0), 3)) == 0
    low, high = bounds(20)
    means = np.random.default_rng(0).chisquare(20, 20_000) / 20
    assert np.mean((means > low) & (means < high)) == pytest.approx(0.95, abs=0.005)


@needs_compiler
@pytest.mark.parametrize("kind", ["ekf", "ukf"])
def test_a_filter_with_the_true_noise_is_consistent(kind):
    """A linear model, simulated by its matrices."""
    case, random = LinearCase(0.8), np.random.default_rng(1)
    rows = 6000
    s = np.column_stack([np.full(rows, 0.05), random.standard_normal(rows), np.zeros(rows)])
    x, y = np.array([0.0, 0.0, 0.05, 0.0]), np.zeros((rows, 2))
    F, _, Q = case.step(0.05, 0.0)
    for k in range(rows):
        y[k] = case.H @ x + [0.0, 0.3 * s[k, 1]] + np.sqrt(np.diag(case.R)) * random.standard_normal(2)
        x = F @ x + case.step(0.05, s[k, 1])[1] + np.sqrt(np.diag(Q)) * random.standard_normal(4)
    start = np.array([[0.0, 0.0, 0.05, 0.0]]), np.diag([0.1, 0.1, 0.1, 0.4])[None] ** 2
    _, told = filtered(case.space, kind, *start, s, y, case.p, 5.0)
    for off, spread in zip(told.off.T, told.spread.T, strict=True):
        found = judged(off, spread, 40)
        assert found.nis == pytest.approx(1.0, abs=0.06)
        assert found.inside == pytest.approx(0.95, abs=0.05)
        assert abs(found.correlation) < 1.5 * found.correlation_bound
