"""The synthetic racer: its physics, its sensors and its files."""

from dataclasses import replace
from math import tan
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from greybox_id.base.errors import BadInput
from greybox_id.datasets.recording import split_runs
from greybox_id.datasets.shipped import SHIPPED, shipped
from greybox_lab.virtual.synthetic_racer import COLUMNS, SEED, make, run_table
from greybox_lab.virtual.synthetic_racer.car import GRAVITY, Car, CarMotion
from greybox_lab.virtual.synthetic_racer.drive import FORMATS, RUNS, DrivenRun, measure, simulate
from greybox_lab.virtual.synthetic_racer.driver import (
    Driver,
    Pid,
    PurePursuit,
    Stanley,
    closed_track,
    raceline,
    speed_profile,
)

STRAIGHT_CAR = replace(Car(), steer_trim=0.0)

LAST_DIGIT = {c: 10.0 ** -int(f[2]) for c, f in zip(COLUMNS, FORMATS, strict=True)}

SHORT = {"racer_valid": (DrivenRun(Pid, 1.5, 2.0, 3.0, 3.0), DrivenRun(PurePursuit, 1.0, 2.0, 3.0, 3.0, lead=0.5))}


def rolling(v):
    return CarMotion(v_x=v, drive_speed=v / Car().R)


def circling(steer, v, duration=4.0):
    """Truth at the end of a circle at constant steering command and nearly constant speed."""
    truth = simulate(STRAIGHT_CAR, lambda _t, _car, measured: (steer, 20.0 * (v - measured)), duration, rolling(v))
    return {name: values[-500:].mean() for name, values in truth.items()}


@pytest.fixture(scope="module")
def recordings():
    return {name: pd.read_csv(shipped(name)) for name in SHIPPED}


def test_standstill_stays_at_standstill():
    truth = simulate(Car(), lambda *_: (0.0, 0.0), 1.0)
    for name in ("x", "y", "yaw", "v_x", "v_y", "yaw_rate", "a_x", "a_y", "roll", "pitch", "wheel_speed"):
        assert np.all(truth[name] == 0.0), name


def test_standing_wheels_can_be_steered_without_moving_the_car():
    truth = simulate(Car(), lambda *_: (0.3, 0.0), 1.0)
    assert truth["steer"][-1] > 0.3
    assert np.hypot(truth["x"], truth["y"]).max() < 1e-9


def test_coast_down_decelerates_to_a_stop_without_rolling_back():
    truth = simulate(STRAIGHT_CAR, lambda *_: (0.0, 0.0), 6.0, rolling(3.0))
    every = truth["v_x"][::50]
    assert np.all(np.diff(every) < 1e-9)
    assert every[-1] == pytest.approx(0.0, abs=1e-3)
    assert truth["v_x"].min() > -1e-3
    # Drag grows with speed.
    assert truth["v_x"][0] - truth["v_x"][300] > truth["v_x"][1200] - truth["v_x"][1500]


def test_slow_circle_follows_the_wheels():
    end = circling(0.1, 0.8)
    road_wheel = STRAIGHT_CAR.steer_gain * 0.1
    assert end["yaw_rate"] == pytest.approx(end["v_x"] * tan(road_wheel) / STRAIGHT_CAR.wheelbase, rel=0.03)
    assert end["a_y"] == pytest.approx(end["yaw_rate"] * end["v_x"], rel=0.01)


def test_fast_circle_understeers_and_keeps_the_friction_limit():
    slow, fast = circling(0.25, 0.8), circling(0.25, 3.0)
    assert 0.4 < (fast["yaw_rate"] / fast["v_x"]) / (slow["yaw_rate"] / slow["v_x"]) < 0.9
    assert 4.0 < fast["a_y"] < STRAIGHT_CAR.mu_yr * GRAVITY
    assert fast["roll"] > 0.05


def test_motor_saturates_and_loses_force_with_speed():
    launch = {i: simulate(STRAIGHT_CAR, lambda *_, i=i: (0.0, i), 0.4)["v_x"][-1] for i in (2.0, 4.0, 8.0)}
    assert launch[2.0] < launch[4.0] < launch[8.0] < 2.0 * launch[4.0]
    late = {
        v: np.diff(simulate(STRAIGHT_CAR, lambda *_: (0.0, 5.0), 0.4, rolling(v))["v_x"][[200, -1]]) for v in (1, 3)
    }
    assert late[3] < 0.7 * late[1]


