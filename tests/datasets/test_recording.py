"""A recording: its runs, its rows, its mirror image, and what it refuses."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from toys import drive, joined, without

from greybox_id.base.errors import BadInput
from greybox_id.base.signals import SIGNALS
from greybox_id.datasets.recording import Recording, join, split_runs

lengths = st.lists(st.integers(1, 12), min_size=1, max_size=5)


@given(lengths)
def test_runs_cover_all_rows_in_order(rows):
    recording = joined(*rows)
    assert recording.runs[0][0] == 0
    assert recording.runs[-1][1] == len(recording)
    assert all(a[1] == b[0] for a, b in zip(recording.runs[:-1], recording.runs[1:], strict=True))
    assert [b - a for a, b in recording.runs] == rows


@given(st.lists(st.integers(3, 12), min_size=1, max_size=5))
def test_runs_are_found_again_where_time_restarts(rows):
    recording = joined(*rows)
    assert split_runs(recording.time) == recording.runs


@pytest.mark.parametrize(
    ("time", "runs"),
    [
        ([], ()),
        ([3.0], ((0, 1),)),
        ([0.0, 0.1, 0.2], ((0, 3),)),
        ([0.0, 0.1, 0.2, 0.5, 0.6], ((0, 3), (3, 5))),  # jump
        ([0.0, 0.1, 0.2, 0.2, 0.3], ((0, 3), (3, 5))),  # standing still
        ([0.0, 0.1, 0.2, 0.0, 0.1], ((0, 3), (3, 5))),  # restart
        ([0.0, 0.1, 0.24, 0.3], ((0, 4),)),  # jitter
        ([0.0, 0.1, np.nan, 0.3, 0.4], ((0, 2), (2, 3), (3, 5))),
        ([2.0, 1.0, 0.0], ((0, 1), (1, 2), (2, 3))),
    ],
)
def test_a_run_ends_where_time_does_not_run_on(time, runs):
    assert split_runs(np.array(time)) == runs


def test_sample_time_and_duration_do_not_see_joins():
    recording = joined(20, 30)
    assert recording.sample_time == pytest.approx(0.05)
    assert recording.duration == pytest.approx(0.05 * (19 + 29))


@given(lengths, st.integers(0, 60), st.integers(0, 60))
def test_rows_keep_the_joins_inside_them(rows, a, b):
    recording = joined(*rows)
    start, stop = sorted((min(a, len(recording)), min(b, len(recording))))
    part = recording.rows(start, stop)
    assert len(part) == stop - start
    joins = {j - start for j, _ in recording.runs if start < j < stop}
    assert {j for j, _ in part.runs if j > 0} == joins
    assert np.array_equal(part["steer"], recording["steer"][start:stop])


def test_each_run_is_a_recording_of_its_own():
    parts = list(joined(20, 30).each_run())
    assert [len(p) for p in parts] == [20, 30]
    assert [p.runs for p in parts] == [((0, 20),), ((0, 30),)]
    assert np.array_equal(parts[1]["steer"], drive(30, 1)["steer"])


def test_mirroring_swaps_left_and_right_and_nothing_else():
    recording = drive().with_signals(roll=np.ones(150), pitch=np.ones(150), own_channel=np.ones(150))
    image = recording.mirrored()
    for name, values in recording.signals.items():
        flips = name in SIGNALS and SIGNALS[name].mirrors
        assert np.array_equal(image[name], -values if flips else values), name
    assert {n for n in recording.signals if not np.array_equal(image[n], recording[n])} == {
        "steer", "yaw_rate", "a_y", "roll"
    }  # fmt: skip


def test_joining_keeps_common_signals_and_puts_a_join_between():
    both = join([drive(20), without(drive(30, 1), "a_y")], "both")
    assert "a_y" not in both
    assert both.runs == ((0, 20), (20, 50))
    assert np.array_equal(both["v_x"][20:], drive(30, 1)["v_x"])


def test_joining_nothing_is_refused_in_a_sentence():
    with pytest.raises(BadInput, match="no recording"):
        join([], "nothing")


def test_values_cannot_be_changed_in_place():
    values = np.arange(5.0)
    recording = Recording("r", 0.1 * np.arange(5), {"v_x": values})
    values[0] = 99.0
    assert recording["v_x"][0] == 0.0
    with pytest.raises(ValueError, match="read-only"):
        recording["v_x"][0] = 1.0
    with pytest.raises(TypeError):
        recording.signals["v_x"] = values


def test_a_signal_of_another_length_is_refused_in_a_sentence():
    with pytest.raises(BadInput, match="signal v_x has shape"):
        Recording("r", np.arange(5.0), {"v_x": np.zeros(4)})
    with pytest.raises(BadInput, match="time must be one column"):
        Recording("r", np.zeros((2, 2)), {})


def test_a_missing_signal_is_named_with_those_that_are_there():
    with pytest.raises(BadInput, match=r"no signal 'v_z'.*v_x, steer"):
        drive()["v_z"]
    with pytest.raises(BadInput, match=r"lacks v_z, roll, which this test needs"):
        drive().require(("v_x", "v_z", "roll"), "this test")


def test_units_are_si_and_own_channels_keep_theirs():
    recording = Recording("r", np.arange(2.0), {"v_x": np.zeros(2), "heat": np.zeros(2)}, extra_units={"heat": "K"})
    assert (recording.unit("v_x"), recording.unit("heat"), recording.unit("else")) == ("m/s", "K", "1")


def test_a_part_between_two_times_keeps_its_runs():
    recording = Recording("r", np.array([0.0, 1, 2, 3, 0, 1, 2]), {"v_x": np.arange(7.0)}, runs=((0, 4), (4, 7)))
    part = recording.between(1.0, 2.0)
    np.testing.assert_array_equal(part["v_x"], [1, 2, 5, 6])
    assert part.runs == ((0, 2), (2, 4))
    assert part.source.between == "1:2"
    np.testing.assert_array_equal(recording.between(stop=1.0)["v_x"], [0, 1, 4, 5])
    with pytest.raises(BadInput, match="no row between 9: s; time runs from 0 to 3 s"):
        recording.between(9.0)


def test_a_run_ends_where_a_condition_leaves_rows_out():
    recording = Recording("r", np.arange(6.0), {"v_x": np.array([9.0, 9, 1, 9, np.nan, 9])})
    part = recording.where("v_x > 5 and time < 5")
    np.testing.assert_array_equal(part.time, [0, 1, 3])
    assert part.runs == ((0, 2), (2, 3))
    assert part.source.where == "v_x > 5 and time < 5"
    assert "3 of 6 rows were selected: those where v_x > 5" in part.notes[0]
    with pytest.raises(BadInput, match="no row where v_x > 10"):
        recording.where("v_x > 10")


@pytest.mark.parametrize(
    ("time", "v_x", "says"),
    [
        (["a", "b"], [1.0, 2.0], "lap: time holds something"),
        ([0.0, 0.1], ["a", "b"], "lap: signal v_x holds something"),
    ],
)
def test_what_is_no_number_is_refused_in_a_sentence(time, v_x, says):
    with pytest.raises(BadInput, match=says):
        Recording("lap", time, {"v_x": v_x})


def test_stamps_by_turns_early_and_late_have_the_rate_of_their_rows():
    time = np.concatenate([[0.0], np.cumsum(np.tile([0.032, 0.048], 100))])
    assert Recording("by turns", time[:-1], {"v_x": np.ones(200)}).sample_time == pytest.approx(0.04, rel=1e-2)


def test_what_another_recording_holds_is_shared_and_what_a_caller_holds_is_copied():
    v_x = np.ones(3)
    first = Recording("lap", np.arange(3.0), {"v_x": v_x})
    v_x[0] = 2.0
    assert first["v_x"][0] == 1.0
    assert replace(first, hold="linear")["v_x"] is first["v_x"]
    whole = np.ones(3)
    view = whole[:]
    view.setflags(write=False)
    second = Recording("lap", np.arange(3.0), {"v_x": view})
    whole[0] = 2.0
    assert second["v_x"][0] == 1.0
