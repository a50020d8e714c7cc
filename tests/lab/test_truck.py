"""The truck benchmark: what grey-box models reach on the authors' recordings, and what it makes of their inputs."""

from importlib import resources

import numpy as np
import pytest

import greybox_id as gb
from greybox_id.engine.solvers.gauss_newton import Status
from greybox_lab.papers.truck_grey_boxes import CANDIDATES, deviations, fitted
from greybox_lab.papers.truck_inputs import EVERY, _bridged, _remembered, _rise, causal, prepared, raw

MOST_STEPS = 25
TYPICAL = np.array([0.045, 0.005])


def on_val(candidate, folder):
    """(v_y, yaw rate) mean errors on val of a candidate fitted to train, and how the solver ended."""
    train = candidate.prepare(folder / "train.parquet")
    problem, solution = fitted(candidate.model(train), train, max_steps=MOST_STEPS)
    p = problem.plain.shared(solution.x)
    runs = deviations(problem.plain.simulator, candidate.prepare(folder / "val.parquet"), p)
    return np.mean([np.sqrt(np.mean(own**2, axis=0)) for own in runs], axis=0), solution.status


@pytest.fixture(scope="module")
def reached():
    return {}


@pytest.fixture
def val(real_data, reached):
    """Position among the candidates -> what it reaches on val; fitted once."""

    def of(position):
        if position not in reached:
            reached[position] = on_val(CANDIDATES[position], real_data / "truck")
        return reached[position]

    return of


def test_one_steering_angle_is_enough_to_beat_what_was_published_within_the_step_limit(val):
    (v_y, yaw_rate), status = val(3)
    assert status in (Status.CONVERGED, Status.SLOW)
    assert v_y <= 0.046
    assert yaw_rate <= 0.0048


def test_without_later_rows_it_is_enough_too(val):
    (v_y, yaw_rate), status = val(2)
    assert status in (Status.CONVERGED, Status.SLOW)
    assert v_y <= 0.0410
    assert yaw_rate <= 0.0047


def test_signs_as_published_cost_more_than_a_factor_of_two(val):
    as_published, _ = val(0)
    put_right, _ = val(1)
    best, _ = val(3)
    assert as_published[0] > 2 * put_right[0]
    assert np.sum(as_published / TYPICAL) > 2 * np.sum(best / TYPICAL)


@pytest.mark.slow
def test_the_second_angle_and_the_road_s_bank_each_lower_an_error(val):
    one, _ = val(3)
    both, _ = val(4)
    banked, _ = val(5)
    assert both[1] < 0.85 * one[1]
    assert banked[0] < 0.98 * both[0]
    assert np.all(both <= [0.039, 0.0036])


def test_models_have_no_more_free_parameters_than_they_may(real_data):
    train = prepared(real_data / "truck" / "train.parquet")
    free = [sum(p.size for p in c.model(train).parameters if not p.fixed) for c in CANDIDATES]
    assert free == [11, 8, 23, 18, 23, 63]


def test_preparing_leaves_readings_and_rows_alone(real_data):
    path = real_data / "truck" / "val.parquet"
    before = raw(path)
    for after in (prepared(path), causal(path)):
        assert before.runs == after.runs
        assert all(stop - start == 2000 // EVERY for start, stop in after.runs)
        for name in ("v_y", "yaw_rate"):
            np.testing.assert_array_equal(before[name], after[name])


def rested_steer(seed, rows=1000):
    steer = np.cumsum(np.random.default_rng(seed).normal(0, 1e-3, rows))
    return np.where(np.abs(steer) < 0.01, 0.0, steer)


def test_what_is_causal_knows_no_later_row():
    steer, speed = rested_steer(3), 15.0 + np.cumsum(np.random.default_rng(4).normal(0, 0.01, 1000))
    assert 0.1 < np.mean(steer == 0) < 0.9
    for rows in (1, 30, 400, 731):
        for whole, part in zip(_remembered(steer), _remembered(steer[:rows]), strict=True):
            np.testing.assert_array_equal(whole[:rows], part)
        np.testing.assert_allclose(_rise(speed)[:rows], _rise(speed[:rows]), atol=1e-9)


def test_the_angle_is_remembered_while_it_rests():
    steer = np.array([0.0] * 5 + [0.01 + 0.001 * k for k in range(30)] + [0.0] * 40)
    level, since, slope = _remembered(steer)
    assert np.all(level[:5] == 0)
    assert np.all(since[:5] == 0)
    assert np.all(level[35:] == steer[34])
    np.testing.assert_allclose(since[34:], np.arange(41) / 200)
    np.testing.assert_allclose(slope[34:], 0.001 * 200)


def test_a_rising_speed_has_its_slope():
    seconds = np.arange(600) / 200
    found = _rise(np.stack([3.0 + 2.0 * seconds, 15.0 - 0.5 * seconds]))
    np.testing.assert_allclose(found[:, 40:], np.array([[2.0], [-0.5]]) * np.ones((1, 560)), rtol=1e-9)


def test_a_short_rest_at_zero_is_crossed_straight():
    steer = np.linspace(-0.05, 0.05, 301)
    rested = np.where(np.abs(steer) < 0.01, 0.0, steer)
    np.testing.assert_allclose(_bridged(rested)[10:-10], steer[10:-10], atol=1e-3)


def test_a_long_rest_stays_at_zero_but_for_ramps_that_carry_on_the_slope():
    time = np.arange(800)
    wheel = np.clip(0.001 * (np.abs(time - 400) - 300), 0.0, None)  # turned back, straight, and turned again
    found = _bridged(np.where(wheel < 0.02, 0.0, wheel))
    assert np.all(found[140:660] == 0.0)
    np.testing.assert_allclose(found, wheel, atol=3e-3)


def test_bridging_does_not_know_left_from_right():
    random = np.random.default_rng(0)
    steer = np.cumsum(random.normal(0, 1e-3, 2000))
    steer[np.abs(steer) < 0.01] = 0.0
    np.testing.assert_array_equal(_bridged(-steer), -_bridged(steer))


@pytest.mark.examination
@pytest.mark.slow
def test_the_gap_beside_table_one_is_the_arm_of_the_speed_sensor(real_data, tmp_path):
    """Of the shipped truck the arm and the steering's effects are taken out; 4.7 m is what people measured."""
    text = resources.files("greybox_id.datasets").joinpath("vehicles", "truck.toml").read_text("utf-8")
    head, _, rest = text.partition("[effects]")
    stated = tmp_path / "truck.toml"
    stated.write_text(head + "[noise]" + rest.partition("[noise]")[2])
    train, val = (real_data / "truck" / f"{name}.parquet" for name in ("train", "val"))
    gap = gb.diagnose("lateral", train, vehicle=stated, columns="truck", held_out=val)
    first = next(item for item in gap.ranking if item.effect in gap.applied)
    assert first.effect == "velocity_lever_arm"
    assert first.interval[0] < 4.7 < first.interval[1]
    assert gap.held_out.closed > 0.4
