"""Segments of a run: lengths and commands, readings, shifts in time; how long they may be at standstill."""

import numpy as np
import pytest

from greybox_id.datasets.recording import Recording
from greybox_id.engine.motion.schedule import (
    AT_ONCE,
    MOST_STEPS,
    STABLE,
    least_segment,
    longest_segment,
    motion_runs,
    schedule,
)
from greybox_id.engine.motion.simulator import Simulator
from greybox_id.engine.motion.trace import MotionTrace
from greybox_id.fitting.scores.metrics import simulate
from greybox_id.models.motion_model import MotionModel, State
from greybox_id.models.parameter import Parameter
from greybox_id.models.registry import build

PULLED = MotionModel(
    name="toy", about="", inputs=("steer",), outputs=("speed", "a_x"), commands=("steer",), parameters=(),
    states=(State("speed", "m/s"),), quantities=("a_x",), dynamics=lambda x, u, p, q: _pull(u, q),
)  # fmt: skip
FAR = 1e9


def _pull(u, q):
    q.a_x = u.steer
    return {"speed": q.a_x}


def delayed(delay=None, latency=None):
    model = PULLED
    for name, value, change in (("delay", delay, "delayed"), ("latency", latency, "late")):
        if value is not None:
            model = model.with_parameters(*model.parameters, Parameter(name, "s", value))
            shift = (lambda p: p.delay) if name == "delay" else (lambda p: p.latency)
            model = model.delayed("steer", shift) if change == "delayed" else model.late(shift, "a_x")
    return model


def laid(model, time, hold="zero", longest=FAR, read=None):
    """Schedule, and the commands at the beginning of segments and at their ends."""
    rows = np.arange(len(time))
    recording = Recording(
        "r", np.asarray(time), {"steer": 10.0 + rows**2, "speed": 0.0 * rows, "a_x": 0.0 * rows}, hold=hold
    )
    (run,) = motion_runs(model, recording)
    plan = schedule(MotionTrace(model), run, model.values, longest, read=read)
    begin = plan.segments[:, 1]
    return plan, begin, begin + plan.segments[:, 2] * plan.segments[:, 0]


def test_without_shifts_there_is_a_segment_per_row_and_commands_hold():
    plan, begin, end = laid(PULLED, [0.0, 0.1, 0.2, 0.3])
    np.testing.assert_allclose(plan.segments[:, 0], [0.1, 0.1, 0.1, 0.0])
    np.testing.assert_array_equal(begin, [10, 11, 14, 19])
    np.testing.assert_array_equal(end, begin)
    np.testing.assert_array_equal(plan.row_segment, [0, 1, 2, 3])
    assert np.all(plan.reads)


def test_latencies_cut_nothing_where_nothing_is_read():
    model, time = delayed(latency=0.04), [0.0, 0.1, 0.2, 0.3]
    plan, _, _ = laid(model, time, read=np.array([False, False, True, False]))
    np.testing.assert_allclose(plan.segments[:, 0], [0.1, 0.06, 0.04, 0.1, 0.0])
    np.testing.assert_array_equal(plan.read_segment[:, 1], [-1, -1, 2, -1])
    whole, _, _ = laid(model, time)
    everywhere, _, _ = laid(model, time, read=np.ones(4, dtype=bool))
    np.testing.assert_array_equal(whole.segments, everywhere.segments)


def test_commands_that_run_straight_meet_at_the_next_row():
    _, begin, end = laid(PULLED, [0.0, 0.1, 0.2, 0.3], hold="linear")
    np.testing.assert_allclose(end[:-1], begin[1:])


def test_no_segment_is_longer_than_wanted_and_together_they_are_the_run():
    time = np.cumsum([0.0, 0.1, 0.12, 0.09, 0.11, 0.1])
    plan, *_ = laid(PULLED, time, longest=0.031)
    assert np.max(plan.segments[:, 0]) < 0.031 * 1.3  # steps of uneven length are cut into equally many pieces
    assert np.sum(plan.segments[:, 0]) == pytest.approx(time[-1])
    assert np.count_nonzero(plan.reads) == len(time)
    starts = np.concatenate(([0.0], np.cumsum(plan.segments[:-1, 0])))
    np.testing.assert_allclose(starts[plan.row_segment], time)


@pytest.mark.parametrize("delay", [0.0, 0.03, 0.1, 0.137, 0.2, 0.3])
@pytest.mark.parametrize("beginning", [0.0, 17.3, 1234.1])
@pytest.mark.parametrize("hold", ["zero", "linear"])
def test_a_delayed_command_is_that_of_so_long_before_and_the_first_one_before_that(delay, beginning, hold):
    time = beginning + 0.1 * np.arange(12)
    plan, begin, end = laid(delayed(delay=delay), time, hold=hold)
    starts = time[0] + np.concatenate(([0.0], np.cumsum(plan.segments[:-1, 0])))
    ends = starts + plan.segments[:, 0]
    given, lasts = 10.0 + np.arange(12) ** 2, plan.segments[:, 0] > AT_ONCE
    if hold == "linear":
        np.testing.assert_allclose(begin, np.interp(starts - delay, time, given), atol=1e-6)
        np.testing.assert_allclose(end, np.interp(ends - delay, time, given), atol=1e-6)
    else:
        middle = np.searchsorted(time, (starts + ends)[lasts] / 2 - delay) - 1
        np.testing.assert_array_equal(begin[lasts], given[np.maximum(middle, 0)])


@pytest.mark.parametrize("beginning", [0.0, 17.3, 1234.1])
def test_a_command_delayed_by_whole_samples_has_arrived_when_a_row_is_read(beginning):
    plan, begin, _ = laid(delayed(delay=0.3), beginning + 0.1 * np.arange(12))
    np.testing.assert_array_equal(begin[plan.row_segment[3:]], 10.0 + np.arange(9) ** 2)


