"""Rows held stale and jitter of the sampling instant are told by how readings scatter."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from gap_cases import GivenBench
from memory_cases import FITTED
from toys import drive, tiny

from greybox_id.gap.estimation import variance
from greybox_id.gap.estimation.preparing import prepare
from greybox_id.gap.estimation.variance import (
    Scatter,
    dropped,
    jitter,
    jitters,
    order_gain,
    repeats,
    sole_jitter,
    without_stale_rows,
)
from greybox_id.models.effects import EFFECTS

DT, SD = 0.01, np.array([0.05, 0.1])


def signals(time, seed=0):
    """(n, 2), smooth."""
    rng = np.random.default_rng(seed)
    waves = [(5.0 / f, 2 * np.pi * f, *rng.uniform(0, 6, 2)) for f in (0.2, 0.35, 0.5)]
    return np.column_stack([sum(a * np.sin(w * time + phase[c]) for a, w, *phase in waves) for c in (0, 1)])


def scattered(tau, seed=0, rows=6000, lengths=None):
    """A bench whose instants scatter by tau, what its model predicts, and the residuals."""
    rng = np.random.default_rng(seed)
    time = DT * np.arange(rows)
    y = signals(time)
    measured = signals(time + tau * rng.standard_normal(rows)) + SD * rng.standard_normal((rows, 2))
    bench = GivenBench(lambda _: y, measured, 0, DT, lengths=lengths)
    return bench, y - measured, y


def found(tau, seed=0, sd=SD, **settings):
    bench, e, y = scattered(tau, seed, **settings)
    return jitter(bench, e, y, sd, bench.counted)


@pytest.mark.parametrize("tau", [0.002, 0.005, 0.015])
def test_the_size_of_jitter_is_recovered(tau):
    own = found(tau)
    assert own.magnitude == pytest.approx(tau, rel=0.1)
    assert own.gain > 20
    assert own.left == pytest.approx(1.0, rel=0.05)
    assert 0 < own.sd < 0.1 * tau


def test_its_sd_is_that_of_repeated_recordings():
    each = [found(0.003, seed) for seed in range(40)]
    scatter = np.std([own.magnitude for own in each])
    assert np.mean([own.sd for own in each]) == pytest.approx(scatter, rel=0.4)
    assert np.mean([own.magnitude for own in each]) == pytest.approx(0.003, rel=0.03)


def test_noise_that_is_larger_than_stated_is_no_jitter():
    own = found(0.0, sd=0.7 * SD)
    assert own is None or own.gain < 5


@pytest.mark.parametrize("share", [0.7, 1.4])
def test_the_size_of_jitter_does_not_depend_on_the_noise_that_is_stated(share):
    assert found(0.004, sd=share * SD).magnitude == pytest.approx(0.004, rel=0.1)


def test_none_is_found_in_white_noise():
    gains = [own.gain if own else 0.0 for own in (found(0.0, seed, rows=2000) for seed in range(150))]
    assert np.mean(np.array(gains) > 4.0) <= 0.03
    assert max(gains) < 10


def test_a_misfit_that_lasts_from_row_to_row_is_no_jitter():
    for tau, least, most in ((0.0, -1.0, 4.0), (0.004, 20.0, 1e9)):
        bench, e, y = scattered(tau)
        late = 0.01 * np.sin(np.linspace(0, 400, len(y)))[:, None]  # s, by which all channels are late, and early
        own = jitter(bench, e + late * np.gradient(y, DT, axis=0), y, SD, bench.counted)
        assert least < (own.gain if own else 0.0) < most
        assert tau == 0 or own.magnitude == pytest.approx(tau, rel=0.15)


def test_a_misfit_of_a_few_rows_is_no_jitter():
    bench, e, y = scattered(0.0)
    rng = np.random.default_rng(3)
    late = np.convolve(rng.standard_normal(len(y)), np.ones(3) / 3, mode="same")[:, None]  # alike for three rows
    own = jitter(bench, e + 0.01 * late * np.gradient(y, DT, axis=0), y, SD, bench.counted)
    assert own is None or own.gain == 0.0
    assert found(0.01).gain > 20


def test_one_outlier_where_much_changes_is_no_jitter():
    time = DT * np.arange(2000)
    y = 20.0 * np.tanh((time - 10.0) / 0.2)[:, None]
    bench = GivenBench(lambda _: y, y, 0, DT)
    gains = []
    for scale in (1.0, 8.0):
        e = SD[0] * np.random.default_rng(0).standard_normal(y.shape)
        e[1002] = scale * SD[0]
        own = jitter(bench, e, y, SD[:1], bench.counted)
        gains.append(own.gain if own else 0.0)
    assert max(gains) < 5


def test_channels_that_are_at_odds_about_the_time_tell_no_jitter():
    bench, e, y = scattered(0.0)
    late = 0.01 * np.random.default_rng(1).standard_normal(len(y))
    e[:, 0] += late * np.gradient(y[:, 0], DT)  # as pulses of a wheel make it: the other channel knows nothing of it
    assert jitter(bench, e, y, SD, bench.counted) is None
    e[:, 1] += late * np.gradient(y[:, 1], DT)
    assert jitter(bench, e, y, SD, bench.counted).magnitude == pytest.approx(0.01, rel=0.1)


def test_where_nothing_changes_there_is_nothing_to_tell():
    measured = np.random.default_rng(0).standard_normal((500, 2))
    bench = GivenBench(lambda _: 0 * measured, measured, 0, DT)
    assert jitter(bench, -measured, 0 * measured, SD, bench.counted) is None


def test_jitter_is_identifiable_in_several_runs_and_what_does_not_count_is_left_out():
    bench, e, y = scattered(0.005, lengths=[2000, 2, 3998])
    good = bench.counted.copy()
    good[3000:3500] = False
    e[3000:3500] = 50.0
    assert jitter(bench, e, y, SD, good).magnitude == pytest.approx(0.005, rel=0.1)


# ---- readings that jump with held commands


def tossed(size, early, shift=0.0, noise=1.0, seed=0, rows=4000):
    """Jumps of a size, in noise sds, and residuals: some rows came early, of all jumps the model has a share."""
    rng = np.random.default_rng(seed)
    jumps = size * rng.standard_normal((rows, 2))
    coins = (rng.random(rows) < early)[:, None]
    return jumps, noise * rng.standard_normal((rows, 2)) + jumps * (shift - coins)


@pytest.mark.parametrize("shift", [0.0, 0.4, 0.5])
@pytest.mark.parametrize("noise", [0.7, 1.0, 1.5])
def test_readings_that_come_early_or_late_by_chance_are_told_whatever_the_model_takes_up(shift, noise):
    jumps, z = tossed(0.6 * noise, 0.5, shift, noise)
    assert order_gain(jumps, z) > 10


@pytest.mark.parametrize(("early", "shift"), [(0.0, 0.0), (1.0, 0.0), (0.0, 0.5), (1.0, 0.3)])
def test_readings_that_all_come_early_or_all_late_are_none(early, shift):
    gains = [order_gain(*tossed(0.6, early, shift, seed=seed)) for seed in range(20)]
    assert max(gains) < 2.0


def test_where_no_reading_jumps_no_coin_falls():
    assert order_gain(np.zeros((500, 2)), np.ones((500, 2))) == 0.0
    assert order_gain(*tossed(2.0, 0.5, rows=10)) == 0.0


def test_a_coin_that_falls_is_jitter_though_rates_do_not_tell():
    jumps, z = tossed(2.0, 0.5)
    still = np.zeros_like(z)
    bench = GivenBench(lambda _: still, -z * SD, 0, DT)
    slow = still + 1e-6 * np.arange(len(z))[:, None]
    own = jitter(bench, z * SD, slow, SD, bench.counted, jumps * SD)
    assert own.gain > 100
    assert own.left < np.mean(z**2)
    assert own.magnitude - 2 * own.sd <= 0.002


# ---- rows held stale


def held(share, rows=3000, seed=0, **settings):
    rng = np.random.default_rng(seed)
    stale = rng.random(rows) < share
    stale[0] = False
    last = np.maximum.accumulate(np.where(stale, 0, np.arange(rows)))
    measured = rng.standard_normal((rows, 3))[last]
    return GivenBench(lambda _: measured, measured, 0, DT, **settings), stale


@pytest.mark.parametrize("share", [0.01, 0.2])
def test_exact_repeats_are_counted(share):
    bench, stale = held(share)
    rows = repeats(bench)
    np.testing.assert_array_equal(rows, stale)
    own = dropped(rows)
    assert own.magnitude == np.mean(stale)
    assert abs(own.magnitude - share) < 3 * own.sd


def test_rows_held_stale_are_no_readings():
    bench, stale = held(0.1)
    np.testing.assert_array_equal(without_stale_rows(bench), bench.counted & ~stale[:, None])
    bench, _ = held(0.0)
    np.testing.assert_array_equal(without_stale_rows(bench), bench.counted)


def test_a_run_s_first_row_repeats_nothing():
    bench, stale = held(0.1, lengths=[1000, 2000])
    bench.measured[1000] = bench.measured[999]
    rows = repeats(bench)
    assert not rows[1000]
    np.testing.assert_array_equal(np.delete(rows, [1000, 1001]), np.delete(stale, [1000, 1001]))


def test_noise_does_not_repeat_itself_and_few_repeats_are_an_accident():
    bench, _ = held(0.0)
    assert not np.any(repeats(bench))
    assert dropped(repeats(bench)) is None
    rows = np.zeros(1000, dtype=bool)
    rows[[3, 500]] = True
    assert dropped(rows) is None


def test_one_channel_that_repeats_is_quantised_and_not_held():
    bench, _ = held(0.0)
    bench.measured[:, 0] = np.round(bench.measured[:, 0])
    assert not np.any(repeats(bench))
    bench.measured[:, 1:] = np.nan
    assert not np.any(repeats(bench))


def test_a_vehicle_at_rest_that_reads_zeros_is_not_held():
    bench, _ = held(0.0)
    bench.measured[:200] = 0.0
    assert not np.any(repeats(bench))


def test_a_channel_without_readings_is_no_witness():
    bench, stale = held(0.1)
    bench.measured[:, 2] = np.nan
    np.testing.assert_array_equal(repeats(bench), stale)


def test_scatter_is_not_looked_for_under_a_map_with_memory():
    model, recordings = tiny("msnn_full"), [drive(60)]
    bench = prepare(model, recordings, EFFECTS, FITTED).bench(recordings)
    bench.measured[10:50] = bench.measured[9]
    assert not np.any(repeats(bench))
    e = bench.simulate(bench.model.values[None])[0] - bench.measured
    assert jitter(bench, e, e + bench.measured, np.ones(2), bench.counted) is None


def test_jitter_of_some_channels_takes_no_effect_s_place_that_others_tell():
    rng, n = np.random.default_rng(0), 6000
    time, sd = 0.01 * np.arange(n), np.array([0.05, 0.05, 0.1])
    y = np.column_stack([5 * np.sin(w * time) for w in (2.0, 3.1, 2.5)])
    rates = np.column_stack([5 * w * np.cos(w * time) for w in (2.0, 3.1)])
    e = sd * rng.standard_normal((n, 3))
    e[:, :2] += 0.004 * rng.standard_normal((n, 1)) * rates
    bench = GivenBench(lambda _: y, y - e, 0, 0.01, lengths=[n])
    bench.model.states = [SimpleNamespace(name=own) for own in bench.channels[:2]]
    bench.runs[0].held = np.ones(1, dtype=bool)  # the third channel may jump with commands
    lever = e.copy()
    lever[:, 2] += np.sin(time)  # ten times its noise
    asked = (sd, bench.counted, np.zeros((n, 3)))
    assert jitters(bench, e, e, *asked)
    assert not jitters(bench, lever, e, *asked)
    known = (sd, bench.counted, None)
    both = e.copy()
    both[:, :2] += 0.3 * np.sin(0.7 * time)[:, None]  # something that jitter does not explain, where jitter acts
    assert not jitters(bench, both, e, *known)
    assert jitters(bench, e + 0.03 * (both - e), e, *known)  # next to nothing beside it


def test_jitter_that_leaves_more_than_noise_is_none(monkeypatch):
    own, asked = Scatter(0.003, 0.0001, 60.0, 1.2), (None,) * 6
    for left, sole in ((1.2, True), (2.2, False)):  # errors of a model that lasts a row or two
        monkeypatch.setattr(variance, "jitter", lambda *_, left=left: replace(own, left=left))
        assert (sole_jitter(*asked) is not None) == sole
    monkeypatch.setattr(variance, "jitter", lambda *_: None)
    assert sole_jitter(*asked) is None
