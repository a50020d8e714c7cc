"""Inputs before they are believed: glitches are found, said and bridged; nothing is changed silently."""

import numpy as np
import pytest

from greybox_id.datasets.recording import Recording, join
from greybox_id.filters.filtering import guarded

DT = 0.01


def recording(steer, time=None, **more):
    time = DT * np.arange(len(steer)) if time is None else time
    return Recording("lap", time, {"steer": np.asarray(steer, dtype=float), **more})


@pytest.fixture
def steer():
    time = DT * np.arange(2000)
    noise = 2e-4 * np.random.default_rng(0).standard_normal(2000)
    return 0.05 * np.sin(2 * np.pi * 0.4 * time) + noise


def test_clean_inputs_stay_as_they_are_and_nothing_is_said(steer):
    found, told = guarded(recording(steer), ("steer",))
    np.testing.assert_array_equal(found["steer"], steer)
    assert told == []


@pytest.mark.parametrize("rows", [(700,), (300, 1204, 1700)])
def test_spikes_of_one_sample_are_said_by_row_and_bridged(steer, rows):
    spiked = steer.copy()
    spiked[list(rows)] += 0.14
    found, (told,) = guarded(recording(spiked), ("steer",))
    others = np.setdiff1d(np.arange(2000), rows)
    np.testing.assert_array_equal(found["steer"][others], steer[others])
    for row in rows:
        assert found["steer"][row] == pytest.approx(0.5 * (steer[row - 1] + steer[row + 1]), rel=1e-9)
        assert f"t = {DT * row:.2f} s" in told
    assert ("row 700, counted from 0" if rows == (700,) else "rows 300, 1204 and 1700, counted from 0") in told
    assert told.endswith("These values are treated as missing and are bridged.")
    assert "Leave such rows out" not in told


def test_a_step_is_no_spike():
    steer = np.where(np.arange(2000) < 1000, 0.0, 0.1) + 2e-4 * np.random.default_rng(0).standard_normal(2000)
    found, told = guarded(recording(steer), ("steer",))
    np.testing.assert_array_equal(found["steer"], steer)
    assert told == []


def test_other_signals_are_not_looked_at(steer):
    yaw_rate = steer.copy()
    yaw_rate[900] = 3.0
    found, told = guarded(recording(steer, yaw_rate=yaw_rate), ("steer", "drive_force"))
    np.testing.assert_array_equal(found["yaw_rate"], yaw_rate)
    assert told == []


def test_short_gaps_are_bridged_by_straight_lines_and_said(steer):
    gap = steer.copy()
    gap[500:540] = np.nan
    found, told = guarded(recording(gap), ("steer",))
    np.testing.assert_allclose(found["steer"][499:541], np.linspace(steer[499], steer[540], 42), rtol=1e-9)
    np.testing.assert_array_equal(found["steer"][:500], steer[:500])
    assert told == ["steer: 40 missing values in gaps of up to 0.5 s were bridged."]


def test_long_gaps_and_ends_stay_missing_and_are_said(steer):
    gap = steer.copy()
    gap[500:600] = gap[1990:] = np.nan
    gap[800:803] = np.nan
    found, told = guarded(recording(gap), ("steer",))
    np.testing.assert_array_equal(np.flatnonzero(np.isnan(found["steer"])), [*range(500, 600), *range(1990, 2000)])
    assert told == [
        "steer: 3 missing values in gaps of up to 0.5 s were bridged.",
        "steer: 110 values are missing in longer gaps, after which the filter starts anew.",
    ]


def test_a_spike_is_found_also_where_a_long_gap_is_in_the_same_run(steer):
    gap = steer.copy()
    gap[500:600] = np.nan
    gap[1204] += 0.14
    found, told = guarded(recording(gap), ("steer",))
    assert any("t = 12.04 s" in sentence for sentence in told)
    assert found["steer"][1204] == pytest.approx(steer[1204], abs=2e-3)


def test_nothing_is_bridged_across_a_join(steer):
    a, b = steer.copy(), steer.copy()
    a[-5:] = np.nan
    both = join([recording(a), recording(b)], "both")
    found, told = guarded(both, ("steer",))
    assert np.isnan(found["steer"][1995:2000]).all()
    assert len(told) == 1


def test_an_input_that_is_missing_throughout_is_said(steer):
    found, told = guarded(recording(np.full(2000, np.nan), yaw_rate=steer), ("steer",))
    assert np.isnan(found["steer"]).all()
    assert told == ["steer: 2000 values are missing in longer gaps, after which the filter starts anew."]
