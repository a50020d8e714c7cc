"""What holds for every effect on every model of equations of motion that it concerns."""

from dataclasses import replace
from functools import cache

import casadi as cs
import numpy as np
import pytest

from greybox_id.base.errors import BadModel
from greybox_id.engine.motion.trace import MotionTrace
from greybox_id.models.effects import EFFECTS
from greybox_id.models.longitudinal import longitudinal
from greybox_id.models.single_track import kinematic, lateral, single_track
from greybox_id.models.tyres import TYRES

INF = np.inf
TABLE = {
    "grip_scale": (1, "1"), "front_stiffness": (1, "1"), "rear_stiffness": (1, "1"), "tyre_relaxation": (0, "m"),
    "combined_slip": (0, "1"), "load_sensitivity": (0, "1"), "longitudinal_load_transfer": (0, "1"),
    "tyre_temperature": (0, "1"), "mass_change": (1, "1"), "cog_shift": (0, "m"), "yaw_inertia": (1, "1"),
    "roll_dynamics": (0, "rad s^2/m"), "steering_delay": (0, "s"), "steering_lag": (0, "s"),
    "steering_bandwidth": (INF, "Hz"),
    "steering_rate_limit": (INF, "rad/s"), "steering_offset": (0, "rad"), "steering_ratio": (1, "1"),
    "steering_backlash": (0, "rad"), "steering_jerk_limit": (INF, "m/s^3"), "sensor_quantisation": (0, "rad"),
    "steering_compliance": (0, "rad"), "motor_lag": (0, "s"), "motor_saturation": (INF, "m/s^2"),
    "motor_gain": (1, "1"),
    "brake_bias": (0, "1"), "aero_drag": (0, "N s^2/m^2"), "rolling_resistance": (0, "N"), "road_slope": (0, "rad"),
    "road_bank": (0, "rad"), "wind_gust": (0, "m/s"), "downforce": (0, "N s^2/m^2"), "yaw_rate_bias": (0, "rad/s"),
    "yaw_rate_scale": (1, "1"), "accel_bias_x": (0, "m/s^2"), "accel_bias_y": (0, "m/s^2"),
    "imu_mount_pitch": (0, "rad"), "imu_mount_roll": (0, "rad"), "imu_mount_yaw": (0, "rad"),
    "imu_lever_arm": (0, "m"), "velocity_lever_arm": (0, "m"), "velocity_mount_yaw": (0, "rad"),
    "wheel_speed_scale": (1, "1"), "sensor_latency_yaw": (0, "s"), "sensor_latency_vx": (0, "s"),
    "sensor_latency_imu": (0, "s"), "timestamp_jitter": (0, "s"), "dropped_samples": (0, "1"),
}  # fmt: skip
"""Null value and unit, as specified."""

EVERY_MODEL = {
    **{f"single_track {name}": single_track(tyre) for name, tyre in TYRES.items()},
    **{f"lateral {name}": lateral(tyre) for name, tyre in TYRES.items()},
    "longitudinal": longitudinal(),
    "kinematic": kinematic(),
}
CASES = [(m, e) for m, model in EVERY_MODEL.items() for e, effect in EFFECTS.items() if effect.concerns(model)]
MAIN_CASES = [(m, e) for m, e in CASES if m in ("single_track pacejka", "longitudinal")]
MAIN_CASES += [("lateral pacejka", "steering_jerk_limit")]
FEWER_CASES = [(m, e) for m, e in CASES if m.split()[-1] not in ("dugoff", "brush")]
NOT_ON_LATERAL = {
    "motor_lag", "motor_gain", "motor_saturation", "brake_bias", "aero_drag", "rolling_resistance", "road_slope",
    "combined_slip", "longitudinal_load_transfer", "wind_gust", "accel_bias_x", "imu_mount_pitch", "imu_mount_yaw",
}  # fmt: skip
ON_LONGITUDINAL = {
    "grip_scale", "motor_lag", "motor_gain", "motor_saturation", "aero_drag", "rolling_resistance", "mass_change",
    "road_slope", "wind_gust", "accel_bias_x", "imu_mount_pitch", "wheel_speed_scale", "sensor_latency_vx",
    "sensor_latency_imu", "timestamp_jitter", "dropped_samples",
}  # fmt: skip
RANGES = {
    "v_x": (3.0, 40.0), "v_y": (-1.0, 1.0), "yaw_rate": (-0.6, 0.6), "friction_work": (0.0, 2e4),
    "steer": (-0.15, 0.15), "drive": (-5.0, 4.0), "road_slope": (-0.1, 0.1),
}  # fmt: skip
NOT_ON_SINGLE_TRACK = {"steering_jerk_limit"}
"""Its limit goes with the speed, which has to be an input."""
LAGS = ("steering_lag", "motor_lag", "tyre_relaxation")
"""A reading just after a command is a step in these at the null: only motion is smooth."""


