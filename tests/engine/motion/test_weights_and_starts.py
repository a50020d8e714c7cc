"""Weights of single readings, and how starts are taken back through sensors that see derivatives."""

import numpy as np
import pytest

from greybox_id.datasets.recording import Recording
from greybox_id.engine.motion.shooting import MotionProblem
from greybox_id.engine.motion.simulator import Simulator
from greybox_id.models.single_track import lateral

NOISE = np.array([0.1, 0.01, 0.2])


@pytest.fixture
def recording():
    time = 0.02 * np.arange(60)
    random = np.random.default_rng(1)
    steer = 0.03 * np.sin(4 * time)
    readings = {n: s * random.standard_normal(60) for n, s in zip(("v_y", "yaw_rate", "a_y"), NOISE, strict=True)}
    return Recording("drive", time, {"steer": steer, "v_x": np.full(60, 15.0), **readings})


def problem(recording, **more):
    return MotionProblem(Simulator(lateral(), compiled=False), [recording], noise=NOISE, starts="measured", **more)


def test_weights_of_readings_scale_squares_output_by_output(recording):
    plain = problem(recording)
    nodes = plain.simulated_nodes(plain.start)
    squares = np.nansum((plain.errors(nodes) / NOISE) ** 2, axis=0)
    weights = np.array([2.0, 0.0, 0.5])
    weighted = problem(recording, keep=[np.tile(weights, (60, 1))])
    assert weighted.misfit(weighted.start, nodes) == pytest.approx(0.5 * squares @ weights)


def test_a_weight_per_row_is_the_same_as_that_weight_for_every_output(recording):
    rows = np.linspace(0.0, 3.0, 60)
    by_row, by_reading = (problem(recording, keep=[keep]) for keep in (rows, np.tile(rows[:, None], (1, 3))))
    np.testing.assert_array_equal(by_row.weight, by_reading.weight)


def test_weighing_gives_the_problem_that_was_stated_with_these_weights(recording):
    keep = [np.random.default_rng(2).uniform(0, 2, (60, 3))]
    plain, stated = problem(recording), problem(recording, keep=keep)
    weighed, x = plain.weighing(keep), plain.start
    found, expected = (p.normal_equations(x, p.simulated_nodes(x)) for p in (weighed, stated))
    np.testing.assert_allclose(found.H, expected.H, rtol=1e-12)
    np.testing.assert_allclose(found.g, expected.g, rtol=1e-12)
    np.testing.assert_array_equal(plain.weight, problem(recording).weight)


def test_a_sensor_that_sees_derivatives_sees_none_at_the_start():
    ahead = lateral().sensed(lambda read, q: {"v_y": read.v_y + 0.1 + 0.05 * q.rates.v_y})
    readings, inputs = np.array([[0.4, 0.1]]), np.array([[0.02, 15.0]])
    z, _ = Simulator(ahead, compiled=False).start(("v_y", "yaw_rate"), readings, inputs, ahead.values)
    np.testing.assert_allclose(z[0, :2], [0.3, 0.1], rtol=1e-12)


def at_speeds(recording, v_x):
    return recording.with_signals(v_x=np.asarray(v_x, dtype=float))


def test_readings_of_a_vehicle_that_stands_have_no_weight(recording):
    standing = at_speeds(recording, np.where(np.arange(60) < 20, 0.01, 15.0))
    found = problem(standing).weight > 0
    assert not np.any(found[1:20])
    assert np.all(found[20:])
    kept = problem(standing, keep=[np.repeat([0.0, 1.0], [30, 30])]).weight > 0
    np.testing.assert_array_equal(np.all(kept, axis=1), np.arange(60) >= 30)


def test_a_start_at_standstill_is_held_by_the_readings_it_deviates_from(recording):
    standing = at_speeds(recording, np.where(np.arange(60) < 20, 0.01, 15.0))
    np.testing.assert_array_equal(problem(standing).weight[0] > 0, [True, True, False])
    free = MotionProblem(Simulator(lateral(), compiled=False), [standing], noise=NOISE)
    H = free.normal_equations(free.start, free.simulated_nodes(free.start)).H
    assert np.all(np.diag(H)[-2:] > 0.5 / NOISE[:2] ** 2)


def test_where_nearly_all_is_slow_all_of_it_counts(recording):
    assert np.all(problem(at_speeds(recording, np.full(60, 0.3))).weight > 0)
    assert np.all(problem(at_speeds(recording, np.where(np.arange(60) < 57, 0.3, 2.0))).weight > 0)
