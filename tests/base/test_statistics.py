"""Spectra, correlations, how long these last, and intervals by drawing blocks."""

import numpy as np
import pytest
from linear_problem import coloured
from scipy import signal

from greybox_id.base.statistics import (
    correlation,
    correlation_time,
    detrended,
    resampled,
    robust_sd,
    welch,
    white_noise_sd,
)


@pytest.mark.parametrize("rho", [0.0, 0.5, 0.8, 0.9])
def test_the_correlation_time_is_the_one_of_the_noise(rho):
    noise = coloured(np.random.default_rng(4), (2, 50_000), rho).T
    assert correlation_time(noise) == pytest.approx((1 + rho) / (1 - rho), rel=0.15)


def test_a_sensor_read_every_fifth_row_is_correlated_over_five_times_as_many_rows():
    noise = coloured(np.random.default_rng(4), 10_000, 0.8)[:, None]
    sparse = np.zeros((50_000, 1))
    sparse[::5] = noise
    assert correlation_time(sparse) == pytest.approx(5 * correlation_time(noise), rel=0.01)


@pytest.mark.parametrize("residuals", [np.zeros((50, 2)), np.ones((1, 1)), np.empty((0, 1))])
def test_residuals_too_few_or_zero_count_as_independent(residuals):
    assert correlation_time(residuals) == 1.0


@pytest.mark.parametrize("length", [64, 129])
def test_a_spectrum_holds_the_signals_power_at_its_frequency(length):
    time = np.arange(4000) / 20.0
    frequency, density = welch(3.0 + np.sqrt(2.0) * np.sin(2 * np.pi * 2.5 * time), 20.0, length)
    assert frequency[np.argmax(density)] == pytest.approx(2.5, abs=20.0 / length)
    assert np.sum(density) * (frequency[1] - frequency[0]) == pytest.approx(1.0, rel=0.02)  # of a sine of unit power
    assert density[0] < 1e-3 * density.max()  # the mean is none of it


def test_correlations_tell_what_comes_first():
    rng = np.random.default_rng(1)
    drive = [rng.standard_normal(400) for _ in range(3)]
    late = [np.roll(own, 5) for own in drive]
    found = correlation(list(zip(late, drive, strict=True)), 20)
    assert int(np.argmax(found)) == 5
    assert found[5] > 0.95
    assert correlation([(own, own) for own in drive], 3)[0] == pytest.approx(1.0)


def test_an_interval_of_a_mean_is_as_wide_as_its_standard_error_tells():
    values = np.random.default_rng(2).standard_normal(300)
    sums = np.column_stack([values, np.ones(300)])
    low, high = resampled(sums, lambda total: total[0] / total[1], 2000)
    assert high - low == pytest.approx(2 * 1.96 * np.std(values) / np.sqrt(300), rel=0.05)
    assert low < np.mean(values) < high
    assert resampled(sums, lambda total: total / total[1], 10).shape == (2, 2)


@pytest.mark.parametrize("held", [False, True])
def test_white_noise_is_told_apart_from_what_moves(held):
    rng = np.random.default_rng(3)
    moving = np.sin(np.linspace(0, 20, 4001)) + 0.05 * rng.normal(size=4001)
    own = np.repeat(moving, 3)[:, None] if held else moving[:, None]
    parts = [own[:2000, 0], np.where(rng.random(len(own) - 2000) < 0.05, np.nan, own[2000:, 0])]
    if not held:
        assert white_noise_sd(parts) == pytest.approx(0.05, rel=0.1)
    else:  # steps of updates are no bends of noise alone, but held rows are not taken for silence
        assert white_noise_sd(parts) == 0.0 or white_noise_sd(parts) < white_noise_sd(parts, held=True)
        assert white_noise_sd(parts, held=True) > 0.02
    assert np.isnan(white_noise_sd([np.zeros(2)]))


def test_a_robust_standard_deviation_hardly_moves_with_outliers():
    values = np.random.default_rng(4).normal(size=20_000)
    values[:200] = 1e6
    assert robust_sd(values) == pytest.approx(1.0, abs=0.03)


@pytest.mark.parametrize("length", [2, 17, 40])
def test_spectra_and_trends_are_those_of_scipy(length):
    values = 3.0 + np.random.default_rng(2).standard_normal(40).cumsum()
    frequency, density = signal.welch(values, 20.0, "hamming", length, length // 2, detrend="constant")
    np.testing.assert_allclose(welch(values, 20.0, length), [frequency, density], rtol=1e-12, atol=1e-12)
    np.testing.assert_allclose(detrended(values), signal.detrend(values), atol=1e-12)