@cache
def traced(model, effect=None):
    chosen = EVERY_MODEL[model]
    return MotionTrace(chosen + EFFECTS[effect] if effect else chosen)


def points(trace, count=8, seed=0):
    """Random z, s, p: states, and commands that jump at a segment's beginning and move within."""
    rng, model = np.random.default_rng(seed), trace.model

    def drawn(name):
        return rng.uniform(*RANGES.get(name, (-1.0, 1.0)))

    for _ in range(count):
        z = [drawn(state.name) for state in model.states] + [drawn(actuator.signal) for actuator in model.actuators]
        z += [0.05 * rng.standard_normal() for _ in model.relaxations]
        u = [drawn(name) for name in model.inputs]
        slope = [drawn(name) for name in model.inputs]
        shift = rng.choice([-1.0, 0.0, 1.0], 2 * trace.shift_count)
        guess = np.asarray(trace.timing(model.values)).ravel()
        yield np.array(z), np.concatenate([[0.01], u, slope, shift, guess]), model.values


def test_effects_are_those_specified_and_say_what_they_mean():
    found = {name: (float(effect.parameter.array), effect.parameter.unit) for name, effect in EFFECTS.items()}
    assert found == TABLE
    for name, effect in EFFECTS.items():
        assert effect.name == effect.parameter.name == name
        assert effect.parameter.about
        assert effect.group in ("steering", "drive", "tyres", "body", "road", "sensors", "timing")
        low, high = effect.parameter.bounds
        assert low <= effect.typical <= high
        assert effect.typical != effect.parameter.array
        assert all(own.fixed and own.about and own.name.startswith(name.split("_")[0]) for own in effect.others)


@pytest.mark.parametrize("model", EVERY_MODEL)
def test_effects_that_change_readings_alone_leave_the_motion(model):
    bare = EVERY_MODEL[model]
    for effect in (one for one in EFFECTS.values() if one.concerns(bare) and not {*bare.inputs} & {*one.touches}):
        changed = bare + effect
        of_readings = {
            name: getattr(bare, name) for name in ("sensors", "latencies", "parameters", "effects", "origins")
        }
        assert (replace(changed, **of_readings) == bare) == effect.reads_only, effect.name


def test_a_diagnosis_tries_what_looks_like_another_effect_only_where_it_is_named():
    assert {name for name, effect in EFFECTS.items() if effect.by_name} == {
        "steering_jerk_limit", "sensor_quantisation", "steering_compliance", "velocity_mount_yaw",
    }  # fmt: skip


def test_effects_concern_the_models_on_which_they_make_sense():
    def concerned(model):
        return {name for name, effect in EFFECTS.items() if effect.concerns(EVERY_MODEL[model])}

    assert concerned("single_track pacejka") == set(EFFECTS) - NOT_ON_SINGLE_TRACK
    assert concerned("lateral pacejka") == set(EFFECTS) - NOT_ON_LATERAL
    assert concerned("longitudinal") == ON_LONGITUDINAL


@pytest.mark.parametrize(("model", "effect"), CASES)
def test_a_null_effect_leaves_every_model_unchanged(model, effect):
    bare, more = traced(model), traced(model, effect)
    states, actuators = len(bare.model.states), len(bare.model.actuators)
    inputs = 1 + 2 * len(bare.model.inputs)
    own = [*range(states), *(len(more.model.states) + k for k in range(actuators))]  # the bare model's part of z
    for z, s, p in points(more):
        at = (z[own], s[:inputs], p[: bare.model.size])
        step, output = (np.asarray(f(z, s, p)).ravel() for f in (more.step, more.output))
        np.testing.assert_allclose(step[own], np.asarray(bare.step(*at)).ravel(), atol=1e-12, rtol=1e-12)
        np.testing.assert_allclose(output, np.asarray(bare.output(*at)).ravel(), atol=1e-12, rtol=1e-12)


