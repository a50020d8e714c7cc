"""A true cause has one magnitude everywhere; one that grows along a recording is seen to."""

from dataclasses import replace

import numpy as np
import pytest
from gap_cases import GivenBench, axis, candidate, search_on
from scipy.stats import kstest

from greybox_id.gap.estimation.constancy import discounted, spreads, unsteadiness
from greybox_id.gap.estimation.hypothesis import Start
from greybox_id.gap.estimation.refit import refit

ROWS, SD = 900, np.array([0.2, 0.5])


def examined(truth, seed=0, nuisances=()):
    """A hypothesis of a constant magnitude, where it is `truth` row by row; speed and time order the rows."""
    rng = np.random.default_rng(seed)
    X = rng.standard_normal((ROWS, 2, 2))
    speed = rng.uniform(5, 30, ROWS)
    truth = truth(speed) if callable(truth) else np.full(ROWS, truth)
    measured = X[:, :, 0] * truth[:, None] + SD * rng.standard_normal((ROWS, 2))
    search = search_on(GivenBench(lambda p: X @ p, measured, 2), SD, nuisances)
    base = search.at_means()
    (found,) = refit(search, [Start((candidate(0),), np.zeros(1), base.theta, base.linear)])
    orders = {"speed": speed, "time": np.arange(ROWS)}
    return {own.place: own for own in spreads(search, found, orders)}


def test_p_values_of_a_constant_magnitude_are_uniform():
    found = [own.p_value for seed in range(150) for own in examined(1.0, seed).values()]
    assert kstest(found, "uniform").pvalue > 1e-3
    assert np.mean(np.array(found) < 0.05) < 0.1
    assert np.mean([own.relative for own in examined(1.0).values()]) < 0.05


def test_tolerances_refitted_beside_it_do_not_make_small_p_values():
    found = [examined(1.0, seed, [axis(1, sd=0.3)])["speed"].p_value for seed in range(100)]
    assert np.mean(np.array(found) < 0.01) < 0.05


def test_a_magnitude_that_grows_with_speed_is_seen_along_speed():
    found = examined(lambda speed: 0.05 * speed)
    assert found["speed"].p_value < 1e-12
    assert found["speed"].p_value < found["time"].p_value
    low, middle, high = found["speed"].parts
    assert low < middle < high
    assert low == pytest.approx(0.05 * (5 + 25 / 6), rel=0.1)
    assert high == pytest.approx(0.05 * (5 + 25 * 5 / 6), rel=0.1)
    thirds = 0.05 * np.array([5 + 25 * share for share in (1 / 6, 1 / 2, 5 / 6)])
    assert found["speed"].relative == pytest.approx(np.std(thirds) / np.mean(thirds), rel=0.15)


def test_a_magnitude_that_drifts_is_seen_along_time():
    rng = np.random.default_rng(0)
    drift = rng.permutation(np.ones(ROWS)) * np.linspace(0.5, 1.5, ROWS)
    found = examined(lambda _: drift)
    assert found["time"].p_value < 1e-12
    assert found["time"].relative > 4 * found["speed"].relative


def test_a_magnitude_that_differs_from_channel_to_channel_is_seen_between_them():
    rng = np.random.default_rng(3)
    X = rng.standard_normal((ROWS, 2, 1))
    measured = X[:, :, 0] * [1.3, 0.6] + SD * rng.standard_normal((ROWS, 2))
    search = search_on(GivenBench(lambda p: X @ p, measured, 1), SD)
    base = search.at_means()
    (found,) = refit(search, [Start((candidate(0),), np.zeros(1), base.theta, base.linear)])
    time, channels = spreads(search, found, {"time": np.arange(ROWS)})
    assert channels.place == "between channels"
    assert channels.p_value < 1e-12
    np.testing.assert_allclose(channels.parts, [1.3, 0.6], atol=0.08)
    assert time.relative < 0.05


def test_a_channel_that_an_effect_hardly_acts_on_does_not_judge_it():
    rng = np.random.default_rng(4)
    X = rng.standard_normal((ROWS, 2, 1)) * [[1.0], [0.05]]  # of noise, .02
    measured = X[:, :, 0] * [1.0, 90.0] + SD * rng.standard_normal((ROWS, 2))
    search = search_on(GivenBench(lambda p: X @ p, measured, 1), SD)
    base = search.at_means()
    (fitted,) = refit(search, [Start((candidate(0),), np.zeros(1), base.theta, base.linear)])
    _, channels = spreads(search, fitted, {"time": np.arange(ROWS)})
    assert channels.parts == pytest.approx((1.0,), abs=0.2)
    assert channels.relative == 0.0


