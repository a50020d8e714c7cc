"""Diagnoses of maps with memory: effects are found, and what training left is no gap."""

import numpy as np
import pytest
from memory_cases import CARRIED, FITTED, NOISE, made
from toys import drive, tiny, without

from greybox_id.base.errors import BadInput
from greybox_id.gap.diagnosis import diagnose
from greybox_id.models.effects import EFFECTS


@pytest.mark.parametrize(
    ("name", "effect", "value", "off"),
    [("msnn_lat", "steering_rate_limit", 0.8, 0.08), ("msnn_full", "sensor_latency_imu", 0.03, 0.006)],
)
def test_an_effect_is_found_and_closes_the_gap_on_another_recording(name, effect, value, off):
    model = tiny(name)
    one, other = (made(model, {effect: value}, seed) for seed in (0, 1))
    found = diagnose(model, [one], EFFECTS, vehicle=FITTED, held_out=[other])
    assert found.gap_detected
    assert found.applied == (effect,)
    assert found.ranking[0].effect == effect
    assert abs(found.ranking[0].magnitude - value) < off
    assert found.unknown_probability < 0.2
    assert found.held_out.closed > 0.8
    assert found.closed.effects == (effect,)
    horizons = {own.horizon for own in found.held_out.errors}
    assert horizons == ({None} if model.feedback is None else {None, 0.05})


def test_two_effects_are_found_together():
    model = tiny("msnn_lat")
    found = diagnose(
        model, [made(model, {"steering_rate_limit": 0.8, "sensor_latency_imu": 0.04})], EFFECTS, vehicle=FITTED
    )
    assert set(found.applied) == {"steering_rate_limit", "sensor_latency_imu"}


@pytest.mark.parametrize("seed", range(2))
def test_the_map_s_own_recording_alarms_nobody(seed):
    model = tiny("msnn_full")
    found = diagnose(model, [made(model, seed=seed)], EFFECTS, vehicle=FITTED)
    assert not found.gap_detected
    assert found.applied == ()
    assert found.p_value > 1e-3
    assert found.unknown_probability < 0.1


def test_what_no_effect_of_a_map_does_is_a_gap_without_a_name():
    model = tiny("msnn_lat")
    drives = made(model)
    swaying = drives["steer"] + 0.08 * np.sin(4.0 * drives.time)
    found = diagnose(model, [drives.with_signals(steer=swaying)], EFFECTS, vehicle=FITTED)
    assert found.gap_detected
    assert found.applied == ()
    assert found.unknown_probability > 0.9


def test_a_gap_is_what_exceeds_what_training_left():
    """Errors that last, such as training leaves, are no gap as long as they are no larger; nor is jitter looked for."""
    model = tiny("msnn_full")
    drives = made(model, noise=0.1)
    rng = np.random.default_rng(3)
    slow = [np.convolve(rng.standard_normal(len(drives) + 9), np.ones(10) / np.sqrt(10), "valid") for _ in range(2)]
    lasting = {name: drives[name] + NOISE[name] * own for name, own in zip(model.outputs, slow, strict=True)}
    found = diagnose(model, [drives.with_signals(**lasting)], EFFECTS, vehicle=FITTED)
    assert not found.gap_detected
    assert found.gap.before == pytest.approx(1.0, abs=0.25)
    assert {own.effect for own in found.ranking} <= CARRIED


def test_what_training_left_is_no_less_where_a_recording_has_less():
    model = tiny("msnn_full")
    found = diagnose(model, [made(model, noise=0.5)], EFFECTS, vehicle=FITTED)
    assert not found.gap_detected
    assert found.gap.before == pytest.approx(0.25, abs=0.05)


def test_a_model_s_own_effect_may_differ():
    """The rate limit that MS-NN-full-plus has by its settings is a candidate at its own value."""
    model = tiny("msnn_full_plus")
    assert "steering_rate_limit" in model.effects
    slower = model.with_parameters(model["steering_rate_limit"].with_value(0.8))
    found = diagnose(model, [made(slower)], EFFECTS, vehicle=FITTED)
    assert found.applied == ("steering_rate_limit",)
    assert found.ranking[0].magnitude == pytest.approx(0.8, abs=0.1)
    assert float(found.closed["steering_rate_limit"].array) == pytest.approx(0.8, abs=0.1)


def test_an_input_that_is_fed_back_need_not_be_recorded():
    """Lateral acceleration follows from yaw rate and speed: regimes are told by what the map makes of it."""
    model = tiny("msnn_full")
    drives = made(model, {"sensor_latency_imu": 0.05})
    found = diagnose(model, [without(drives, "a_y")], EFFECTS, vehicle=FITTED, held_out=[without(drives, "a_y")])
    assert found.applied == ("sensor_latency_imu",)
    assert found.where.regimes["lateral"][0] > 0


def test_a_recording_that_does_not_suit_is_refused():
    for recording in (without(drive(60), "motor_current"), drive(4)):
        with pytest.raises(BadInput):
            diagnose(tiny("msnn_full"), [recording], EFFECTS)
