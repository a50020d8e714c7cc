"""The synthetic racer: its physics, its sensors and its files."""

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

from greybox_id.base.errors import BadInput
from greybox_id.datasets.recording import split_runs
from greybox_id.datasets.shipped import SHIPPED, shipped
from greybox_lab.virtual.synthetic_racer import COLUMNS, SEED, run_table
from greybox_lab.virtual.synthetic_racer.car import GRAVITY, Car, CarMotion
from greybox_lab.virtual.synthetic_racer.drive import FORMATS, RUNS, measure, simulate
from greybox_lab.virtual.synthetic_racer.driver import (
    Driver,
    Pid,
    PurePursuit,
    Stanley,
    raceline,
    smooth_speeds,
)

STRAIGHT_CAR = replace(Car(), steer_trim=0.0)

LAST_DIGIT = {c: 10.0 ** -int(f[2]) for c, f in zip(COLUMNS, FORMATS, strict=True)}


@pytest.fixture(scope="module")
def recordings():
    return {name: pd.read_csv(shipped(name)) for name in SHIPPED}


def test_energy_never_exceeds_the_motors_work():
    truth = simulate(STRAIGHT_CAR, lambda t, *_: (0.35 * np.sin(6.0 * t), 4.0 if t < 1.5 else 0.0), 3.0)
    car = STRAIGHT_CAR
    kinetic = 0.5 * car.m * (truth["v_x"] ** 2 + truth["v_y"] ** 2) + 0.5 * car.I_z * truth["yaw_rate"] ** 2
    kinetic += 0.5 * car.I_drive * truth["drive_speed"] ** 2
    work = np.cumsum(truth["drive_force"] * truth["wheel_speed"]) * 1e-3
    assert np.all(kinetic <= work + 1e-3)
    assert np.all(np.diff(kinetic[1700::50]) < 1e-6)
    assert np.hypot(truth["a_x"], truth["a_y"]).max() < 1.15 * car.mu_x * GRAVITY


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


def at_start(track):
    return CarMotion(x=track.x[0], y=track.y[0], yaw=track.yaw[0])


def self_driven(track, steering):
    speeds = smooth_speeds(track, 2.4, 2.5, 2.0)
    car = STRAIGHT_CAR
    return Driver(track, speeds, steering(), (), car.wheelbase, car.l_r, np.zeros(len(track.s)))


def assert_same(table, made):
    for name in COLUMNS:
        np.testing.assert_allclose(table[name], made[name], rtol=1e-6, atol=1.01 * LAST_DIGIT[name], err_msg=name)


def test_shipped_run_is_what_the_generator_makes(recordings):
    first = sum(run.rows for run in RUNS["racer_valid"][:3])
    assert_same(recordings["racer_valid"].iloc[first:], run_table("racer_valid", 3, SEED))


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
