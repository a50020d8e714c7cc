"""Signs of something unknown: errors beyond what noise, and equations that are stated to be rough, may leave."""

import numpy as np
import pytest

from greybox_id.estimation.calibration import CAL
from greybox_id.gap.unknown import (
    Signs,
    beyond_what_may_be,
    unknown_probability,
    without_a_name,
)

ROWS, SD = 20_000, np.array([0.1, 0.02])
NAMES = ("v_y", "yaw_rate")
RNG = np.random.default_rng(5)
NOISE = SD * RNG.standard_normal((ROWS, 2))
Y = np.array([1.0, 1.2]) * np.sin(np.linspace(0, 200, ROWS))[:, None]
EVERY = np.ones((ROWS, 2), dtype=bool)


def beyond(e, good=EVERY, rough=True, alone=CAL.excess_rough):
    return beyond_what_may_be(e, Y, SD, good, NAMES, alone, rough)


@pytest.mark.parametrize("rough", [True, False])
def test_noise_alone_is_nothing(rough):
    assert beyond(NOISE, rough=rough) <= 0.0


def test_an_error_in_proportion_to_the_signal_is_a_gap_once_it_is_larger_than_equations_may_be_off():
    for times, gap in ((0.7, False), (1.3, True)):
        off = NOISE + np.column_stack([np.zeros(ROWS), times * CAL.of_signal * Y[:, 1]])
        assert (beyond(off) > 1) == gap


def test_v_y_may_be_off_by_more():
    off = NOISE + np.column_stack([0.9 * CAL.of_small_signal * Y[:, 0], np.zeros(ROWS)])
    assert beyond(off) < 1
    assert beyond(NOISE + 2 * (off - NOISE)) > 1


def test_of_exact_equations_all_channels_are_taken_together():
    louder = np.sqrt([1.2, 1.0]) * NOISE  # a fifth more in one of two channels is a tenth more altogether
    assert beyond(louder, rough=False, alone=0.03) == pytest.approx((0.1 - 4 / np.sqrt(ROWS)) / 0.03, abs=0.5)


def test_what_is_not_counted_does_not_count():
    off = NOISE.copy()
    off[:100] += 100.0
    assert beyond(off) > 1
    assert beyond(off, EVERY & (np.arange(ROWS) >= 100)[:, None]) <= 0.0
    assert beyond(off, np.zeros_like(EVERY)) == 0.0
    assert beyond(off, np.zeros_like(EVERY), rough=False) == 0.0


def test_a_name_that_leaves_nothing_is_the_cause():
    assert unknown_probability(Signs(0.0, 0.0, 0.0, 0.0, 0.0, "", 100.0, 1)) < 0.05


def test_what_a_name_leaves_beyond_roughness_speaks_for_something_unknown():
    own = [unknown_probability(Signs(0.3, 0.5, b, 0.1, 0.0, "", 100.0, 1)) for b in (0.5, 1.0, 2.0, 5.0)]
    assert own[0] == own[1] < own[2] < own[3]
    assert own[3] > 0.5


def test_effects_that_explain_only_together_what_none_explains_alone_stand_in_for_something():
    own = [Signs(0.03, 0.0, 0.5, 0.02, 0.0, "", 100.0, 2, together=own) for own in (0.7, 1.0, 1.1, 6.0)]
    odds = [unknown_probability(each) for each in own]
    assert odds[0] == odds[1] < odds[2] < 0.3
    assert odds[3] > 0.5


def test_where_noise_is_not_stated_more_may_be_unknown():
    own = Signs(0.0, 0.0, 0.0, 0.0, 0.0, "", 100.0, 3)
    assert unknown_probability(own, told=False) > 2 * unknown_probability(own)


def test_what_driving_still_explains_is_a_gap_of_rough_equations_where_it_gains_what_an_effect_must():
    own = Signs(0.3, 0.1, 0.5, 1.0, 0.0, "", 0.0, 0, over=100.0)
    assert without_a_name(own, 1.1 * CAL.cost_without_forces / 100.0, rough=True)
    assert not without_a_name(own, 0.9 * CAL.cost_without_forces / 100.0, rough=True)
    assert not without_a_name(own, 1.0, rough=False)


@pytest.mark.parametrize("rough", [True, False])
def test_errors_beyond_what_may_be_are_a_gap_where_noise_is_stated(rough):
    for beyond, gap in ((0.9, False), (1.1, True)):
        own = Signs(0.3, 0.1, beyond, 1.0, 0.0, "", 0.0, 0)
        assert without_a_name(own, 0.1, rough) == gap
        assert not without_a_name(own, 0.1, rough, told=False)
