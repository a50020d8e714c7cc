"""Delays: found to a fraction of a sample, with an uncertainty that holds."""

import numpy as np
import pytest
from simulated import clean, clean_runs, wander

from greybox_id.datasets.checks import Severity, check
from greybox_id.datasets.checks.delays import check_delays, estimate_lag, run_lags
from greybox_id.datasets.checks.pairs import pairs
from greybox_id.datasets.read import read
from greybox_id.datasets.recording import join


def pair_of(recording, right):
    (pair,) = [pair for pair in pairs(recording) if pair.right == right]
    return pair


@pytest.mark.parametrize("delay", [-2.3, -0.5, 0.0, 0.3, 1.5, 2.75])
def test_a_fractional_delay_is_recovered(delay):
    rng = np.random.default_rng(1)
    fine = wander(rng, 12_000, 0.005, 0.8)
    time, t_fine = 0.05 * np.arange(20, 1180), 0.005 * np.arange(12_000)
    right = np.interp(time, t_fine, fine) + 0.05 * rng.standard_normal(len(time))
    left = 3 * np.interp(time - 0.05 * delay, t_fine, fine) + 1 + 0.15 * rng.standard_normal(len(time))
    lag = estimate_lag(left, right, 0.05)
    assert lag.samples == pytest.approx(delay, abs=4 * lag.error)
    assert lag.error < 0.15
    assert lag.gain == pytest.approx(3, rel=0.05)


def test_the_uncertainty_of_a_delay_covers_under_correlated_noise():
    inside = 0
    for seed in range(60):
        rng = np.random.default_rng(seed)
        signal = wander(rng, 1500, 0.02, 0.7)
        noise = wander(rng, 1500, 0.02, 0.15)
        lag = estimate_lag(signal + 0.25 * noise, signal, 0.02)
        inside += abs(lag.samples) < 1.96 * lag.error
    assert inside >= 51  # 95 % of 60 is 57; 51 or fewer has a chance below 1 % if the intervals are right


def test_series_that_have_nothing_to_do_with_each_other_have_no_delay():
    rng = np.random.default_rng(2)
    assert estimate_lag(rng.standard_normal(1000), rng.standard_normal(1000), 0.05) is None
    assert estimate_lag(np.zeros(1000), rng.standard_normal(1000), 0.05) is None
    assert estimate_lag(np.ones(20), np.ones(20), 0.05) is None


def test_the_delay_of_one_run_that_differs_is_found_and_named():
    runs = [clean(seed, dt=0.05, seconds=40.0) for seed in range(4)]
    late = runs[2]
    shifted = np.interp(late.time - 0.1, late.time, late["yaw_rate"])
    runs[2] = late.with_signals(yaw_rate=shifted)
    findings = [f for f in check(join(runs, "mixed")) if f.kind == "run_delay"]
    assert {f.where.run for f in findings} == {3}
    assert all(f.severity is Severity.DISTRUST for f in findings)
    response = [f for f in findings if "steer" in f.sentence]
    assert response[0].value == pytest.approx(0.1, abs=0.03)


def test_a_delay_common_to_all_runs_is_a_warning():
    recording = clean_runs(5)
    late = np.concatenate(
        [np.interp(part.time - 0.03, part.time, part["a_x"]) for part in recording.each_run()]
    )  # fmt: skip
    findings = [f for f in check(recording.with_signals(a_x=late)) if f.kind == "delay" and f.where.channel == "a_x"]
    assert findings[0].severity is Severity.WARNING
    assert findings[0].value == pytest.approx(0.03, abs=4 * findings[0].uncertainty)


def test_the_roboracers_first_valid_run_lags_less_than_the_others(real_data):
    valid = read(real_data / "roboracer" / "valid.csv", "roboracer")
    lags = run_lags(valid, pair_of(valid, "v_x · steer"))
    assert lags[1].samples == pytest.approx(1.6, abs=0.2)
    for number in (2, 3, 4):
        assert 2.1 < lags[number].samples < 3.1
    findings = {f.where.run: f for f in check_delays(valid, pairs(valid)) if f.kind == "run_delay"}
    assert findings[1].severity is Severity.DISTRUST
    assert "ms" in findings[1].sentence


@pytest.mark.parametrize("file", ["train", "tire_set_1", "single_mass"])
def test_runs_of_the_other_roboracer_files_agree(real_data, file):
    recording = read(real_data / "roboracer" / f"{file}.csv", "roboracer")
    assert not [f for f in check_delays(recording, pairs(recording)) if f.kind == "run_delay"]
