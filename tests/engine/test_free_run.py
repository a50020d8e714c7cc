"""Closed loop against naive loops."""

import numpy as np
import pytest
from toys import drive, scattered, speed_toy, tiny, without

from greybox_id.engine.series import runs
from greybox_id.engine.trace import Trace
from greybox_id.models.effects import steering_rate_limit

LOOPS = [tiny("msnn_full"), tiny("msnn_full_plus"), tiny("msnn_full") + steering_rate_limit.at(1.0), speed_toy()]


def loop(model, recording):
    (run,) = runs(Trace(model), recording)
    return run


def test_a_loop_of_one_state_is_its_recursion():
    model, recording = speed_toy(), drive(60)
    a, i = recording["a_x"][:2].tolist(), recording["motor_current"]
    for k in range(2, 60):
        a.append(0.6 * (0.2 * a[k - 2] + 0.8 * a[k - 1]) + 0.5 * i[k - 1])
    np.testing.assert_allclose(loop(model, recording).simulate(model.values)[:, 0], a, atol=1e-12)


@pytest.mark.parametrize("model", LOOPS, ids=range(len(LOOPS)))
def test_a_simulation_is_prediction_of_one_row_after_another(model):
    model = scattered(model, 1)
    run = loop(model, drive(40))
    nodes = run.measured.copy()
    for row in range(run.first, len(run)):
        nodes[row] = run.predict(model.values, nodes)[row - run.first]
    np.testing.assert_allclose(run.simulate(model.values), nodes, atol=1e-12)


def test_measurements_after_the_first_window_do_not_enter_a_simulation():
    model = scattered(tiny("msnn_full"))
    plain = drive(60)
    first = loop(model, plain).first
    changed = {n: np.where(np.arange(60) < first, plain[n], -plain[n] + 1) for n in ("yaw_rate", "a_x", "a_y")}
    both = [loop(model, r).simulate(model.values) for r in (plain, plain.with_signals(**changed))]
    assert np.array_equal(*both)


def test_a_fed_back_input_that_was_not_recorded_makes_no_difference():
    model = scattered(tiny("msnn_full"))
    whole, lacking = (loop(model, r).simulate(model.values) for r in (drive(60), without(drive(60), "a_y")))
    assert np.array_equal(whole, lacking)


def test_without_feedback_a_simulation_is_the_prediction():
    model = scattered(tiny("msnn_lat"))
    run = loop(model, drive(60))
    assert np.array_equal(run.simulate(model.values)[run.first :], run.predict(model.values))