def test_braking_has_a_map_of_its_own():
    change = {
        i: np.diff(simulate(STRAIGHT_CAR, lambda *_, i=i: (0.0, i), 0.3, rolling(2.0))["v_x"][[100, -1]])
        for i in (-1.5, 0.0, 1.5)
    }
    assert change[0.0] - change[-1.5] != pytest.approx(change[1.5] - change[0.0], rel=0.05)
    assert change[-1.5] < change[0.0] < change[1.5]


def test_energy_never_exceeds_the_motors_work():
    truth = simulate(STRAIGHT_CAR, lambda t, *_: (0.35 * np.sin(6.0 * t), 4.0 if t < 1.5 else 0.0), 3.0)
    car = STRAIGHT_CAR
    kinetic = 0.5 * car.m * (truth["v_x"] ** 2 + truth["v_y"] ** 2) + 0.5 * car.I_z * truth["yaw_rate"] ** 2
    kinetic += 0.5 * car.I_drive * truth["drive_speed"] ** 2
    work = np.cumsum(truth["drive_force"] * truth["wheel_speed"]) * 1e-3
    assert np.all(kinetic <= work + 1e-3)
    assert np.all(np.diff(kinetic[1700::50]) < 1e-6)
    assert np.hypot(truth["a_x"], truth["a_y"]).max() < 1.15 * car.mu_x * GRAVITY


def test_steering_servo_is_late_and_slow():
    truth = simulate(replace(STRAIGHT_CAR, steer_delay=0.03), lambda *_: (0.4, 0.0), 0.4)
    assert np.all(truth["steer"][:30] == 0.0)
    assert np.diff(truth["steer"]).max() <= STRAIGHT_CAR.steer_rate * 1e-3 + 1e-12
    assert truth["steer"][-1] == pytest.approx(STRAIGHT_CAR.steer_gain * 0.4, rel=0.02)


@pytest.mark.parametrize("steering", [Pid, Stanley, PurePursuit])
def test_mirrored_path_gives_mirrored_signals(steering):
    track = raceline(np.random.default_rng(1))
    left, right = (
        measure(
            simulate(STRAIGHT_CAR, self_driven(each, steering), 4.0, at_start(each)), None, np.random.default_rng(0)
        )
        for each in (track, track.mirrored())
    )
    for name in COLUMNS:
        sign = -1.0 if name in ("accy", "yaw_rate", "steering_angle", "pose_y", "yaw") else 1.0
        np.testing.assert_allclose(right[name], sign * left[name], rtol=1e-6, atol=1e-6, err_msg=name)
    assert np.abs(left["yaw_rate"]).max() > 30.0


@pytest.mark.parametrize("steering", [Pid, Stanley, PurePursuit])
def test_driver_keeps_to_the_path(steering):
    track = raceline(np.random.default_rng(2))
    truth = simulate(STRAIGHT_CAR, self_driven(track, steering), 6.0, at_start(track))
    apart = np.hypot(truth["x"][::100, None] - track.x, truth["y"][::100, None] - track.y).min(axis=1)
    assert apart.max() < 0.35
    assert truth["v_x"][-1] > 1.0


def at_start(track):
    return CarMotion(x=track.x[0], y=track.y[0], yaw=track.yaw[0])


def self_driven(track, steering):
    speeds = speed_profile(track, 2.4, 2.5, 2.0)
    car = STRAIGHT_CAR
    return Driver(track, speeds, steering(), (), car.wheelbase, car.l_r, np.zeros(len(track.s)))


def test_track_closes_and_knows_its_curvature():
    angle = np.linspace(0.0, 2.0 * np.pi, 24, endpoint=False)
    circle = closed_track(2.0 * np.column_stack([np.cos(angle), np.sin(angle)]))
    assert circle.length == pytest.approx(4.0 * np.pi, rel=1e-3)
    np.testing.assert_allclose(circle.curvature, 0.5, rtol=0.01)
    np.testing.assert_allclose(circle.mirrored().curvature, -0.5, rtol=0.01)


def test_speed_profile_keeps_its_limits():
    track = raceline(np.random.default_rng(3))
    v = speed_profile(track, 3.6, 5.0, 3.0)
    assert v.max() <= 3.6 + 1e-9
    assert (v**2 * np.abs(track.curvature)).max() < 5.0 * 1.15
    gain = (np.roll(v, -1) ** 2 - v**2) / (2.0 * track.length / len(v))
    assert np.abs(gain).max() < 3.0 * 1.05


