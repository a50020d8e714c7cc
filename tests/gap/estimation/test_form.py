"""How far from a magic formula a tyre curve is believed to be."""

from dataclasses import replace

import numpy as np
import pytest
from gap_cases import axis

from greybox_id.gap.estimation.calibration import CAL
from greybox_id.gap.estimation.form import curve_priors

CURVE = {"B_f": 9.0, "C_f": 1.45, "E_f": 0.15}


def axes_of(means, sd=0.01):
    return [replace(axis(k, null=mean, sd=sd), name=name) for k, (name, mean) in enumerate(means.items())]


def curve(B, C, E, alpha):
    slip = B * alpha
    return np.sin(C * np.arctan(slip - E * (slip - np.arctan(slip))))


def test_curves_that_are_believed_stay_about_so_near_to_the_stated_one():
    _, mix = curve_priors(axes_of(CURVE))
    at = np.array(list(CURVE.values()))
    slips = np.linspace(0, 5.0, 400) / CURVE["B_f"]
    peak = slips[np.argmax(curve(*at, slips))]
    slips = np.linspace(0, 1.2 * peak, 200)
    drawn = at + 1e-2 * np.random.default_rng(0).standard_normal((400, 3)) @ mix.T  # where it is linear
    off = np.array([np.sqrt(np.mean((curve(*own, slips) - curve(*at, slips)) ** 2)) for own in drawn]) * 100
    rms = np.sqrt(np.mean(off**2))
    assert 0.5 * CAL.curve_off < rms < 1.05 * CAL.curve_off  # slope and each alone are bounded as well


def test_one_coordinate_is_the_slope_and_the_others_leave_it():
    axes, mix = curve_priors(axes_of(CURVE, sd=1e-6))
    slope = np.array([1 / CURVE["B_f"], 1 / CURVE["C_f"], 0.0]) @ mix
    assert slope[0] == pytest.approx(CAL.slope_off, rel=0.1)
    np.testing.assert_allclose(slope[1:], 0.0, atol=1e-9)
    assert [axis.sd for axis in axes] == [1.0, 1.0, 1.0]
    assert np.linalg.matrix_rank(mix) == 3


def test_a_stated_tolerance_of_the_slope_counts_beside_that_of_the_form():
    """B alone moves the slope: its tolerance adds to that of the slope, which any form keeps."""
    _, mix = curve_priors(
        [replace(own, sd=0.04 * CURVE["B_f"] if own.name == "B_f" else 1e-9) for own in axes_of(CURVE)]
    )
    slope = np.array([1 / CURVE["B_f"], 1 / CURVE["C_f"], 0.0]) @ mix
    assert slope[0] == pytest.approx(np.hypot(0.04, CAL.slope_off), rel=0.03)


def test_peaks_are_off_by_little_and_whatever_else_keeps_its_own_tolerance():
    given = axes_of({"m": 1500.0, **CURVE, "D_f": 0.8, "B_r": 9.0, "C_r": 1.4, "D_r": 0.8})
    axes, mix = curve_priors(given)
    assert axes[4].sd == pytest.approx(np.hypot(CAL.peak_off * 0.8, 0.01))
    assert [axes[k] for k in (0, 5, 6, 7)] == [given[k] for k in (0, 5, 6, 7)]  # the rear has no E among them
    np.testing.assert_array_equal(np.delete(mix, [1, 2, 3], axis=0), np.delete(np.eye(8), [1, 2, 3], axis=0))
