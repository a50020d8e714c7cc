"""Hybrid models before training are plain linear vehicles; their settings are checked."""

from dataclasses import replace

import numpy as np
import pytest
from linear_bicycle import SIMROD, VEHICLE, recorded, sine, steps

from greybox_id.base.errors import BadInput, BadModel
from greybox_id.engine.hybrid.cell import free_run
from greybox_id.engine.hybrid.problem import drawn
from greybox_id.models.hybrid import SLOPE, HybridSettings, hybrid_force, hybrid_stiffness
from greybox_id.models.registry import build, prepared
from greybox_id.models.single_track import G

BOTH = ("hybrid_stiffness", "hybrid_force")
L = SIMROD["l_f"] + SIMROD["l_r"]
C_F = SLOPE * SIMROD["m"] * G * SIMROD["l_r"] / L
C_R = SLOPE * SIMROD["m"] * G * SIMROD["l_f"] / L


@pytest.mark.parametrize("name", BOTH)
@pytest.mark.parametrize("steer", [steps(0.02), sine(0.02, 1.0)], ids=["step", "sine"])
def test_untrained_they_are_a_linear_single_track(name, steer):
    recording = recorded(steer, 12.0, C_F, C_R)
    found = free_run(build(name, vehicle=VEHICLE), recording)
    for signal in ("v_y", "yaw_rate", "a_y"):
        error = found[signal] - recording[signal]
        assert np.sqrt(np.mean(error**2)) < 0.01 * np.max(np.abs(recording[signal]))


@pytest.mark.parametrize("name", BOTH)
def test_forces_are_stiffness_times_slip(name):
    found = free_run(build(name, vehicle=VEHICLE), recorded(steps(0.03), 12.0, C_F, C_R))
    told = np.isfinite(found["C_alpha_f"])
    assert np.any(told)
    assert np.array_equal(told, np.abs(found["alpha_f"]) >= 0.01)
    assert np.allclose(found["C_alpha_f"][told], C_F, rtol=1e-9)
    assert np.allclose(found["F_yr"], C_R * found["alpha_r"], rtol=1e-9)


def test_slow_samples_are_cut_into_steps_that_stay_stable():
    slow = recorded(sine(0.02, 0.5, 60, 20.0), 8.0, C_F, C_R, rate=20.0)
    assert build("hybrid_stiffness", {"sample_time": 0.05}).substeps == 4
    found = free_run(build("hybrid_stiffness", {"sample_time": 0.05}, vehicle=VEHICLE), slow)
    assert np.max(np.abs(found["yaw_rate"] - slow["yaw_rate"])) < 0.02 * np.max(np.abs(slow["yaw_rate"]))


def test_the_networks_size_is_the_papers():
    model = hybrid_stiffness()
    assert [model[f"W_{k}"].shape[0] for k in (1, 2, 3)] == [25, 15, 10]
    assert hybrid_force()["W_out"].shape == (2, 10)


def test_speed_and_sample_time_are_set_from_the_training_recording():
    model = prepared("hybrid_force", recorded(steps(0.02), 12.0, C_F, C_R, rate=50.0))
    assert model.sample_time == pytest.approx(0.02)
    assert model.settings["speed"] == pytest.approx(12.0)


@pytest.mark.parametrize(
    ("settings", "told"),
    [({"warm_up": 60}, "warm_up"), ({"hidden": (2.5,)}, "whole numbers"), ({"window": 1}, "window")],
)
def test_settings_that_cannot_be_are_refused_in_a_sentence(settings, told):
    with pytest.raises(BadInput, match=told):
        HybridSettings(**settings)


def test_a_recording_without_speed_is_refused_in_a_sentence():
    slow = recorded(steps(0.02), 2.0, C_F, C_R)
    with pytest.raises(BadInput, match="nowhere faster than 3 m/s"):
        prepared("hybrid_force", slow)


