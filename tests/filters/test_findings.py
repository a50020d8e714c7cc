"""Sentences on what a track cannot be trusted for, out of given histories."""

import numpy as np
import pytest
from driven import driven

from greybox_id.engine.motion.runs import MotionRun
from greybox_id.errors import BadInput
from greybox_id.filters.findings import (
    distrusted_data,
    lost,
    must_be_finite,
    only_over_mass,
    told_rows,
    too_quiet,
    untold,
)
from greybox_id.filters.kernel import blank_history
from greybox_id.filters.laid import LaidRun
from greybox_id.filters.state_space import Tracked
from greybox_id.models.registry import build

ROWS = 1000


@pytest.fixture
def run():
    time = 10.0 + 0.02 * np.arange(ROWS)
    own = MotionRun("lap", time, np.zeros((ROWS, 1)), np.ones(1, dtype=bool), np.zeros((ROWS, 1)), range(ROWS))
    return LaidRun(own, np.zeros((ROWS, 3)), np.zeros((ROWS, 1)), np.arange(ROWS))


@pytest.fixture
def history():
    found = blank_history(ROWS, 2, 1, "filtered")
    found.off[:] = np.random.default_rng(0).standard_normal((ROWS, 1))
    found.spread[:] = 1.0
    return found


def test_a_filter_that_diverges_is_a_sentence_that_says_when(run, history):
    must_be_finite([history], [run], "lap")
    history.filtered[400:] = np.nan
    with pytest.raises(BadInput, match=r"lap: the filter diverges at t = 18.00 s"):
        must_be_finite([history], [run], "lap")


def test_stretches_in_which_readings_are_far_off_are_said(run, history):
    assert lost([run], [history], {"yaw_rate": 0}) == []
    history.off[300:500] *= 10
    (said,) = lost([run], [history], {"yaw_rate": 0})
    assert said.startswith("yaw_rate: for 4 s, first at t = 16.0 s, readings are far from what the filter expects")


def test_a_single_glitch_is_no_stretch(run, history):
    history.off[350] = 1000.0
    assert lost([run], [history], {"yaw_rate": 0}) == []


def test_a_number_is_told_where_it_is_known_twice_as_well_as_before():
    values, sds = np.array([1.0, 1.0, 4.0]), np.array([0.11, 0.09, 0.3])
    np.testing.assert_array_equal(told_rows(Tracked("k", "1", 1.0, 0.2, True), values, sds), [False, True, True])
    np.testing.assert_array_equal(told_rows(Tracked("k", "1", 1.0, 0.2, False), values, sds), [False, True, False])


def test_where_a_stiffness_is_open_is_said_by_the_slip_angle():
    told, slip = np.arange(100) >= 40, np.linspace(0.0, 0.1, 100)
    said = untold("C_alpha_f", told, slip, "F_yf")
    assert said.startswith(
        "C_alpha_f: in 40 % of the rows the recording does not inform it, mostly where the slip angle"
    )
    assert "below 2.0°" in said
    assert said.endswith("The lateral force F_yf is identifiable there, too.")
    assert untold("C_alpha_f", np.ones(100, dtype=bool), slip, "F_yf") == ""


def test_what_is_calibrated_on_motion_is_said_to_be_over_mass():
    model = build("single_track")
    (said,) = only_over_mass(model)
    assert "C_alpha_f / m, C_alpha_r / m, I_z / m" in said
    assert "m = 1450 kg was held" in said
    assert only_over_mass(build("kinematic")) == []


def test_noise_below_what_a_recording_resolves_is_said():
    (said,) = too_quiet({"noise_yaw_rate": 2.5e-5, "noise_a_y": 0.1}, {"yaw_rate": 1e-3, "a_y": 0.02})
    assert said.startswith("noise_yaw_rate = 2.5e-05 rad/s is less than the recording resolves (0.001")


def test_what_the_checks_distrust_is_said_of_signals_that_are_used():
    recording = driven("lateral", runs=1, seconds=40.0)
    wrong = recording.with_signals(a_y=recording["a_y"] / 9.81)
    said = distrusted_data(wrong, {"a_y", "yaw_rate"})
    assert any(own.startswith("Data check: a_y is") for own in said)
    assert distrusted_data(wrong, {"yaw_rate"}) == []
    assert distrusted_data(recording, {"a_y", "yaw_rate"}) == []
