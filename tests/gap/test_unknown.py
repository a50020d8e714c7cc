"""Signs of something unknown: errors beyond what noise, and equations that are stated to be rough, may leave."""

from dataclasses import replace

import numpy as np
import pytest
from gap_cases import GivenBench, axis, candidate, linear_bench, search_on, smooth_columns

from greybox_id.gap.estimation.calibration import CAL
from greybox_id.gap.unknown import (
    Signs,
    driving_gain,
    driving_gain_where_it_acts,
    excess_ratio,
    is_unnamed_gap,
    strained_shares,
    unknown_probability,
)

ROWS, SD = 20_000, np.array([0.1, 0.02])
NAMES = ("v_y", "yaw_rate")
RNG = np.random.default_rng(5)
NOISE = SD * RNG.standard_normal((ROWS, 2))
Y = np.array([1.0, 1.2]) * np.sin(np.linspace(0, 200, ROWS))[:, None]
EVERY = np.ones((ROWS, 2), dtype=bool)


def beyond(e, good=EVERY, inexact=True, alone=CAL.excess_inexact):
    return excess_ratio(e, Y, SD, good, NAMES, alone, inexact)


@pytest.mark.parametrize("rough", [True, False])
def test_noise_alone_is_nothing(rough):
    assert beyond(NOISE, inexact=rough) <= 0.0


def test_an_error_in_proportion_to_the_signal_is_a_gap_once_it_is_larger_than_equations_may_be_off():
    for times, gap in ((0.7, False), (1.3, True)):
        off = NOISE + np.column_stack([np.zeros(ROWS), times * CAL.curve_off * Y[:, 1]])
        assert (beyond(off) > 1) == gap


def test_v_y_may_be_off_by_more():
    off = NOISE + np.column_stack([0.9 * CAL.of_small_signal * Y[:, 0], np.zeros(ROWS)])
    assert beyond(off) < 1
    assert beyond(NOISE + 2 * (off - NOISE)) > 1


def test_of_exact_equations_all_channels_are_taken_together():
    louder = np.sqrt([1.2, 1.0]) * NOISE  # a fifth more in one of two channels is a tenth more altogether
    assert beyond(louder, inexact=False, alone=0.03) == pytest.approx((0.1 - 4 / np.sqrt(ROWS)) / 0.03, abs=0.5)


def test_what_is_not_counted_does_not_count():
    off = NOISE.copy()
    off[:100] += 100.0
    assert beyond(off) > 1
    assert beyond(off, EVERY & (np.arange(ROWS) >= 100)[:, None]) <= 0.0
    assert beyond(off, np.zeros_like(EVERY)) == 0.0
    assert beyond(off, np.zeros_like(EVERY), inexact=False) == 0.0


def test_a_name_that_leaves_nothing_is_the_cause():
    assert unknown_probability(Signs(0.0, 0.0, 0.0, 0.0, "", 1)) < 0.05


def test_what_a_name_leaves_beyond_roughness_speaks_for_something_unknown():
    own = [unknown_probability(Signs(0.3, b, 0.1, 0.0, "", 1)) for b in (0.5, 1.0, 2.0, 5.0)]
    assert own[0] == own[1] < own[2] < own[3]
    assert own[3] > 0.5


def test_effects_that_explain_only_together_what_none_explains_alone_stand_in_for_something():
    own = [Signs(0.03, 0.5, 0.02, 0.0, "", 2, together=own) for own in (0.7, 1.0, 1.1, 6.0)]
    odds = [unknown_probability(each) for each in own]
    assert odds[0] == odds[1] < odds[2] < 0.3
    assert odds[3] > 0.5


def test_where_noise_is_not_stated_more_may_be_unknown():
    own = Signs(0.0, 0.0, 0.0, 0.0, "", 3)
    assert unknown_probability(own, noise_stated=False) > 2 * unknown_probability(own)


def test_what_driving_still_explains_is_a_gap_of_rough_equations_where_it_gains_what_an_effect_must():
    own = Signs(0.3, 0.5, 1.0, 0.0, "", 0, over=100.0)
    assert is_unnamed_gap(own, 1.1 * CAL.cost_without_forces / 100.0, inexact=True)
    assert not is_unnamed_gap(own, 0.9 * CAL.cost_without_forces / 100.0, inexact=True)
    assert not is_unnamed_gap(own, 1.0, inexact=False)


@pytest.mark.parametrize("rough", [True, False])
def test_errors_beyond_what_may_be_are_a_gap_where_noise_is_stated(rough):
    for beyond, gap in ((0.9, False), (1.1, True)):
        own = Signs(0.3, beyond, 1.0, 0.0, "", 0)
        assert is_unnamed_gap(own, 0.1, rough) == gap
        assert not is_unnamed_gap(own, 0.1, rough, noise_stated=False)


# ---- what driving still explains of residuals

DRIVEN, SDS = 3000, np.array([0.1, 0.3])
TIME = 0.02 * np.arange(DRIVEN)


