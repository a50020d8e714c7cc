"""Nothing is said against clean recordings, and nothing a recording can hold ends in a traceback."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from simulated import clean, clean_runs

from greybox_id.datasets.checks import Severity, check, distrusted
from greybox_id.datasets.recording import Recording

VEHICLES = {
    "car at 50 Hz": {},
    "model car at 20 Hz": {"dt": 0.05, "speed": 1.8, "wheelbase": 0.32, "seconds": 30.0},
    "car at 200 Hz": {"dt": 0.005, "seconds": 20.0},
    "noisy car": {"noise": 4.0},
    "no noise at all": {"noise": 0.0},
    "short": {"dt": 0.05, "seconds": 12.0},
}
ACCUSATIONS = {"sign", "unit", "outlier", "dead", "held", "clipped", "run_delay", "duplicate", "missing", "irregular"}


@pytest.mark.parametrize("vehicle", VEHICLES)
@pytest.mark.parametrize("seed", range(3))
def test_clean_recordings_are_trusted(vehicle, seed):
    for recording in (clean(seed, **VEHICLES[vehicle]), clean_runs(seed, runs=3, **VEHICLES[vehicle])):
        findings = check(recording)
        assert not distrusted(findings), findings
        assert not {finding.kind for finding in findings} & ACCUSATIONS


@pytest.mark.examination
@pytest.mark.slow
@pytest.mark.parametrize("vehicle", VEHICLES)
def test_false_alarms_are_rare_over_many_seeds(vehicle):
    findings = [check(clean_runs(seed, **VEHICLES[vehicle])) for seed in range(100, 140)]
    assert sum(distrusted(found) for found in findings) <= 1
    assert not {finding.kind for found in findings for finding in found} & (ACCUSATIONS - {"run_delay"})


def test_findings_come_gravest_first_and_speak_in_sentences():
    recording = clean_runs(1)
    findings = check(recording.with_signals(yaw_rate=-recording["yaw_rate"], a_x=recording["a_x"] * np.nan))
    order = [list(Severity).index(finding.severity) for finding in findings]
    assert order == sorted(order, reverse=True)
    assert all(finding.sentence.endswith(".") for finding in findings)


VALUES = st.one_of(st.floats(-10, 10), st.sampled_from([0.0, float("nan"), 1e30, -1e30, 5.0]))


@settings(max_examples=60)
@given(st.data())
def test_no_recording_ends_in_a_traceback(data):
    n = data.draw(st.sampled_from([1, 2, 3, 5, 30, 80]))
    names = data.draw(
        st.sets(st.sampled_from(["v_x", "v_y", "yaw_rate", "steer", "a_x", "a_y", "yaw", "x", "y", "copy"]))
    )
    rng = np.random.default_rng(data.draw(st.integers(0, 99)))
    signals = {}
    for name in names:
        signals[name] = rng.standard_normal(n) * data.draw(st.sampled_from([0.0, 1.0, 1e-200, 1e30]))
        signals[name][data.draw(st.integers(0, n - 1))] = data.draw(VALUES)
    time = 0.05 * np.arange(n)
    time[data.draw(st.integers(0, n - 1))] = data.draw(VALUES)
    for finding in check(Recording("odd", time, signals, extra_units={"copy": "m/s"})):
        assert finding.sentence
