"""Equations as plain functions: against the engine's own trace, and their derivatives against small steps."""

import numpy as np
import pytest
from exported import EFFECTS, MOTION, motion, points

from greybox_id.export.equations import Equations

SMOOTH = ("steering_lag", "tyre_relaxation", "roll_dynamics", "longitudinal_load_transfer")


@pytest.mark.parametrize("name", MOTION)
def test_a_short_step_goes_along_the_derivative(name):
    e = Equations(motion(name))
    x, u = points(e, 20)
    for state, inputs in zip(x + [5.0 if own.name == "v_x" else 0.0 for own in e.states], u, strict=True):
        moved = (np.array(e.step(state, inputs, e.values, 1e-6)).ravel() - state) / 1e-6
        rate = np.array(e.ode(state, inputs, e.values)).ravel()
        np.testing.assert_allclose(moved, rate, rtol=1e-3, atol=1e-3 * np.max(np.abs(rate)))


@pytest.mark.parametrize("effect", SMOOTH)
def test_actuators_and_relaxed_quantities_are_states_with_derivatives(effect):
    e = Equations(motion("single_track on pacejka", [effect]))
    state = np.array([10.0, 0.2, 0.3, *[0.01] * (len(e.states) - 3)])
    rate = np.array(e.ode(state, [0.05, 1.0], e.values)).ravel()
    moved = (np.array(e.step(state, [0.05, 1.0], e.values, 1e-6)).ravel() - state) / 1e-6
    np.testing.assert_allclose(moved, rate, rtol=1e-3, atol=1e-3 * np.max(np.abs(rate)))


def test_no_lag_at_all_stays_finite():
    model = motion("single_track on pacejka", ["steering_lag"])
    e = Equations(model.with_parameters(model["steering_lag"].with_value(np.array(0.0))))
    assert np.all(np.isfinite(np.array(e.ode([10.0, 0, 0, 0.0], [0.1, 0.0], e.values))))


def test_parameters_that_do_not_move_are_constants():
    model = motion("single_track on pacejka")
    few, whole = Equations(model, ["I_z", "B_f"]), Equations(model)
    assert [parameter.name for parameter in few.parameters] == ["I_z", "B_f"]
    x, u = [12.0, 0.1, 0.2], [0.04, 0.5]
    np.testing.assert_array_equal(few.step(x, u, few.values, 0.02), whole.step(x, u, whole.values, 0.02))
    assert few.step.n_instructions() < whole.step.n_instructions()


def test_late_commands_and_readings_are_named():
    e = Equations(motion("single_track on pacejka", ["steering_delay", "sensor_latency_imu"]))
    assert e.delayed == ("steer",)
    assert set(e.late) == {"yaw_rate", "a_x", "a_y"}
    np.testing.assert_allclose(np.array(e.delays(e.values)).ravel(), [EFFECTS["steering_delay"]])
    np.testing.assert_allclose(np.array(e.latencies(e.values)).ravel(), [EFFECTS["sensor_latency_imu"]] * 3)


def test_entries_have_units():
    e = Equations(motion("single_track on pacejka", ["steering_lag", "tyre_relaxation"]))
    assert [state.unit for state in e.states] == ["m/s", "m/s", "rad/s", "rad", "rad", "rad"]
    assert all(own.unit for own in (*e.inputs, *e.parameters, *e.outputs))
