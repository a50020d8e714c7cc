"""Moving means, medians and maxima are SciPy's; a shifted cubic spline is SciPy's away from its ends."""

import numpy as np
import pytest
from scipy import interpolate, ndimage

from greybox_id.base.statistics import CubicSpline, median_of_five, moving_maximum, moving_mean, smoothed

SERIES = np.random.default_rng(0).standard_normal(300).cumsum()


@pytest.mark.parametrize("width", [1, 3, 21, 64 + 1])
def test_moving_means_and_maxima(width):
    assert moving_mean(SERIES, width) == pytest.approx(ndimage.uniform_filter1d(SERIES, width), abs=1e-12)
    assert np.array_equal(moving_maximum(SERIES, width), ndimage.maximum_filter1d(SERIES, width))


def test_smoothing_and_medians():
    assert smoothed(SERIES, 3.3) == pytest.approx(ndimage.gaussian_filter1d(SERIES, 3.3), abs=1e-12)
    assert np.array_equal(median_of_five(SERIES), ndimage.median_filter(SERIES, 5, mode="mirror"))


@pytest.mark.parametrize("by", [-7.3, -0.01, 0.0, 0.5, 9.99])
def test_a_shifted_spline(by):
    expected = interpolate.CubicSpline(np.arange(300), SERIES)(np.arange(20, 280) + by)
    found = CubicSpline(SERIES).shifted(20, 260, by)
    assert found[20:-20] == pytest.approx(expected[20:-20], abs=1e-11)
    assert found == pytest.approx(expected, abs=1e-5)  # the spline's ends are turned about, not SciPy's


def test_a_series_shorter_than_the_splines_memory():
    short = SERIES[:12]
    assert CubicSpline(short).shifted(2, 8, 0.0) == pytest.approx(short[2:10], abs=1e-5)
