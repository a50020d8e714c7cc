"""How far from a magic formula a tyre curve is believed to be."""

from dataclasses import replace

import numpy as np
from gap_cases import axis

from greybox_id.gap.form import OFF, PEAK, form_covariance

CURVE = {"B_f": 9.0, "C_f": 1.45, "E_f": 0.15}


def axes_of(means):
    return [replace(axis(k, null=mean, sd=0.01), name=name) for k, (name, mean) in enumerate(means.items())]


def curve(B, C, E, alpha):
    slip = B * alpha
    return np.sin(C * np.arctan(slip - E * (slip - np.arctan(slip))))


def test_curves_that_are_believed_stay_about_so_near_to_the_stated_one():
    covariance = form_covariance(axes_of(CURVE))
    at = np.array(list(CURVE.values()))
    slips = np.linspace(0, 5.0, 400) / CURVE["B_f"]
    peak = slips[np.argmax(curve(*at, slips))]
    slips = np.linspace(0, 1.2 * peak, 200)
    rng = np.random.default_rng(0)
    drawn = rng.multivariate_normal(at, 1e-4 * covariance, size=400)  # a hundredth as far: where it is linear
    off = np.array([np.sqrt(np.mean((curve(*own, slips) - curve(*at, slips)) ** 2)) for own in drawn]) * 100
    assert 0.6 * OFF < np.sqrt(np.mean(off**2)) < 1.05 * OFF  # what each may do alone is bounded as well


def test_slope_alone_is_held_though_slope_and_shape_together_are_not():
    covariance = form_covariance(axes_of(CURVE))
    relative = np.sqrt(covariance[0, 0]) / CURVE["B_f"]
    alone = 1 / np.sqrt(np.linalg.inv(covariance)[0, 0]) / CURVE["B_f"]
    assert 2 * alone < relative


def test_peaks_are_off_by_little_and_whatever_else_keeps_its_own_tolerance():
    covariance = form_covariance(axes_of({"m": 1500.0, **CURVE, "D_f": 0.8, "B_r": 9.0, "C_r": 1.4, "D_r": 0.8}))
    assert covariance[4, 4] == (PEAK * 0.8) ** 2
    assert np.all(covariance[4, [0, 1, 2, 3, 5, 6, 7]] == 0)
    assert np.all(covariance[[0, 5, 6, 7]] == 0)  # the rear has no E among them
    assert np.all(np.linalg.eigvalsh(covariance[1:4, 1:4]) > 0)
