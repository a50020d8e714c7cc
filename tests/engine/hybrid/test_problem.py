"""The loss of a hybrid model and its gradient through time, network and physics."""

import numpy as np
import pytest
from linear_bicycle import VEHICLE, manoeuvres

from greybox_id.engine.hybrid.problem import HybridProblem, WindowErrors, drawn
from greybox_id.engine.hybrid.stretches import stretches
from greybox_id.models.parameter import Prior, Stated
from greybox_id.models.registry import build
from greybox_id.models.vehicle import Vehicle

SMALL = {"hidden": [5, 4], "window": 40, "warm_up": 15}
KNOWN = Vehicle("known", dict(VEHICLE.values) | {"I_z": Stated(650.0, 60.0)})


def stated(name, seed=1, **more):
    model = build(name, SMALL, vehicle=KNOWN)
    found = [each for one in manoeuvres(5e4, 6e4, seed) for each in stretches(model, one)]
    noise = np.array(
        [{"a_y": 0.2, "yaw_rate": 0.01, "v_y": 0.05, "sideslip": 0.004}.get(n, 0.7) for n in model.outputs]
    )
    return model, found, noise


@pytest.mark.parametrize("name", ["hybrid_stiffness", "hybrid_force"])
def test_its_gradient_is_that_of_finite_differences(name):
    model, found, noise = stated(name)
    problem = HybridProblem(model, found[:2], noise)
    q = problem.unknowns(drawn(model, 3))
    q[0] = 0.4  # I_z off its mean: the prior has a slope as well
    value, slope = problem(q)
    rng = np.random.default_rng(0)
    for _ in range(4):
        along = rng.standard_normal(len(q))
        h = 1e-6
        ahead, behind = problem(q + h * along)[0], problem(q - h * along)[0]
        assert slope @ along == pytest.approx((ahead - behind) / (2 * h), rel=1e-4)
    ahead, behind = (problem(q + np.eye(len(q))[0] * h)[0] for h in (1e-5, -1e-5))
    assert slope[0] == pytest.approx((ahead - behind) / 2e-5, rel=1e-4)
    assert value > 0


def test_physical_parameters_are_in_units_of_their_prior_and_pulled_to_its_mean():
    model, found, noise = stated("hybrid_force")
    problem = HybridProblem(model, found[:2], noise)
    assert problem.free[:4].tolist() == [False, True, False, False]  # of m, I_z, l_f, l_r
    p = problem.parameters(np.eye(int(problem.free.sum()))[0])
    assert p[1] == pytest.approx(710.0)
    assert model["I_z"].prior == Prior(60.0, mean=650.0)


def test_missing_readings_count_for_nothing():
    model, found, noise = stated("hybrid_force")
    whole = WindowErrors(model, found[:1], noise)
    for one in found[:1]:
        one.outputs[1, ::2] = np.nan
    fewer = WindowErrors(model, found[:1], noise)
    assert fewer.readings < whole.readings
    assert np.isfinite(fewer(drawn(model, 0)))


def test_the_error_of_the_true_vehicle_is_the_noise():
    model, _, noise = stated("hybrid_stiffness")
    static = 12.0 * 930.0 * 9.81 / 2.346
    recordings = manoeuvres(static * 1.171, static * 1.175)
    found = [each for one in recordings for each in stretches(model, one)]
    model = model.with_parameters(model["I_z"].with_value(700.0))
    # starts are averages of noisy readings, forgotten during the warm-up but for a little
    assert WindowErrors(model, found, noise)(model.values) == pytest.approx(1.0, abs=0.08)


def test_a_vehicle_that_leaves_all_bounds_costs_much_and_has_no_slope():
    model, found, noise = stated("hybrid_force")
    problem = HybridProblem(model, found[:1], noise)
    value, slope = problem(np.full(int(problem.free.sum()), 1e3))
    assert value == 1e8
    assert not np.any(slope)


def test_draws_follow_the_seed():
    model, _, _ = stated("hybrid_stiffness")
    assert np.array_equal(drawn(model, 4), drawn(model, 4))
    assert not np.array_equal(drawn(model, 4), drawn(model, 5))
