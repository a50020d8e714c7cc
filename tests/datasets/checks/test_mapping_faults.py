"""Faults of the column map: each is found and named, and nothing is said against a recording that shows nothing."""

import re
from dataclasses import replace

import numpy as np
import pytest
from checks_recordings import FAULTS, possible
from checks_recordings import clean as any_clean
from simulated import clean

from greybox_id.datasets.checks import Severity, check, distrusted
from greybox_id.datasets.checks.mapping_faults import _faults, check_mapping
from greybox_id.datasets.read import read
from greybox_id.datasets.recording import Recording
from greybox_id.fitting.scores.verdict import distrust

RADII = {"fl": 0.300, "fr": 0.301, "rl": 0.299, "rr": 0.302}


def complete(seed=1, **settings):
    """A clean recording with every channel that is checked."""
    r = clean(seed, **settings)
    rng = np.random.default_rng(seed)
    more = {f"wheel_speed_{corner}": np.abs(r["v_x"]) / radius for corner, radius in RADII.items()}
    more["sideslip"] = np.arctan2(r["v_y"], r["v_x"]) + 0.001 * rng.standard_normal(len(r))
    push = np.gradient(np.convolve(np.pad(r["v_x"], 50, "edge"), np.ones(101) / 101, "valid"), r.time)
    more["ax_cmd"] = push + 0.05 * rng.standard_normal(len(r))
    return r.with_signals(**more)


def only(recording, *names):
    return replace(recording, signals={name: recording[name] for name in names})


def accused(recording):
    return [f for f in check(recording) if f.severity is Severity.DISTRUST]


@pytest.mark.parametrize("name", FAULTS)
def test_a_fault_is_found_and_named_and_its_remedy_told(name):
    recording, fault = complete(), FAULTS[name]
    assert not accused(recording)
    assert possible(fault, recording)
    sentences = [finding.sentence for finding in accused(fault.apply(recording))]
    assert any(fault.named(sentence) for sentence in sentences), sentences
    assert any("column map" in sentence or "Map " in sentence or "unit = " in sentence for sentence in sentences)


@pytest.mark.parametrize("name", FAULTS)
def test_units_and_numbers_are_printed_as_everywhere(name):
    for finding in check(FAULTS[name].apply(complete())):
        printed = re.sub(r'unit = "[^"]*"', "", finding.sentence)  # what is to be typed is in pint's spelling
        assert not re.search(r"\^|\de[+-]?\d", printed)


def test_factors_of_time_are_written_out():
    written = {fault.what: fault.remedy for fault in _faults(complete()) if fault.what.startswith("time")}
    assert "divide time by 1000." in written["time is 1000 times as long as it should be"]
    assert "divide time by 0.001." in written["time is 0.001 times as long as it should be"]


def test_undoing_what_the_sentence_says_mends_the_recording():
    recording = only(clean(2), "v_x", "v_y", "yaw_rate", "a_x", "a_y", "steer")
    turned = recording.with_signals(a_x=recording["a_y"], a_y=-recording["a_x"])
    (finding, *_) = [f for f in check_mapping(turned) if f.kind == "mapping"]
    assert "turned by 90° to the left" in finding.sentence
    assert "then negate a_x" in finding.sentence
    mended = turned.with_signals(a_x=-turned["a_y"], a_y=turned["a_x"])
    assert not distrusted(check(mended))


def test_speed_against_positions_is_told_at_constant_speed():
    rng = np.random.default_rng(0)
    time = np.arange(0, 30, 0.02)
    signals = {"v_x": 36.0 + 0.02 * rng.standard_normal(len(time)), "x": 10.0 * time, "y": np.zeros(len(time))}
    (finding,) = [f for f in check_mapping(Recording("straight", time, signals)) if f.kind == "mapping"]
    assert "v_x is in km/h but called m/s" in finding.sentence


def test_a_steady_circle_tells_axes_and_signs():
    rng, n = np.random.default_rng(0), 3000
    time = 0.02 * np.arange(n)
    ideal = {"v_x": 10.0, "yaw_rate": 0.5, "steer": 0.15, "a_x": 0.0, "a_y": 5.0}
    noise = {"v_x": 0.02, "yaw_rate": 0.005, "steer": 0.001, "a_x": 0.2, "a_y": 0.2}
    circle = Recording("circle", time, {k: v + noise[k] * rng.standard_normal(n) for k, v in ideal.items()})
    assert not distrusted(check(circle))
    for wrong in ({"a_x": circle["a_y"], "a_y": circle["a_x"]}, {"a_y": -circle["a_y"]}):
        assert distrusted(check(circle.with_signals(**wrong)))


def test_v_y_is_told_by_the_slip_of_the_rear_axle_alone():
    recording = only(clean(3, seconds=120.0), "v_x", "v_y", "yaw_rate")
    assert not distrusted(check(recording))
    (finding,) = [f for f in check_mapping(recording.with_signals(v_y=-recording["v_y"])) if f.kind == "mapping"]
    assert "v_y has the wrong sign" in finding.sentence


def test_a_sensor_behind_the_rear_axle_is_no_wrong_sign():
    recording = only(clean(3, seconds=120.0), "v_x", "v_y", "yaw_rate")
    behind = recording.with_signals(v_y=recording["v_y"] - 3.0 * recording["yaw_rate"])
    assert not distrusted(check(behind))


