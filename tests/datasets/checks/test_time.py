"""Faults of the clock."""

import numpy as np
import pytest

from greybox_id.datasets.checks import Severity, distrusted
from greybox_id.datasets.checks.values import check_time
from greybox_id.datasets.read import read
from greybox_id.datasets.recording import Recording


def clock(time):
    return Recording("clock", np.asarray(time, dtype=float), {})


def kinds(time):
    return {finding.kind: finding for finding in check_time(clock(time))}


def test_a_sound_clock_gives_no_finding():
    assert check_time(clock(np.arange(200) * 0.05)) == []


def test_a_restart_is_a_join_and_no_cause_for_distrust():
    found = kinds([*np.arange(100) * 0.05, *np.arange(100) * 0.05])
    assert found["join"].where.rows == (100,)
    assert found["join"].severity is Severity.WARNING
    assert not distrusted(found.values())


def test_a_gap_is_told_with_its_length():
    found = kinds([*np.arange(100) * 0.05, *(7 + np.arange(100) * 0.05)])
    assert found["gap"].value == pytest.approx(2.05)
    assert found["gap"].unit == "s"


def test_swapped_rows_are_time_running_backwards():
    time = np.arange(200) * 0.05
    time[[60, 61]] = time[[61, 60]]
    found = kinds(time)
    assert found["backwards"].severity is Severity.DISTRUST


@pytest.mark.parametrize("step", [0.05, 0.02, 0.01])
def test_a_clock_that_was_set_back_is_told_with_its_row_and_how_far(step):
    time = np.arange(400) * step
    going = {"v_x": 10.0 + np.sin(time), "yaw_rate": 0.2 * np.cos(time)}
    time[250:] -= 1.0
    (found,) = check_time(Recording("clock", time, going))
    assert found.kind == "set_back"
    assert found.where.rows == (250,)
    assert found.value == pytest.approx(1.0)
    assert found.severity is Severity.WARNING
    assert "the clock was set back by 1.0 s at row 250, counted from 0" in found.sentence
    assert f"rate = {1 / step:g} in place of [time]" in found.sentence


def test_another_recording_whose_stamps_come_again_is_no_clock_that_was_set_back():
    time = np.r_[np.arange(200) * 0.02, 1.0 + np.arange(200) * 0.02]
    jumps = Recording("clock", time, {"v_x": np.where(np.arange(400) < 200, 5.0, 9.0) + np.sin(time)})
    assert {found.kind for found in check_time(jumps)} == {"join"}


def test_doubled_rows_are_time_standing_still():
    time = np.arange(200) * 0.05
    found = kinds(np.insert(time, 60, time[60]))
    assert found["still"].where.rows == (61,)
    assert distrusted(check_time(clock(np.zeros(20))))
    assert distrusted(check_time(clock(np.repeat(time, 2))))


def test_missing_times_and_irregular_sampling_are_distrusted():
    time = np.arange(200) * 0.05
    time[7] = np.nan
    assert kinds(time)["missing"].where.rows == (7,)
    rng = np.random.default_rng(0)
    assert distrusted(check_time(clock(np.cumsum(rng.exponential(0.05, 300)))))


def test_jitter_is_told_as_a_share_of_the_step():
    rng = np.random.default_rng(0)
    found = kinds(np.arange(300) * 0.05 + 0.005 * rng.standard_normal(300).clip(-1.5, 1.5))
    assert 0.05 < found["jitter"].value < 0.2
    assert not distrusted(found.values())


def test_rows_are_told_as_the_file_counts_them(tmp_path):
    path = tmp_path / "lap.csv"
    rows = [f"{0.05 * (k % 50):.2f},1" for k in range(100)]
    path.write_text("time,v_x\n" + "\n".join(rows))
    (finding,) = check_time(read(path))
    assert "row 52 of the file" in finding.sentence
    assert path.read_text().splitlines()[52 - 1] == "0.00,1"


@pytest.mark.parametrize(
    ("file", "rows"),
    [("train", (698, 1639, 2082)), ("valid", (492, 790, 1016)), ("tire_set_1", (408,)), ("single_mass", ())],
)
def test_joins_of_the_roboracer_files_are_found(real_data, file, rows):
    findings = check_time(read(real_data / "roboracer" / f"{file}.csv", "roboracer"))
    assert tuple(row for finding in findings for row in finding.where.rows) == rows
