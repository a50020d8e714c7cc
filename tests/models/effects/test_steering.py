"""The chain from steering command to road wheels."""

from types import SimpleNamespace

import numpy as np
import pytest
from driving import driven

from greybox_id.engine.motion.trace import MotionTrace
from greybox_id.models.effects import EFFECTS
from greybox_id.models.single_track import single_track


def at(**magnitudes):
    model = single_track()
    for name, magnitude in magnitudes.items():
        model = model + EFFECTS[name].at(magnitude)
    return model


def test_a_delay_of_no_whole_number_of_rows_is_that_delay():
    time = np.arange(60) / 50
    step = {"time": time, "steer": np.where(time < 0.2, 0.0, 0.05), "drive": np.zeros(60)}
    start = {"v_x": 20.0, "v_y": 0.0, "yaw_rate": 0.0}
    late = driven(at(steering_delay=0.033), step, start)["yaw_rate"]
    fine = np.arange(1200) / 1000
    at_once = {"time": fine, "steer": np.where(fine < 0.233 - 1e-9, 0.0, 0.05), "drive": np.zeros(1200)}
    expected = driven(single_track(), at_once, start)["yaw_rate"][::20]
    np.testing.assert_allclose(late, expected, atol=1e-5)


@pytest.mark.parametrize("order", [("steering_offset", "steering_lag"), ("steering_lag", "steering_offset")])
def test_an_offset_is_there_from_the_start_whatever_the_order(order):
    magnitudes = {"steering_offset": 0.02, "steering_lag": 0.1}
    model = at(**{name: magnitudes[name] for name in order})
    trace = MotionTrace(model)
    z = np.asarray(trace.start(("v_x", "yaw_rate"))([20.0, 0.0], [0.01, 0.0], model.values)).ravel()
    assert z[3] == 0.01
    bare = MotionTrace(single_track())
    expected = bare.rates(z[:3], [0.01, 0.03, 0.0, 0.0, 0.0], bare.model.values)
    found = trace.rates(z, [0.01, 0.01, 0.0, 0.0, 0.0], model.values)
    np.testing.assert_allclose(found, expected, rtol=1e-12)


def test_elements_act_in_the_order_in_which_they_were_added():
    """A step through a lag and then a limit starts slower than through the limit alone, and as slow as it at first."""
    step, seen = [0.01, 0.2, 0.0, 0.0, 0.0], {}
    for order in (("steering_lag", "steering_rate_limit"), ("steering_rate_limit", "steering_lag")):
        model = at(**{name: {"steering_lag": 0.05, "steering_rate_limit": 1.0}[name] for name in order})
        trace, z = MotionTrace(model), np.array([20.0, 0.0, 0.0, 0.0, 0.0])
        for _ in range(3):
            z = np.asarray(trace.step(z, step, model.values)).ravel()
        seen[order[0]] = z[3:]
    lagged, limited = seen["steering_lag"]
    assert lagged == pytest.approx(0.2 * (1 - np.exp(-0.03 / 0.05)))
    assert limited == pytest.approx(0.03, rel=0.02)
    limited, lagged = seen["steering_rate_limit"]
    assert limited == pytest.approx(0.03, rel=0.01)
    assert lagged == pytest.approx(0.03 - 0.05 * (1 - np.exp(-0.03 / 0.05)), rel=0.01)


# ---- a servo of second order


def servo_of(frequency, damping):
    model = single_track() + EFFECTS["steering_bandwidth"].at(frequency)
    return model.with_parameters(model["steering_damping"].with_value(damping))


def integrated(frequency, damping, command, seconds, steps=20000):
    """x'' = w^2 (u - x) - 2 d w x' from rest at zero, by the midpoint rule; where it is, its mean and first moment."""
    w, h, (x, v), path = 2 * np.pi * frequency, seconds / steps, (0.0, 0.0), []
    for k in range(steps):
        path.append(x)
        u = command((k + 0.5) * h)
        mid = x + h / 2 * v, v + h / 2 * (w**2 * (command(k * h) - x) - 2 * damping * w * v)
        x, v = x + h * mid[1], v + h * (w**2 * (u - mid[0]) - 2 * damping * w * mid[1])
    path.append(x)
    share = np.linspace(0, 1, steps + 1)
    mean, moment = np.trapezoid(path, share), np.trapezoid(path * share, share)
    return x, v, mean, 12 * (moment - mean / 2)