def test_ideal_sensors_tell_the_truth():
    truth = simulate(STRAIGHT_CAR, lambda *_: (0.1, 2.0), 1.0)
    table = measure(truth, None, np.random.default_rng(0))
    assert tuple(table) == COLUMNS
    np.testing.assert_allclose(table["yaw_rate"], np.rad2deg(truth["yaw_rate"][::50]))
    np.testing.assert_allclose(table["Speed"], 4244.0 * truth["wheel_speed"][::50])


def test_same_seed_same_bytes_another_seed_another_drive(tmp_path, monkeypatch):
    monkeypatch.setattr("greybox_lab.virtual.synthetic_racer.drive.RUNS", SHORT)
    first, again, other = (make(tmp_path / f, seed)[0].read_bytes() for f, seed in (("a", 7), ("b", 7), ("c", 8)))
    assert first == again
    assert first != other
    assert [p.name for p in (tmp_path / "a").iterdir()] == ["racer_valid.csv"]
    assert first.count(b"\n") == 1 + 30 + 20


def test_a_failed_write_leaves_the_old_file_alone(tmp_path, monkeypatch):
    def fail(*_):
        raise RuntimeError

    monkeypatch.setattr("greybox_lab.virtual.synthetic_racer.drive.RUNS", SHORT)
    (tmp_path / "racer_valid.csv").write_text("old")
    monkeypatch.setattr(Path, "replace", fail)
    with pytest.raises(RuntimeError):
        make(tmp_path)
    assert (tmp_path / "racer_valid.csv").read_text() == "old"
    assert len(list(tmp_path.iterdir())) == 1


def assert_same(table, made):
    for name in COLUMNS:
        np.testing.assert_allclose(table[name], made[name], rtol=1e-6, atol=1.01 * LAST_DIGIT[name], err_msg=name)


def test_shipped_run_is_what_the_generator_makes(recordings):
    first = sum(run.rows for run in RUNS["racer_valid"][:3])
    assert_same(recordings["racer_valid"].iloc[first:], run_table("racer_valid", 3, SEED))


@pytest.mark.slow
def test_shipped_files_are_what_the_generator_makes(recordings, tmp_path):
    for path in make(tmp_path, SEED):
        assert_same(recordings[path.stem], pd.read_csv(path))


@pytest.mark.parametrize("name", SHIPPED)
def test_shipped_recording_has_its_runs_and_sampling(recordings, name):
    table = recordings[name]
    assert tuple(table.columns) == COLUMNS
    assert np.isfinite(table.to_numpy()).all()
    ends = np.cumsum([run.rows for run in RUNS[name]]).tolist()
    assert split_runs(table["t"].to_numpy()) == tuple(zip([0, *ends[:-1]], ends, strict=True))
    for start, stop in zip([0, *ends[:-1]], ends, strict=True):
        np.testing.assert_allclose(table["t"][start:stop], 0.05 * np.arange(stop - start), atol=1e-9)
    assert shipped(name).stat().st_size < 400_000


@pytest.mark.parametrize("name", SHIPPED)
def test_shipped_recording_is_driven_near_the_limits(recordings, name):
    table = recordings[name]
    v, a_x, a_y = table["Speed"] / 4244.0, table["accx"] * 9.80665, table["accy"] * 9.80665
    assert 3.4 < v.max() < 3.8
    assert v.min() > -0.4
    assert 5.5 < a_y.max() < 7.5
    assert -7.0 < a_x.min() < -4.5
    assert 4.5 < a_x.max() < 7.0
    assert table["steering_angle"].abs().max() == pytest.approx(0.419)
    assert table["current"].between(-3.0, 12.0).all()
    r = np.deg2rad(table["yaw_rate"])
    assert (r > 0.1).mean() > 2.0 * (r < -0.1).mean() > 0.1
    rest = table.iloc[:20]
    assert (rest["Speed"] == 0.0).all()
    assert np.deg2rad(rest["yaw_rate"]).mean() == pytest.approx(0.027, abs=0.002)


def test_all_recordings_that_are_shipped_are_made():
    assert RUNS.keys() == set(SHIPPED)


def test_unknown_recording_is_answered_with_what_there_is():
    with pytest.raises(BadInput, match="racer_train, racer_valid"):
        shipped("lap7")