def wave(period, seed):
    rng = np.random.default_rng(seed)
    return sum(np.sin(2 * np.pi * TIME / period / f + rng.uniform(0, 6)) for f in (0.4, 1.0, 1.7))


SEEN = {"v_x": 15 + 3 * wave(20.0, 1), "a_y": 3 * wave(4.0, 2), "a_x": wave(9.0, 3), "yaw_rate": 0.2 * wave(4.0, 4),
        "steer": 0.05 * wave(4.0, 5)}  # fmt: skip
ORDINARY = {"v_x": SEEN["v_x"]}


def left(structure=0.0, seed=0, seen=None, rows=DRIVEN):
    """Gained over expected, in standard deviations of what noise alone gains."""
    noise = SDS * np.random.default_rng(seed).standard_normal((DRIVEN, 2))
    noise[:, 1] += structure
    bench = GivenBench(lambda p: np.zeros((DRIVEN, 2)), noise, 0, channels=("a_x", "a_y"))
    bench.counted[rows:] = False
    search = search_on(bench, SDS)
    found = search.at_means()
    found = found.__class__(found.candidates, found.m, found.theta, found.linear, 0.0, -noise, found.J)
    gained, expected = (np.sum(each) for each in driving_gain(search, found, SEEN if seen is None else seen))
    return gained, expected, (gained - expected) / np.sqrt(max(expected, 1e-9))


def test_white_noise_gains_what_is_expected():
    found = np.array([left(seed=seed) for seed in range(60)])
    assert np.mean(found[:, 0]) == pytest.approx(found[0, 1], rel=0.1)
    assert np.mean(found[:, 2] > 4.0) <= 0.02


def test_a_residual_that_goes_with_lateral_acceleration_times_speed_is_found():
    product = SEEN["a_y"] * (SEEN["v_x"] - np.mean(SEEN["v_x"]))
    structure = 0.2 * SDS[1] * product / np.std(product)
    gained, expected, off = left(structure)
    assert off > 10
    assert gained - expected == pytest.approx(0.5 * DRIVEN * 0.2**2, rel=0.3)  # all of what it explains


@pytest.mark.parametrize(
    "structure",
    [
        SEEN["a_x"] * SEEN["a_y"], np.sign(SEEN["a_y"]), np.abs(SEEN["a_x"]), TIME * SEEN["a_y"],
        np.roll(SEEN["a_y"], 20),
    ],
    ids=["product", "sign", "size", "drift", "late"],
)  # fmt: skip
def test_other_shapes_are_found(structure):
    assert left(0.2 * SDS[1] * structure / np.std(structure))[2] > 10


def test_what_is_left_counts_for_effects_that_act_there():
    noise = SDS * np.random.default_rng(0).standard_normal((DRIVEN, 2))
    structure = 0.2 * SDS[1] * SEEN["a_y"] * SEEN["a_x"]
    X = np.zeros((DRIVEN, 2, 2))
    X[:, 0, 0], X[:, 1, 1] = SEEN["a_x"], SEEN["a_y"]
    search = search_on(GivenBench(lambda p: np.zeros((DRIVEN, 2)), noise, 0, channels=("a_x", "a_y")), SDS)
    calm = replace(search.at_means(), candidates=(candidate(0), candidate(1)), m=np.zeros(2), e=-noise, J=X)
    assert driving_gain_where_it_acts(search, calm, SEEN) == {"effect_0": 0.0, "effect_1": 0.0}
    noise[:, 1] += structure
    loud = driving_gain_where_it_acts(search, replace(calm, e=-noise), SEEN)
    assert loud["effect_0"] == 0.0
    assert loud["effect_1"] == pytest.approx(0.5 * np.sum((structure / SDS[1]) ** 2), rel=0.3)


def test_what_has_nothing_to_do_with_driving_is_not_found():
    assert left(0.3 * SDS[1] * np.sin(2 * np.pi * 7 * TIME))[2] < 4


def test_few_readings_and_few_signals_tell_nothing_wrong():
    assert left(rows=60)[:2] == (0.0, 0.0)
    gained, expected, off = left(seen=ORDINARY)
    assert np.isfinite(gained)
    assert abs(off) < 4
    assert expected > 0


def test_what_is_strained_tells_of_what_acts_as_it_does():
    X = smooth_columns(4)
    X[:, :, 2] = X[:, :, 0] + 0.05 * X[:, :, 2]  # as the first tolerance does
    search = search_on(linear_bench(X, [0.0] * 4, SD), SD, (axis(0, sd=0.1), axis(1, sd=0.1)))
    both = (candidate(2), candidate(3))
    off = replace(search.at_means(), candidates=both, m=np.zeros(2), J=X[:, :, 2:])
    assert strained_shares(search, off) == {"effect_2": 0.0, "effect_3": 0.0}  # none is strained
    strained = strained_shares(search, replace(off, theta=np.array([0.4, 0.05])))
    assert strained["effect_2"] > 0.95
    assert strained["effect_3"] < 0.1