@pytest.mark.parametrize("beginning", [0.0, 17.3, 1234.1])
def test_a_reading_late_by_whole_samples_is_taken_just_after_the_commands_of_its_instant(beginning):
    plan, begin, _ = laid(delayed(latency=0.3), beginning + 0.1 * np.arange(12))
    np.testing.assert_array_equal(plan.read_segment[:3, 1], -1)
    np.testing.assert_array_equal(begin[plan.read_segment[3:, 1]], 10.0 + np.arange(9) ** 2)
    np.testing.assert_array_equal(plan.read_segment[:, 0], plan.row_segment)


def test_a_shift_ahead_of_time_knows_at_the_beginning_what_comes():
    _, begin, _ = laid(delayed(delay=-0.25), 0.1 * np.arange(12))
    given = 10.0 + np.arange(12) ** 2
    np.testing.assert_array_equal(begin[:4], given[[2, 3, 3, 4]])
    assert begin[-1] == given[-1]


def test_a_delay_longer_than_the_run_leaves_the_first_command_in_force():
    _plan, begin, end = laid(delayed(delay=5.0), 0.1 * np.arange(12), hold="linear")
    np.testing.assert_array_equal(begin, 10.0)
    np.testing.assert_array_equal(end, 10.0)
    assert len(begin) == 12


def test_a_latency_longer_than_the_run_leaves_nothing_to_read():
    plan, *_ = laid(delayed(latency=5.0), 0.1 * np.arange(12))
    np.testing.assert_array_equal(plan.read_segment[:, 1], -1)


@pytest.mark.parametrize(("delay", "latency"), [(0.037, None), (None, 0.037), (0.05, 0.013), (0.13, 0.16)])
def test_lengths_move_with_shifts_as_they_say(delay, latency):
    model, time = delayed(delay, latency), 0.1 * np.arange(8)
    plan, *_ = laid(model, time)
    (run,) = motion_runs(model, Recording("r", time, dict.fromkeys(("steer", "speed", "a_x"), 0.0 * time)))
    inputs = 1 + 2 * len(model.inputs)
    for k in range(len(model.values)):
        moved = model.values + np.eye(len(model.values))[k] * 1e-6
        later = schedule(MotionTrace(model), run, moved, FAR)
        slope = (later.segments[:, 0] - plan.segments[:, 0]) / 1e-6
        np.testing.assert_allclose(plan.segments[:, inputs + k], slope, atol=1e-6)


RACING = {"m": 787.0, "I_z": 1000.0, "l_f": 1.62, "l_r": 1.36, "B_f": 20.0, "B_r": 22.0, "C_f": 1.6, "C_r": 1.6,
          "D_f": 1.7, "D_r": 1.8}  # fmt: skip


def racing():
    model = build("lateral")
    return model.with_parameters(*(model[name].with_value(value) for name, value in RACING.items()))


def from_standstill(rate):
    time = np.arange(0.0, 20.0, 1.0 / rate)
    v_x = np.interp(time, [0, 5, 20], [0.0, 0.0, 60.0])
    steer = 0.01 * np.sin(time)
    nothing = 0.02 * np.random.default_rng(0).standard_normal((3, len(time)))
    return Recording("start", time, {"v_x": v_x, "steer": steer, "v_y": nothing[0], "yaw_rate": nothing[1]})


@pytest.mark.parametrize("rate", [10.0, 25.0, 100.0])
def test_a_racing_car_at_standstill_is_stable_whatever_the_rate(rate, monkeypatch):
    monkeypatch.setenv("GREYBOX_COMPILE", "0")
    model, recording = racing(), from_standstill(rate)
    longest = longest_segment(Simulator(model).trace, motion_runs(model, recording), model.values)
    C = sum(20.0 * 1.6 * 1.7 * 787.0 * 9.81 * share for share in (1.36 / 2.98, 1.62 / 2.98))
    assert longest <= STABLE / (C / 787.0 / 0.25), "at 0.25 m/s the sideslip decays at this rate, at least"
    found = simulate(model, recording)
    assert np.all(np.abs(found.predicted[:, 1]) < 3.0)


def test_rows_that_follow_each_other_fast_are_cut_no_finer_than_they_were():
    assert least_segment(0.01) == 0.01 / MOST_STEPS
    assert least_segment(0.005) == 0.005 / MOST_STEPS
    assert least_segment(0.04) == 2.5e-4


def test_readings_that_are_late_alike_are_taken_at_one_instant():
    time = np.arange(0.0, 2.0, 0.1)
    model = delayed(delay=0.05, latency=0.02).late(lambda p: p.latency, "speed")
    run = motion_runs(model, Recording("r", time, {"steer": np.sin(time), "speed": time, "a_x": time}))[0]
    trace = MotionTrace(model)
    shifts = np.array([0.05, 0.02, 0.02])
    apart = schedule(trace, run, shifts, FAR)
    once = schedule(trace, run, shifts, FAR, [False] * 3)
    assert len(apart.segments) - len(once.segments) == pytest.approx(len(time), abs=1)
    np.testing.assert_array_equal(once.read_segment[:, 0], once.read_segment[:, 1])
    assert np.sum(once.segments[:, 0] == 0) == 1  # the last one alone has no length
    for own in (apart, once):
        assert np.sum(own.segments[:, 0]) == pytest.approx(time[-1] - time[0])
    at = [np.append(0.0, np.cumsum(own.segments[:, 0])) for own in (apart, once)]
    later = once.read_segment[:, 0] >= 0
    np.testing.assert_allclose(at[1][once.read_segment[later]], at[0][apart.read_segment[later]], rtol=0, atol=1e-12)