@pytest.mark.parametrize("seed", range(3))
def test_a_drive_in_which_nothing_happens_is_not_accused_and_says_so(seed):
    rng, n = np.random.default_rng(seed), 3000
    noise = {"v_x": 0.02, "v_y": 0.02, "yaw_rate": 0.005, "a_x": 0.2, "a_y": 0.2, "steer": 0.001}
    signals = {name: sd * rng.standard_normal(n) for name, sd in noise.items()}
    signals["v_x"] += 15.0
    findings = check(Recording("straight on", 0.02 * np.arange(n), signals))
    assert not distrusted(findings)
    (still,) = [f for f in findings if f.kind == "unchecked" and "not clear from the motion" in f.sentence]
    for what in ("sign of steer", "sign of yaw_rate", "axis and sign of a_x", "axis and sign of a_y"):
        assert what in still.sentence
    assert still.severity is Severity.NOTE
    assert any("the sign of v_y (needs x, y and yaw, or yaw_rate at several speeds)" in f.sentence for f in findings)


def test_checks_whose_channels_are_missing_are_told():
    findings = check_mapping(only(clean(4), "v_x", "steer"))
    (lacking,) = [f for f in findings if "could not be checked, because a channel is missing" in f.sentence]
    assert "the sign of steer (needs v_x and one of yaw_rate, a_y or positions)" in lacking.sentence
    assert "the scale of v_x" in lacking.sentence


def test_what_two_channels_alone_leave_open_is_told_as_open():
    recording = only(clean(5), "v_x", "yaw_rate", "steer")
    (finding,) = [f for f in check_mapping(recording.with_signals(steer=-recording["steer"])) if f.kind == "mapping"]
    assert "steer" in finding.sentence
    assert "yaw_rate" in finding.sentence
    assert "Equally likely" in finding.sentence


def test_a_course_and_its_rate_are_of_one_sensor():
    """Two channels against one are no two witnesses where the one is the other's integral."""
    recording = clean(5)
    yaw = np.cumsum(recording["yaw_rate"]) * recording.sample_time
    alone = only(recording.with_signals(yaw=-yaw, yaw_rate=-recording["yaw_rate"]), "v_x", "yaw_rate", "steer", "yaw")
    (finding,) = [f for f in check_mapping(alone) if f.kind == "mapping"]
    assert "steer has the wrong sign" in finding.sentence
    assert "yaw_rate and yaw have the wrong sign" in finding.sentence


@pytest.mark.parametrize(
    ("file", "columns"),
    [("roboracer/train.csv", "roboracer"), ("roboracer/valid.csv", "roboracer"),
     ("roboracer/tire_set_1.csv", "roboracer"), ("roboracer/single_mass.csv", "roboracer"),
     ("truck/val.parquet", "truck"), ("revs_250lm/run1_first400s.csv.gz", "revs_250lm")],
)  # fmt: skip
def test_real_recordings_through_their_shipped_maps_are_not_accused(real_data, file, columns):
    assert not distrusted(check_mapping(read(real_data / file, columns)))


def test_few_clean_recordings_of_any_kind_are_accused():
    assert not [found for seed in range(12) if (found := accused(any_clean(seed)))]


@pytest.mark.examination
@pytest.mark.slow
def test_at_most_one_clean_recording_in_a_hundred_is_accused():
    assert sum(bool(accused(any_clean(seed))) for seed in range(300_000, 300_100)) <= 1


@pytest.mark.parametrize("name", ["yaw_rate", "a_y"])
def test_a_column_that_holds_something_else_follows_nothing(name):
    recording, rng = clean(6), np.random.default_rng(6)
    findings = check_mapping(recording.with_signals(**{name: 0.3 * rng.standard_normal(len(recording))}))
    (finding,) = [f for f in findings if f.kind == "mapping"]
    assert f"{name} follows neither" in finding.sentence


def at_places(recording):
    """What a GPS logger has of it: speed, heading, acceleration aside and its place on earth."""
    north, east = np.degrees(recording["y"] / 6.371e6), np.degrees(recording["x"] / 6.371e6)
    given = only(recording, "v_x", "yaw", "a_y")
    return given.with_signals(latitude=north, longitude=east)


@pytest.mark.parametrize(
    "spoil",
    [
        lambda r: r.with_signals(a_x=r["a_y"], a_y=-r["a_x"]),
        lambda r: r.with_signals(a_x=np.cos(0.4) * r["a_x"] + np.sin(0.4) * r["a_y"],
                                 a_y=np.cos(0.4) * r["a_y"] - np.sin(0.4) * r["a_x"]),
        lambda r: r.with_signals(a_y=-r["a_y"], yaw_rate=-r["yaw_rate"]),
    ],
    ids=["turned by 90 degrees", "turned by 23 degrees", "upside down"],
)  # fmt: skip
def test_a_fit_is_told_of_a_fault_by_whichever_of_its_channels_it_uses(spoil):
    wrong = spoil(only(clean(2), "v_x", "steer", "yaw_rate", "a_x", "a_y"))
    assert distrust(["v_x", "steer", "a_y"], wrong)


def test_places_on_earth_check_yaw_and_lateral_acceleration_where_no_yaw_rate_is_recorded():
    recording = at_places(clean(1))
    findings = check(recording)
    assert not distrusted(findings)
    unchecked = " ".join(finding.sentence for finding in findings if finding.kind == "unchecked")
    assert "sign of yaw" not in unchecked
    assert "sign of a_y" not in unchecked
    for name in ("yaw", "a_y"):
        turned = accused(recording.with_signals(**{name: -recording[name]}))
        assert {finding.where.channel for finding in turned} == {name}


def test_what_yaw_and_lateral_acceleration_need_to_be_checked_is_told():
    recording = only(clean(1), "v_x", "yaw", "a_y")
    (finding,) = (finding for finding in check(recording) if finding.kind == "unchecked")
    assert "axis and sign of a_y (needs v_x and one of yaw_rate, steer or positions)" in finding.sentence
    assert "the sign of yaw (needs yaw_rate or positions)" in finding.sentence
