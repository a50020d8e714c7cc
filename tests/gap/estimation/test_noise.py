"""Noise of known colour is found out, whitened, and cleared of spikes."""

import warnings

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.signal import lfilter

from greybox_id.gap.estimation.noise import colour, white_noise, without_spikes

AR = (1.5, -0.7)


def noise(rows, a=AR, sd=0.3, seed=0):
    """(rows, 1) of an autoregressive process that has gone on for long."""
    innovations = sd * np.random.default_rng(seed).standard_normal(rows + 500)
    return lfilter([1.0], [1.0, *np.negative(a)], innovations)[500:, None]


def everything(values):
    return np.ones(values.shape, dtype=bool), [slice(0, len(values))]


def test_coefficients_and_size_of_an_autoregressive_process_are_recovered():
    found = colour(noise(8000), *everything(noise(8000)))
    assert len(found.ar[0]) >= 2
    np.testing.assert_allclose(found.ar[0][:2], AR, atol=0.05)
    assert found.sd[0] == pytest.approx(0.3, rel=0.03)


@pytest.mark.parametrize("a", [AR, (0.95,), (0.3, 0.2, 0.1)])
def test_whitened_noise_is_white_and_of_unit_size(a):
    e = noise(6000, a, seed=1)
    white = colour(e, *everything(e)).white(e)[10:, 0]
    assert np.std(white) == pytest.approx(1.0, rel=0.01)
    for lag in range(1, 11):
        assert abs(np.mean(white[lag:] * white[:-lag])) < 4 / np.sqrt(len(white))


def test_white_noise_is_left_alone():
    e = 0.2 * np.random.default_rng(3).standard_normal((4000, 3))
    found = colour(e, *everything(e))
    assert [len(a) for a in found.ar] == [0, 0, 0]
    np.testing.assert_array_equal(found.stationary_sd, found.sd)


def test_the_stationary_sd_is_that_of_the_residuals():
    e = noise(60_000, seed=2)
    found = colour(e, *everything(e))
    assert found.stationary_sd[0] == pytest.approx(np.std(e), rel=0.03)
    assert found.stationary_sd[0] > 2.5 * found.sd[0]


def test_noise_that_never_forgets_has_a_bounded_sd():
    e = np.cumsum(np.random.default_rng(4).standard_normal((3000, 1)), axis=0)
    assert np.isfinite(colour(e, *everything(e)).stationary_sd[0])


def test_too_few_readings_tell_a_size_and_no_colour():
    e = noise(100)
    found = colour(e, *everything(e))
    assert len(found.ar[0]) == 0
    assert found.sd[0] == pytest.approx(np.sqrt(np.mean(e**2)))
    nothing = colour(e, np.zeros(e.shape, dtype=bool), [slice(0, 100)])
    assert nothing.readings == 0
    assert not np.any(nothing.white(e))


def test_rows_after_a_gap_and_at_the_start_of_a_run_are_not_used():
    e, good = noise(4000), np.ones((4000, 1), dtype=bool)
    good[1000:1003] = False
    e[1000:1003] = 1e6
    found = colour(e, good, [slice(0, 2500), slice(2500, 4000)])
    order = len(found.ar[0])
    expected = np.ones(4000, dtype=bool)
    for start in (0, 2500):
        expected[start : start + order] = False
    expected[1000 : 1003 + order] = False
    np.testing.assert_array_equal(found.usable[:, 0], expected)
    np.testing.assert_allclose(found.ar[0][:2], AR, atol=0.07)
    white = found.white(e)
    assert not np.any(white[~expected])
    assert np.std(white[expected]) == pytest.approx(1.0, rel=0.01)
    assert found.readings == np.sum(expected)


def test_runs_are_whitened_each_by_itself():
    e = noise(1500)
    both = colour(e, np.ones(e.shape, dtype=bool), [slice(0, 700), slice(700, 1500)])
    alone = np.concatenate([lfilter([1.0, *-both.ar[0]], [1.0], own, axis=0) for own in (e[:700], e[700:])])
    np.testing.assert_allclose(both.white(e), alone / both.sd[0] * both.usable)


def test_derivatives_are_whitened_as_residuals_are():
    e = noise(1500)
    found = colour(e, *everything(e))
    J = np.stack([e, 2 * e, np.ones_like(e)], axis=2)
    white = found.white(J)
    np.testing.assert_allclose(white[:, :, 1], 2 * found.white(e))
    np.testing.assert_allclose(white[:, :, 0], found.white(e))


@settings(max_examples=25)
@given(
    seed=st.integers(0, 10_000), places=st.sets(st.integers(2, 1997), max_size=12), slow=st.floats(0.0, 20.0),
    sd=st.floats(1e-3, 1e3),
)  # fmt: skip
def test_spikes_are_found_and_few_other_readings_with_them(seed, places, slow, sd):
    rng = np.random.default_rng(seed)
    e = sd * (rng.standard_normal(2000) + slow * np.sin(np.arange(2000) / 300))
    alone = [p for p in sorted(places) if not places & set(range(p - 3, p))]
    places = np.array(alone, dtype=int)
    e[places] += sd * 25 * rng.choice([-1, 1], len(places))
    good = without_spikes(e[:, None], np.ones((2000, 1), dtype=bool), [slice(0, 2000)])[:, 0]
    assert not np.any(good[places])
    assert np.sum(~good) - len(places) <= 0.002 * 2000


@pytest.mark.parametrize("place", [0, 399])
def test_a_spike_in_the_first_or_last_row_is_one(place):
    e = np.random.default_rng(0).standard_normal((400, 1))
    e[place] += 50
    assert np.flatnonzero(~without_spikes(e, *everything(e))[:, 0]).tolist() == [place]


def test_spikes_are_judged_channel_by_channel_and_run_by_run():
    rng = np.random.default_rng(0)
    e = np.column_stack([rng.standard_normal(600), 100 * rng.standard_normal(600)])
    e[300:] *= 50
    e[100, 0] += 30
    good = without_spikes(e, np.ones(e.shape, dtype=bool), [slice(0, 300), slice(300, 600)])
    assert np.argwhere(~good).tolist() == [[100, 0]]


def test_what_does_not_count_or_is_no_number_is_not_sound():
    e, counted = np.random.default_rng(0).standard_normal((400, 1)), np.ones((400, 1), dtype=bool)
    e[7], counted[9] = np.nan, False
    good = without_spikes(e, counted, [slice(0, 400)])
    assert np.flatnonzero(~good[:, 0]).tolist() == [7, 9]


@pytest.mark.parametrize("value", [0.0, 3.0])
def test_constant_residuals_are_sound(value):
    e = np.full((200, 1), value)
    assert np.all(without_spikes(e, *everything(e)))


def test_a_stretch_without_readings_is_no_reason_to_warn():
    e, counted = np.random.default_rng(0).standard_normal((400, 1)), np.ones((400, 1), dtype=bool)
    counted[:20] = counted[100:140] = False
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        without_spikes(e, counted, [slice(0, 400)])


def test_white_noise_scales_by_its_size():
    good = np.array([[True, True], [False, True], [True, True]])
    found = white_noise(np.array([2.0, 4.0]), good, [slice(0, 3)])
    np.testing.assert_array_equal(found.white(np.ones((3, 2))), [[0.5, 0.25], [0.0, 0.25], [0.5, 0.25]])
    np.testing.assert_array_equal(found.stationary_sd, [2.0, 4.0])
    assert found.readings == 5
