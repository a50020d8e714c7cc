"""The chain from steering command to road wheels."""

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
