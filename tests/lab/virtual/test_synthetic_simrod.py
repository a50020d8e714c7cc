"""The synthetic SimRod: what it records obeys the equations of motion of a rigid body, its truth those of its tyres."""

from dataclasses import replace

import numpy as np
import pytest

from greybox_id.datasets.read import read
from greybox_lab.virtual.synthetic_simrod import EXCITED, MANOEUVRES, Manoeuvre, drive, make, simrod, steering, write
from greybox_lab.virtual.synthetic_simrod import drive as drive_manoeuvres

READ = {"v_x", "v_y", "yaw_rate", "a_x", "a_y", "steer", "ax_cmd"}
STEP, SINE = MANOEUVRES[5], MANOEUVRES[15]


@pytest.fixture(scope="module")
def step():
    return drive([STEP], [3])[0]


def test_it_is_the_simrod_of_the_vehicle_file():
    p = simrod().parameters
    assert (p["m"], p["I_z"], p["l_f"], p["l_f"] + p["l_r"]) == (930.0, 700.0, 1.175, 2.346)


def test_the_same_seed_records_the_same(step):
    again, other = drive([STEP, STEP], [3, 4])
    for name in READ:
        assert np.array_equal(step.recording[name], again.recording[name])
    assert not np.array_equal(again.recording["a_y"], other.recording["a_y"])
    assert np.array_equal(again.truth.F_yf, other.truth.F_yf)


def test_the_truth_is_not_among_what_is_recorded(step):
    assert set(step.recording.signals) == READ
    assert all(name == "time" or name.startswith("true_") for name in step.truth.columns())
    assert not set(step.truth.columns()) & READ


@pytest.mark.parametrize("manoeuvre", [STEP, SINE], ids=["step", "sine"])
def test_forces_are_those_that_move_the_body(manoeuvre):
    test = drive([manoeuvre], [0])[0]
    p, truth, steer = simrod().parameters, test.truth, test.recording["steer"]
    across = truth.F_yf * np.cos(steer) + truth.F_yr
    assert np.allclose(across, p["m"] * truth.a_y, atol=0.003 * np.max(np.abs(across)))
    # of the turning moment, what the inclined wheels of a wide axle add is no axle's lateral force
    turning = p["l_f"] * truth.F_yf * np.cos(steer) - p["l_r"] * truth.F_yr
    off = turning - p["I_z"] * np.gradient(truth.yaw_rate, test.recording.time)
    assert np.sqrt(np.mean(off**2)) < 0.03 * p["l_f"] * np.max(np.abs(truth.F_yf))


def test_sensors_read_the_truth_with_the_noise_of_the_vehicle_file(step):
    for name in ("v_y", "yaw_rate", "a_y"):
        off = step.recording[name] - getattr(step.truth, name)
        assert np.std(off) == pytest.approx(simrod().noise[name], rel=0.1)
    silent = drive([STEP], [0], noise=0.0)[0]
    assert np.allclose(silent.recording["yaw_rate"], silent.truth.yaw_rate, atol=1e-12)


def test_a_driver_keeps_the_speed(step):
    assert np.max(np.abs(step.recording["v_x"] - STEP.speed)) < 0.12 * STEP.speed


def test_stiffness_at_small_slip_is_the_slope_and_falls_with_slip():
    gentle = drive([replace(STEP, amplitude=0.35)], [0])[0].truth
    assert np.nanmedian(gentle.C_alpha_f) == pytest.approx(gentle.C_0f, rel=0.03)
    hard = drive([replace(STEP, amplitude=3.0)], [0])[0].truth
    assert np.nanmin(hard.C_alpha_f) < 0.8 * hard.C_0f


def test_stiffness_is_not_told_where_there_is_no_slip(step):
    small = np.abs(step.truth.alpha_f) < EXCITED
    assert np.any(small)
    assert np.array_equal(np.isnan(step.truth.C_alpha_f), small)


def test_held_out_manoeuvres_are_none_of_those_trained_on():
    trained = {(m.kind, m.speed) for m in MANOEUVRES if m.part == "train"}
    held_out = [m for m in MANOEUVRES if m.part == "held out"]
    assert {m.kind for m in held_out} == {"step", "sine"}
    assert not {(m.kind, m.speed) for m in held_out} & trained
    assert {m.part for m in (test.manoeuvre for test in make(0, "held out"))} == {"held out"}


def test_manoeuvres_begin_and_end_straight_on_to_both_sides():
    for manoeuvre in MANOEUVRES:
        steer = steering(manoeuvre, 100.0)
        assert np.all(steer[:100] == 0.0)
        assert steer[-1] == 0.0
        assert np.max(steer) == pytest.approx(-np.min(steer), rel=0.01)
        assert 20.0 * np.max(steer) == pytest.approx(abs(manoeuvre.amplitude), rel=0.01)


def test_files_are_read_back_and_the_truth_lies_apart(tmp_path, monkeypatch):
    one = (Manoeuvre("sine", 12.0, 1.0, 0.5, 4.0),)
    monkeypatch.setattr("greybox_lab.virtual.synthetic_simrod.make", lambda seed: drive_manoeuvres(one, [seed]))
    (path,) = write(tmp_path, 5)
    recording, expected = read(str(path), "canonical"), drive(one, [5])[0]
    assert set(recording.signals) == READ
    assert np.allclose(recording["a_y"], expected.recording["a_y"], rtol=1e-7, atol=1e-7)
    header, *_ = (tmp_path / "truth" / path.name).read_text().splitlines()
    assert header.split(",")[:3] == ["time", "true_F_yf", "true_F_yr"]