def test_a_window_must_be_longer_than_its_warm_up():
    with pytest.raises(BadModel, match="warm_up"):
        replace(hybrid_force(), warm_up=60)


def a_trained(name, **settings):
    """With weights that say something."""
    model = build(name, settings, vehicle=VEHICLE)
    return model.with_values(drawn(model, 3))


def test_a_car_that_is_the_same_in_a_mirror_turns_alike_to_either_side():
    drive = recorded(steps(0.03), 12.0, C_F, C_R)
    for symmetric, alike in ((True, True), (False, False)):
        model = a_trained("hybrid_stiffness", symmetric=symmetric)
        left, right = free_run(model, drive), free_run(model, drive.mirrored())
        assert np.allclose(left["F_yf"], -right["F_yf"], atol=1e-6 * np.max(np.abs(left["F_yf"]))) == alike


@pytest.mark.parametrize("name", BOTH)
def test_other_tyres_are_similar(name):
    """F(alpha) = grip F0(stiffness / grip alpha): a slope of `stiffness` and a peak of `grip` times the old ones."""
    model, same = a_trained(name), {"stiffness_scale_r": 1.0, "grip_scale_r": 1.0}
    drive = recorded(0.03 + sine(0.01, 1.0), 12.0, C_F, C_R)
    before = free_run(model, drive)
    assert abs(before["F_yf"][0]) > 500.0
    scaled = {"stiffness_scale_f": 0.6, "grip_scale_f": 0.6, **same}
    after = free_run(model.with_parameters(*(model[n].with_value(v) for n, v in scaled.items())), drive)
    assert after["F_yf"][0] == pytest.approx(0.6 * before["F_yf"][0])  # of a state that is still the same
    assert after["F_yr"][0] == pytest.approx(before["F_yr"][0])


@pytest.mark.parametrize("name", BOTH)
def test_offsets_are_of_what_is_read(name):
    model, drive = build(name, vehicle=VEHICLE), recorded(steps(0.03), 12.0, C_F, C_R)
    off = model.with_parameters(model["steering_offset"].with_value(0.01), model["accel_bias_y"].with_value(0.3))
    less = replace(drive, signals={**drive.signals, "steer": drive["steer"] - 0.01})
    before, after = free_run(model, drive), free_run(off, less)
    assert np.allclose(after["yaw_rate"], before["yaw_rate"])
    assert np.allclose(after["a_y"], before["a_y"] + 0.3)


def test_brakes_shift_loads_and_take_their_share_of_the_friction():
    stated = {"h_cg": 0.45, "brake_split_front": 0.6, "drive_split_front": 0.0, "mu_f": 0.9, "mu_r": 0.8}
    model = build("hybrid_stiffness", {"longitudinal": True}, vehicle=VEHICLE)
    model = model.with_parameters(*(model[name].with_value(value) for name, value in stated.items()))
    assert "a_x" in model.inputs
    a_x = np.repeat([0.0, -4.0, 2.0], 100)
    drive = recorded(steps(0.03), 12.0, C_F, C_R)
    found = free_run(model, replace(drive, signals={**drive.signals, "a_x": a_x}))
    for now, axle, arm, sign, share in ((1, "f", "l_r", 1, 0.6), (1, "r", "l_f", -1, 0.4), (2, "r", "l_f", 1, 1.0)):
        force = [0.0, 4.0, 2.0][now] * SIMROD["m"]
        rest = SIMROD["m"] * G * SIMROD[arm] / L
        grown = 1.0 + sign * force * 0.45 / L / rest  # a tyre's slope and friction grow less than its load
        left = np.sqrt(1.0 - (share * force / (stated[f"mu_{axle}"] * rest * grown**0.85)) ** 2)
        told = found[f"C_alpha_{axle}"][100 * now : 100 * now + 100]
        assert np.nanmax(np.abs(told / (SLOPE * rest * grown**0.64 * left) - 1.0)) < 1e-3
