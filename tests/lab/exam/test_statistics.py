"""Intervals and calibration, beside values from elsewhere."""

from math import isnan

import numpy as np
import pytest

from greybox_lab.exam.measures import calibration_error, median, wilson


@pytest.mark.parametrize(
    ("hits", "of", "interval"),
    [(0, 10, (0.0, 0.27753)), (10, 10, (0.72247, 1.0)), (81, 263, (0.25528, 0.36621)), (15, 148, (0.06238, 0.16051))],
)
def test_wilson_intervals_are_those_of_newcombe(hits, of, interval):
    assert wilson(hits, of) == pytest.approx(interval, abs=1e-4)


def test_of_nothing_nothing_is_known():
    assert all(isnan(own) for own in wilson(0, 0))
    assert isnan(median([])[0])
    assert isnan(calibration_error([]))


def test_the_interval_of_a_median_covers_it():
    rng = np.random.default_rng(0)
    covered = []
    for _ in range(1000):
        _, (low, high) = median(rng.exponential(size=40).tolist())
        covered.append(low <= np.log(2) <= high)
    assert 0.94 < np.mean(covered) < 0.985


def test_honest_probabilities_are_calibrated_and_bold_ones_are_not():
    rng = np.random.default_rng(1)
    p = rng.random(20_000)
    assert calibration_error([(own, rng.random() < own) for own in p]) < 0.02
    assert calibration_error([(0.9, k % 2 == 0) for k in range(100)]) == pytest.approx(0.4)
    assert calibration_error([(1.0, True), (0.0, False)]) == 0.0