def test_what_changes_a_sensor_is_judged_by_its_own_readings_alone():
    """Through starts that follow a sensor, it acts on other channels, too."""
    rng = np.random.default_rng(4)
    X = rng.standard_normal((ROWS, 2, 1)) * [[1.0], [0.1]]
    measured = X[:, :, 0] * [1.0, 4.0] + SD * rng.standard_normal((ROWS, 2))
    search = search_on(GivenBench(lambda p: X @ p, measured, 1, channels=("v_y", "yaw_rate")), SD)
    base = search.at_means()
    motion = candidate(0)
    for cause, count in ((motion, 2), (replace(motion, reads=frozenset({"v_y"})), 1)):
        (fitted,) = refit(search, [Start((cause,), np.zeros(1), base.theta, base.linear)])
        _, channels = spreads(search, fitted, {"time": np.arange(ROWS)})
        assert len(channels.parts) == count
        assert (channels.p_value < 1e-12) == (count == 2)


def test_a_part_that_says_nothing_has_no_magnitude():
    rng = np.random.default_rng(0)
    X = rng.standard_normal((ROWS, 1, 1))
    X[300:] = 0
    search = search_on(GivenBench(lambda p: X @ p, X[:, :, 0], 1), SD[:1])
    base = search.at_means()
    (found,) = refit(search, [Start((candidate(0),), np.zeros(1), base.theta, base.linear)])
    own, _ = spreads(search, found, {"time": np.arange(ROWS)})
    assert own.p_value == pytest.approx(1.0, abs=0.01)
    assert np.nansum(own.parts) == pytest.approx(np.sum(np.isfinite(own.parts)), rel=1e-3)


def test_an_effect_that_is_not_excited_has_no_spread():
    X = np.zeros((ROWS, 1, 1))
    search = search_on(GivenBench(lambda p: X @ p, np.ones((ROWS, 1)), 1), SD[:1])
    base = search.at_means()
    (found,) = refit(search, [Start((candidate(0),), np.zeros(1), base.theta, base.linear)])
    assert spreads(search, found, {"time": np.arange(ROWS)}) == []


def unsteady(form, prior=1e3, seed=0):
    """Of a magnitude that is 1, and beyond it `form` of the speed, beside a tolerance alike."""
    rng = np.random.default_rng(seed)
    X = rng.standard_normal((ROWS, 2, 1)) * np.ones((1, 1, 2)) + [0.0, 0.1] * rng.standard_normal((ROWS, 2, 2))
    speed = rng.uniform(-1, 1, ROWS)
    measured = X[:, :, 0] * (1 + form * speed[:, None]) + SD * rng.standard_normal((ROWS, 2))
    search = search_on(GivenBench(lambda p: X @ p, measured, 2), SD, [axis(1, sd=prior)])
    base = search.at_means()
    (fitted,) = refit(search, [Start((candidate(0),), np.zeros(1), base.theta, base.linear)])
    return unsteadiness(search, fitted, {"along speed": speed, "along time": np.arange(ROWS)})


def test_a_constant_magnitude_is_steady():
    values = np.array([unsteady(0.0, seed=seed) for seed in range(60)])
    assert np.min(values) == 0.0
    assert np.median(values) < 1e-3


def test_the_variance_of_a_mean_is_that_between_parts_over_how_many_there_are():
    """Thirds of a uniform speed lie at -2/3, 0 and 2/3: of a form of .3 the magnitudes differ by sd .163."""
    values = [unsteady(0.3, seed=seed) for seed in range(10)]
    assert np.mean(values) == pytest.approx((0.3 * 2 / 3) ** 2 * (2 / 3) / 3, rel=0.2)


def test_an_unsteady_magnitude_gains_no_more_than_its_own_scatter_allows():
    assert discounted(20.0, 0.0) == 20.0
    assert discounted(20.0, 0.025) == pytest.approx(10.0)  # as much variance between parts as from noise
    assert discounted(np.inf, 0.0) > 1e11
    assert discounted(np.inf, 0.05) == pytest.approx(10.0)
    assert discounted(1e9, 0.05) == pytest.approx(10.0)  # half of m^2 over tau^2 / K
    assert discounted(20.0, np.inf) == pytest.approx(0.0, abs=1e-11)
    assert discounted(0.0, np.inf) == 0.0