@pytest.mark.parametrize("damping", [0.3, 0.7, 0.95])
@pytest.mark.parametrize(("frequency", "seconds"), [(0.6, 0.02), (3.0, 0.02), (3.0, 0.3), (40.0, 0.02)])
@pytest.mark.parametrize("slope", [0.0, 1.5])
def test_a_servo_is_where_its_equation_has_it(frequency, damping, seconds, slope):
    lead, angle = servo_of(frequency, damping).actuators
    p = SimpleNamespace(steering_bandwidth=frequency, steering_damping=damping)
    command = (0.1, 0.1 + slope * seconds)
    x, v, mean, tilt = integrated(frequency, damping, lambda t: 0.1 + slope * t, seconds)
    after, line = angle.segment((0.0, 0.0), command, p, seconds)
    ahead, same = lead.segment((0.0, 0.0), command, p, seconds)
    assert same == command
    assert float(after) == pytest.approx(x, rel=1e-5, abs=1e-9)
    assert float(ahead) == pytest.approx(x + v / (2 * np.pi * frequency), rel=1e-5, abs=1e-9)
    begin, end = map(float, line)
    assert (begin + end) / 2 == pytest.approx(mean, rel=1e-4, abs=1e-9)
    assert end - begin == pytest.approx(tilt, rel=1e-3, abs=1e-8)


def test_a_servo_swings_past_its_command_as_its_damping_says():
    lead, angle = servo_of(4.0, 0.4).actuators
    p, state, seen = SimpleNamespace(steering_bandwidth=4.0, steering_damping=0.4), (0.0, 0.0), []
    for _ in range(200):
        x, a = (float(own) for own in (angle.segment(state, (0.1, 0.1), p, 0.005)[0],
                                       lead.segment(state[::-1], (0.1, 0.1), p, 0.005)[0]))  # fmt: skip
        state = (x, a)
        seen.append(x)
    past = 0.1 * np.exp(-np.pi * 0.4 / np.sqrt(1 - 0.4**2))
    assert max(seen) - 0.1 == pytest.approx(past, rel=2e-3)
    assert seen[-1] == pytest.approx(0.1, abs=1e-4)


def test_what_a_servo_does_at_once_is_its_speed():
    lead, angle = servo_of(4.0, 0.6).actuators
    p = SimpleNamespace(steering_bandwidth=4.0, steering_damping=0.6)
    w, x, v, u, h = 2 * np.pi * 4.0, 0.03, 0.2, 0.1, 1e-9
    state = (x, x + v / w)
    assert float(angle.moves(state, u, p, h)) / h == pytest.approx(v, rel=1e-6)
    speed = v + (w**2 * (u - x) - 2 * 0.6 * w * v) / w
    assert float(lead.moves(state[::-1], u, p, h)) / h == pytest.approx(speed, rel=1e-6)
    assert float(angle.after(state, u, p, h)) == pytest.approx(x, abs=1e-8)


def test_a_slow_step_of_a_drive_is_the_servos_in_pieces():
    """Segments of any length leave the same motion: nothing is lost where series end and formulas begin."""
    time = np.arange(80) / 40
    step = {"time": time, "steer": np.where(time < 0.2, 0.0, 0.05), "drive": np.zeros(80)}
    start = {"v_x": 20.0, "v_y": 0.0, "yaw_rate": 0.0}
    coarse = driven(servo_of(1.5, 0.5), step, start)["yaw_rate"]
    fine = np.arange(2000) / 1000
    at_once = {"time": fine, "steer": np.where(fine < 0.2 - 1e-9, 0.0, 0.05), "drive": np.zeros(2000)}
    expected = driven(servo_of(1.5, 0.5), at_once, start)["yaw_rate"][::25]
    np.testing.assert_allclose(coarse, expected, atol=2e-5)
    assert np.max(expected) > 1.01 * expected[-1]
