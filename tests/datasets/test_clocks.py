"""Signals on clocks of their own come onto one: exactly where they can, with an honest error where not."""

import numpy as np
import pytest

from greybox_id.base.errors import BadInput
from greybox_id.datasets.clocks import Readings, at_rate, on_one_clock
from greybox_id.datasets.recording import Recording


def joined(*groups, named=None, hold="zero"):
    return on_one_clock([Readings(name, np.asarray(t), s) for name, t, s in groups], named, hold, "lap.mcap")


def test_no_line_is_drawn_across_a_gap():
    fast = np.arange(0, 10, 0.01)
    slow = np.concatenate([np.arange(0, 3, 0.1), np.arange(6, 10, 0.1)])
    found = joined(("a", fast, {"v_x": fast}), ("b", slow, {"yaw_rate": slow}))
    missing = np.isnan(found.signals["yaw_rate"])
    inside = (found.time > 2.9 + 1e-9) & (found.time < 6 - 1e-9)
    np.testing.assert_array_equal(missing, inside)


def test_a_command_is_held_and_not_beyond_its_gap():
    fast = np.arange(0, 10, 0.01)
    sent = np.array([0.0, 0.1, 0.2, 0.3, 5.0, 5.1, 9.995])
    found = joined(("a", fast, {"v_x": fast}), ("b", sent, {"steer": np.arange(7.0)}))
    steer = found.signals["steer"]
    assert steer[5] == 0
    assert steer[10] == 1
    assert steer[30 + 49] == 3
    assert np.isnan(steer[30 + 52])


def test_an_irregular_clock_is_replaced_by_an_even_one():
    rng = np.random.default_rng(1)
    fast = np.arange(0, 10, 0.02) + rng.uniform(-0.006, 0.006, 500)
    slow = np.arange(0, 10, 0.05)
    found = joined(("a", fast, {"v_x": np.sin(fast)}), ("b", slow, {"yaw_rate": np.cos(slow)}))
    assert np.ptp(np.diff(found.time)) < 1e-9
    assert set(found.resampled) == {"v_x", "yaw_rate"}
    for name, truth in (("v_x", np.sin), ("yaw_rate", np.cos)):
        missed = np.abs(found.signals[name] - truth(found.time))
        assert missed.max() <= 1.2 * found.resampled[name].largest
        assert np.sqrt(np.mean(missed**2)) == pytest.approx(found.resampled[name].error, rel=0.3)


def test_noise_makes_the_error_larger_never_smaller():
    rng = np.random.default_rng(2)
    fast, slow = np.arange(0, 20, 0.01), np.arange(0, 20, 0.05)
    noisy = np.sin(slow) + 0.01 * rng.standard_normal(len(slow))
    found = joined(("a", fast, {"v_x": fast}), ("b", slow, {"yaw_rate": noisy}))
    smooth = joined(("a", fast, {"v_x": fast}), ("b", slow, {"yaw_rate": np.sin(slow)}))
    assert found.resampled["yaw_rate"].error > smooth.resampled["yaw_rate"].error


def test_what_a_held_command_loses_is_how_late_its_steps_come():
    rows = np.arange(0, 100, 0.1)
    sent = np.arange(0, 100, 0.13)
    steps = np.where(np.arange(len(sent)) % 2, 1.0, 0.0)
    found = joined(("a", rows, {"v_x": rows}), ("b", sent, {"steer": steps}))
    fine = np.arange(found.time[0], found.time[-1], 0.0005)
    true = steps[np.searchsorted(sent, fine + 1e-9, side="right") - 1]
    kept = found.signals["steer"][np.searchsorted(found.time, fine + 1e-9, side="right") - 1]
    assert np.sqrt(np.mean((true - kept) ** 2)) == pytest.approx(found.resampled["steer"].error, rel=0.05)


def test_disorder_and_doubled_stamps_are_told():
    fast = np.arange(0, 1, 0.01)
    t = np.array([0.0, 0.1, 0.3, 0.2, 0.2, 0.4, np.nan, 1.0])
    found = joined(("a", fast, {"v_x": fast}), ("b", t, {"yaw_rate": np.array([0, 1, 3, 9, 2, 4, 7, 10.0])}))
    assert found.signals["yaw_rate"][20] == 2
    assert any("2 of 8 readings" in note for note in found.notes)
    assert any("sorted" in note for note in found.notes)


def test_groups_that_never_meet_are_refused():
    with pytest.raises(BadInput, match="no time in common"):
        joined(("a", [0, 1, 2.0], {"v_x": np.zeros(3)}), ("b", [5, 6, 7.0], {"yaw_rate": np.zeros(3)}))
    with pytest.raises(BadInput, match="fewer than two"):
        joined(("a", [0, 1, 2.0], {"v_x": np.zeros(3)}), ("b", [1.0], {"yaw_rate": np.zeros(1)}))


@pytest.mark.parametrize("rate", [20.0, 50.0, 200.0])
def test_a_recording_is_resampled_evenly_without_delay(rate):
    t = np.concatenate([np.arange(0.0, 10.0, 0.01), np.arange(12.0, 20.0, 0.01)])
    wave = Recording("wave", t, {"yaw_rate": np.sin(t), "steer": np.floor(t + 1e-9)})
    again = at_rate(wave, rate)
    assert again.sample_time == pytest.approx(1 / rate)
    assert len(again.runs) == 2
    inner = np.concatenate([np.arange(a + 2, b - 2) for a, b in again.runs])
    assert np.allclose(again["yaw_rate"][inner], np.sin(again.time)[inner], atol=2e-3)
    assert np.array_equal(again["steer"], np.floor(again.time + 1e-6))


def test_what_is_faster_than_a_slower_rate_is_averaged():
    t = np.arange(0.0, 10.0, 0.01)
    hum = Recording("hum", t, {"a_y": np.sin(2 * np.pi * 19.0 * t)})
    assert np.std(at_rate(hum, 10.0)["a_y"]) < 0.2 * np.std(hum["a_y"])
