"""Signs and units that channels hold against each other."""

from dataclasses import replace

import numpy as np
import pytest
from simulated import clean, clean_runs
from toys import without

from greybox_id.datasets.checks import Severity, check, distrusted
from greybox_id.datasets.checks.consistency import check_duplicates
from greybox_id.datasets.column_map import column_map
from greybox_id.datasets.read import read
from greybox_id.datasets.recording import Recording

DEGREES = 180 / np.pi


def found(recording, kind, **settings):
    return [finding for finding in check(recording, **settings) if finding.kind == kind]


@pytest.mark.parametrize("name", ["yaw_rate", "steer", "a_y", "a_x", "yaw"])
@pytest.mark.parametrize("seed", [1, 2])
def test_a_wrong_sign_is_distrusted(name, seed):
    recording = clean(seed)
    findings = found(recording.with_signals(**{name: -recording[name]}), "sign")
    assert distrusted(findings)
    assert any(name in f.sentence for f in findings)


def test_positions_tell_which_side_is_wrong():
    recording = clean(3)
    wrong = recording.with_signals(yaw_rate=-recording["yaw_rate"], steer=-recording["steer"])
    (course, *_) = [f for f in found(wrong, "sign") if "course over ground" in f.sentence]
    assert "yaw_rate and steer must be positive to the right" in course.sentence


def test_tight_circles_of_a_slow_car_do_not_come_round_the_other_way():
    for seed in (124, 125):
        assert not found(clean_runs(seed, dt=0.05, speed=1.8, wheelbase=0.32, seconds=30.0), "sign")


def test_a_run_with_its_sign_turned_is_named():
    recording = clean_runs(4)
    turned = recording["yaw_rate"].copy()
    turned[slice(*recording.runs[2])] *= -1
    findings = found(recording.with_signals(yaw_rate=turned), "sign")
    assert any(f.where.run == 3 for f in findings)


@pytest.mark.parametrize(
    ("name", "factor", "word"),
    [
        ("yaw_rate", DEGREES, "yaw_rate may be in deg"),
        ("yaw_rate", 1 / DEGREES, "yaw_rate may be in rad"),
        ("a_y", 1 / 9.80665, "a_y may be in m/s² instead of g"),
        ("a_x", 9.80665, "a_x may be in g instead of m/s²"),
        ("v_x", 3.6, "v_x may be in"),
    ],
)
def test_a_wrong_unit_is_named(name, factor, word):
    recording = clean(5)
    findings = found(recording.with_signals(**{name: recording[name] * factor}), "unit")
    assert distrusted(findings)
    if "in m/s²" not in word and "in g" not in word:
        assert any(word in finding.sentence for finding in findings)
    else:
        assert any(name in finding.sentence and "9.81" in finding.sentence for finding in findings)


def test_steering_in_degrees_shows_in_its_size_and_a_known_wheelbase_sharpens_the_check():
    recording = without(clean(6), "yaw", "x", "y", "latitude", "longitude", "a_y", "v_y")
    assert not found(recording, "unit", wheelbase=2.6)
    assert found(recording.with_signals(steer=recording["steer"] * DEGREES), "unit")
    hand_wheel = recording.with_signals(steer=recording["steer"] * 8)
    assert found(hand_wheel, "unit", wheelbase=2.6)


def test_a_copy_with_another_unit_sign_or_run_is_found():
    recording = clean_runs(7)
    units = {"gps_speed": "m/s"}
    copy = recording["v_x"].copy()
    sound = replace(recording, signals={**recording.signals, "gps_speed": copy}, extra_units=units)
    assert check_duplicates(sound) == []
    kmh = replace(sound, signals={**recording.signals, "gps_speed": 3.6 * copy})
    assert [f.kind for f in check_duplicates(kmh)] == ["unit"]
    turned = replace(sound, signals={**recording.signals, "gps_speed": -copy})
    assert "sign" in [f.kind for f in check_duplicates(turned)]
    lost = copy.copy()
    lost[slice(*recording.runs[1])] = np.random.default_rng(0).standard_normal(lost[slice(*recording.runs[1])].shape)
    stray = replace(sound, signals={**recording.signals, "gps_speed": lost})
    assert [(f.kind, f.where.run) for f in check_duplicates(stray)] == [("duplicate", 2)]


def test_runs_in_which_the_roboracers_pose_speed_is_no_copy_are_named(real_data):
    valid = read(real_data / "roboracer" / "valid.csv", "roboracer")
    (finding,) = [f for f in check_duplicates(valid) if f.where.channel == "velocity_vehicle_x"]
    assert "runs 2 and 4" in finding.sentence


@pytest.mark.parametrize(
    ("file", "columns"),
    [("roboracer/train.csv", "roboracer"), ("roboracer/single_mass.csv", "roboracer"), ("truck/val.parquet", "truck"),
     ("revs_250lm/run1_first400s.csv.gz", "revs_250lm")],
)  # fmt: skip
def test_shipped_maps_give_real_files_the_right_signs_and_units(real_data, file, columns):
    recording = read(real_data / file, columns)
    assert not [f for f in found(recording, "sign") + found(recording, "unit") if f.where.channel != "acc_vehicle_x"]


def test_the_trucks_raw_signs_are_found_out_by_the_gps_course(real_data):
    truck = column_map("truck")
    raw = replace(truck, signals={name: replace(column, sign=1) for name, column in truck.signals.items()})
    findings = found(read(real_data / "truck" / "train.parquet", raw), "sign")
    assert distrusted(findings)
    (course,) = [f for f in findings if "course over ground" in f.sentence]
    assert "yaw_rate and steer must be positive to the right" in course.sentence
    assert any(f.where.channel == "v_y" for f in findings)


def test_a_rate_of_rows_that_is_wrong_is_told_where_the_path_says_that_speeds_are_right():
    r = clean(3)
    turn = r["yaw_rate"] / r["v_x"]
    own = Recording("path", 0.2 * r.time, {"v_x": r["v_x"], "a_x": r["a_x"], "a_y": r["a_y"], "curvature": turn})
    found = [one for one in check(own) if one.severity is Severity.DISTRUST]
    assert found
    assert not any(one.repair for one in found)
    (one,) = (one for one in found if one.kind == "unit")
    assert "the sampling rate or the unit of time is wrong (" in one.sentence
    assert float(one.sentence.partition("agree at ")[2].split()[0]) == pytest.approx(50.0, rel=0.1)
