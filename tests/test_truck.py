"""The truck benchmark: what grey-box models reach on the authors' recordings, and what it makes of their inputs."""

import numpy as np
import pytest

from greybox_id.bench.truck_grey_boxes import CANDIDATES, deviations, fitted
from greybox_id.bench.truck_inputs import EVERY, _bridged, prepared, raw
from greybox_id.solvers.gauss_newton import Status

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
    (v_y, yaw_rate), status = val(2)
    assert status in (Status.CONVERGED, Status.SLOW)
    assert v_y <= 0.046
    assert yaw_rate <= 0.0048


def test_signs_as_published_cost_more_than_a_factor_of_two(val):
    as_published, _ = val(0)
    put_right, _ = val(1)
    best, _ = val(2)
    assert as_published[0] > 2 * put_right[0]
    assert np.sum(as_published / TYPICAL) > 2 * np.sum(best / TYPICAL)


def test_the_second_angle_and_the_road_s_bank_each_lower_an_error(val):
    one, _ = val(2)
    both, _ = val(3)
    banked, _ = val(4)
    assert both[1] < 0.85 * one[1]
    assert banked[0] < 0.98 * both[0]
    assert np.all(both <= [0.039, 0.0036])


def test_models_have_no_more_free_parameters_than_they_may(real_data):
    train = prepared(real_data / "truck" / "train.parquet")
    free = [sum(p.size for p in c.model(train).parameters if not p.fixed) for c in CANDIDATES]
    assert free == [11, 8, 18, 23, 63]


def test_preparing_leaves_readings_and_rows_alone(real_data):
    path = real_data / "truck" / "val.parquet"
    before, after = raw(path), prepared(path)
    assert before.runs == after.runs
    assert all(stop - start == 2000 // EVERY for start, stop in after.runs)
    for name in ("v_y", "yaw_rate"):
        np.testing.assert_array_equal(before[name], after[name])


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