def test_all_effects_at_once_at_their_null_leave_the_single_track_unchanged():
    full = EVERY_MODEL["single_track pacejka"]
    names = [name for name in EFFECTS if name not in NOT_ON_SINGLE_TRACK]
    for name in names:
        full = full + EFFECTS[name]
    assert full.effects == tuple(names)
    bare, more = traced("single_track pacejka"), MotionTrace(full)
    for z, s, p in points(more, 3):
        at = (z[:3], s[:5], p[: bare.model.size])
        np.testing.assert_allclose(np.asarray(more.step(z, s, p))[:3], bare.step(*at), atol=1e-11)
        np.testing.assert_allclose(more.output(z, s, p), bare.output(*at), atol=1e-10)


@cache
def by_the_magnitude(model, effect):
    """(z, s, p) -> step and output stacked, and their derivative by the effect's magnitude."""
    trace = traced(model, effect)
    z, s, p = (cs.SX.sym(name, trace.step.numel_in(k)) for k, name in enumerate("zsp"))
    stacked = cs.vertcat(trace.step(z, s, p), trace.output(z, s, p))
    k = [parameter.name for parameter in trace.model.parameters].index(effect)
    slope = cs.jacobian(stacked, p)[:, k]
    return cs.Function("stacked", [z, s, p], [stacked]), cs.Function("slope", [z, s, p], [slope]), k


def difference(value, p, k, h, one_sided):
    """A derivative by differences of second order."""
    up, down, further = (np.array(p, float) for _ in range(3))
    up[k] += h
    down[k] -= h
    further[k] += 2 * h
    if one_sided:
        return (4 * value(up) - 3 * value(p) - value(further)) / (2 * h)
    return (value(up) - value(down)) / (2 * h)


@pytest.mark.parametrize(("model", "effect"), MAIN_CASES)
@pytest.mark.parametrize("where", ["null", "typical"])
def test_the_derivative_by_the_magnitude_is_that_of_differences(model, effect, where):
    stacked, slope, k = by_the_magnitude(model, effect)
    magnitude = EFFECTS[effect].parameter
    value = float(magnitude.array) if where == "null" else EFFECTS[effect].typical
    if (effect, where) == ("sensor_quantisation", "null"):
        pytest.skip("what is left of steps jumps about ever faster as they vanish")
    states = traced(model, effect).size
    for z, s, p in points(traced(model, effect)):
        p = p.copy()
        p[k] = value
        s[len(s) - traced(model, effect).shift_count :] = np.asarray(traced(model, effect).timing(p)).ravel()
        found = np.asarray(slope(z, s, p)).ravel()
        assert np.all(np.isfinite(found))
        if np.isinf(value):
            assert not np.any(found)
            continue
        h = 1e-5 * abs(EFFECTS[effect].typical - float(magnitude.array) if where == "null" else value)
        expected = difference(
            lambda q, z=z, s=s: np.asarray(stacked(z, s, q)).ravel(), p, k, h, value == magnitude.bounds[0]
        )
        compared = slice(0, states if effect in LAGS and where == "null" else None)
        scale = 1e-7 + 1e-13 / h + 1e-4 * np.max(np.abs(expected[compared]))
        np.testing.assert_allclose(found[compared], expected[compared], rtol=2e-3, atol=scale)


@pytest.mark.parametrize(("model", "effect"), FEWER_CASES)
def test_derivatives_by_everything_are_finite_at_rest_and_in_segments_without_length(model, effect):
    trace = traced(model, effect)
    z, s, p = (cs.SX.sym(name, trace.step.numel_in(k)) for k, name in enumerate("zsp"))
    stacked = cs.vertcat(trace.step(z, s, p), trace.output(z, s, p))
    J = cs.Function("J", [z, s, p], [cs.jacobian(stacked, cs.vertcat(z, p))])
    for state, segment, values in points(trace, 2):
        for rest in (False, True):
            for length in (0.0, 0.01):
                at = segment.copy()
                at[0] = length
                assert np.all(np.isfinite(np.asarray(J(0 * state if rest else state, 0 * at if rest else at, values))))


def test_an_effect_where_it_makes_no_sense_is_refused_in_a_sentence():
    with pytest.raises(BadModel, match="imu_lever_arm acts on a_x and a_y and needs yaw_rate, but model longitudinal"):
        _ = longitudinal() + EFFECTS["imu_lever_arm"]
    with pytest.raises(BadModel, match="already has the effect grip_scale"):
        _ = single_track() + EFFECTS["grip_scale"] + EFFECTS["grip_scale"]
