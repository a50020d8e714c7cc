"""Effects together: in any order, on equations of motion."""

from itertools import combinations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from greybox_id.engine.motion.trace import MotionTrace
from greybox_id.models.effects import EFFECTS
from greybox_id.models.single_track import single_track

CHAIN = {"steering_backlash", "steering_rate_limit", "steering_lag", "steering_bandwidth", "steering_delay"}
READINGS = {
    "yaw_rate_bias", "yaw_rate_scale", "accel_bias_x", "accel_bias_y", "imu_mount_pitch", "imu_mount_roll",
    "imu_mount_yaw", "imu_lever_arm", "velocity_lever_arm", "velocity_mount_yaw", "wheel_speed_scale", "roll_dynamics",
}  # fmt: skip
LOADS = {"downforce", "longitudinal_load_transfer"}
COMMAND = {"steering_offset", "steering_ratio", "sensor_quantisation", "steering_compliance"}
BARE = single_track()
NAMES = [name for name, effect in EFFECTS.items() if effect.concerns(BARE)]


def at_typical(*names):
    model = BARE
    for name in names:
        model = model + EFFECTS[name].at(EFFECTS[name].typical)
    return model


def at_points(model, count=3, seed=0):
    """Readings and the three states after a step, at random states and commands; states that effects add are zero."""
    rng, trace = np.random.default_rng(seed), MotionTrace(model)
    for _ in range(count):
        z = np.zeros(trace.size)
        z[:3] = rng.uniform([5, -0.5, -0.5], [30, 0.5, 0.5])
        u, slope = rng.uniform([-0.1, -4], [0.1, 3]), rng.uniform([-0.2, -4], [0.2, 3])
        guess = np.asarray(trace.timing(model.values)).ravel()
        s = np.concatenate([[0.01], u, slope, np.zeros(2 * trace.shift_count), guess])
        after, read = (np.asarray(f(z, s, model.values)).ravel() for f in (trace.step, trace.output))
        yield np.concatenate([after[:3], read])


def commute(a, b):
    """Whether the order makes no difference."""
    return not any({a, b} <= group for group in (CHAIN, READINGS, LOADS, COMMAND))


def examine(a, b):
    one, other = at_typical(a, b), at_typical(b, a)
    assert one.effects == (a, b)
    assert other.effects == (b, a)
    for x, y in zip(at_points(one), at_points(other), strict=True):
        assert np.all(np.isfinite(x))
        assert np.all(np.isfinite(y))
        if commute(a, b):
            np.testing.assert_allclose(x, y, rtol=1e-9, atol=1e-9)


PAIRS = list(combinations(NAMES, 2))


@given(st.sampled_from(PAIRS))
@settings(max_examples=25)
def test_two_effects_compose_in_either_order(pair):
    examine(*pair)


@pytest.mark.examination
@pytest.mark.slow
def test_any_two_effects_compose_in_either_order():
    for a, b in PAIRS:
        examine(a, b)


@given(st.permutations(NAMES))
@settings(max_examples=3)
def test_all_effects_compose_in_any_order(names):
    model = at_typical(*names)
    assert model.effects == tuple(names)
    assert all(np.all(np.isfinite(found)) for found in at_points(model))


def test_an_effect_twice_as_far_is_another_model_and_leaves_the_first_alone():
    model = at_typical("grip_scale")
    again = model.with_values(model.values * np.where([p.name == "grip_scale" for p in model.parameters], 0.5, 1.0))
    assert model["grip_scale"].array == EFFECTS["grip_scale"].typical
    assert any(np.any(np.abs(x - y) > 1e-3) for x, y in zip(at_points(model), at_points(again), strict=True))
