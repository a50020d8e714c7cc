"""Actuators and sensors against independent numpy."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from independent import rate_limited
from toys import DT, drive, joined, linear_toy, scattered, speed_toy, tiny

from greybox_id.base.errors import BadModel
from greybox_id.engine.elements import Sensing
from greybox_id.engine.series import runs
from greybox_id.engine.trace import Trace
from greybox_id.fitting.scores.memory import predictions
from greybox_id.models.effects import sensor_latency_imu, steering_rate_limit
from greybox_id.models.memory_model import SampledActuator


@given(st.floats(0.1, 20.0), st.integers(0, 99))
@settings(max_examples=30)
def test_a_rate_limit_is_an_independent_limiter(limit, seed):
    model = linear_toy(1).with_values(np.ones(1)) + steering_rate_limit.at(limit)
    recording = drive(50, seed)
    expected = rate_limited(recording["steer"], limit, DT)
    np.testing.assert_allclose(predictions(model, recording).predicted[:, 0], expected[:-1], atol=1e-12)


def test_a_rate_limit_starts_every_run_at_rest_on_its_first_command():
    model = linear_toy(1).with_values(np.ones(1)) + steering_rate_limit.at(0.5)
    recording = joined(30, 20)
    for protocol in ("honest", "published"):
        found = predictions(model, recording, protocol)
        expected = np.concatenate([rate_limited(part["steer"], 0.5, DT) for part in recording.each_run()])
        np.testing.assert_allclose(found.predicted[:, 0], expected[found.rows - 1], atol=1e-12)


def test_a_rate_limit_acts_on_a_whole_network_as_if_the_recording_had_been_limited():
    bare = scattered(tiny("msnn_full"))
    model = (bare + steering_rate_limit.at(0.8)).with_values(np.append(bare.values, 0.8))
    recording = drive(60)
    seen = recording.with_signals(steer=rate_limited(recording["steer"], 0.8, DT))
    for protocol in ("honest", "closed_loop"):
        a, b = predictions(model, recording, protocol).predicted, predictions(bare, seen, protocol).predicted
        np.testing.assert_allclose(a, b, atol=1e-12)


def test_the_first_actuator_added_is_nearest_the_command():
    plus = SampledActuator("steer", lambda state, command, p, dt: (state, command + 1))
    times = SampledActuator("steer", lambda state, command, p, dt: (state, command * 2))
    model = linear_toy(1).with_values(np.ones(1)).with_actuator(plus).with_actuator(times)
    recording = drive(10)
    np.testing.assert_allclose(predictions(model, recording).predicted[:, 0], 2 * (recording["steer"][:-1] + 1))


def test_an_actuator_before_a_fed_back_input_is_refused():
    model = speed_toy().with_actuator(SampledActuator("a_x", lambda state, command, p, dt: (state, command)))
    with pytest.raises(BadModel, match="feeds a_x back"):
        runs(Trace(model), drive())


def late(model, seconds):
    return model + sensor_latency_imu.at(seconds)


@pytest.mark.parametrize("samples", [0.0, 0.25, 1.0, 1.5, 3.9])
def test_latency_is_linear_interpolation_of_the_predictions(samples):
    bare = scattered(tiny("msnn_full"))
    model = late(bare, samples * DT)
    model = model.with_values(np.append(bare.values, samples * DT))
    recording = joined(50, 40)
    for protocol in ("honest", "closed_loop"):
        undelayed, delayed = (predictions(m, recording, protocol) for m in (bare, model))
        for run in (0, 1):
            own = undelayed.run == run
            time = np.arange(np.sum(own))
            for output in (0, 1):
                expected = np.interp(time - samples, time, undelayed.predicted[own, output])
                np.testing.assert_allclose(delayed.predicted[own, output], expected, atol=1e-12)


@pytest.mark.parametrize("dt", [0.05, 0.06, 0.047, 0.02])
@pytest.mark.parametrize("latency", [0.0, 0.013, 0.19, 0.2])
def test_a_late_sensor_does_not_change_a_constant(dt, latency):
    model = late(replace(linear_toy(), sample_time=dt), latency)
    y, _ = Sensing(model)(np.full((30, 1), 2.5), None, model.values)
    np.testing.assert_allclose(y, 2.5, atol=1e-12)


@pytest.mark.parametrize("latency", [0.0, 0.05, 0.07, 0.2])
def test_a_constant_does_not_tell_the_latency(latency):
    model = late(linear_toy(), latency)
    _, by_p = Sensing(model)(np.full((30, 1), 2.5), np.zeros((30, 1, model.size)), model.values)
    np.testing.assert_allclose(by_p[:, 0, -1], 0.0, atol=1e-12)


@pytest.mark.parametrize("latency", [0.0, 0.03])
def test_the_slope_by_the_latency_is_that_of_a_larger_latency(latency):
    model = linear_toy() + sensor_latency_imu
    sensing = Sensing(model)
    y = np.random.default_rng(0).standard_normal((30, 1))
    p, h = np.append(np.zeros(3), latency), 1e-6
    _, by_p = sensing(y, np.zeros((30, 1, 4)), p)
    slope = (sensing(y, None, p + h * np.eye(4)[3])[0] - sensing(y, None, p)[0]) / h
    np.testing.assert_allclose(by_p[:, :, 3], slope, atol=1e-5)
