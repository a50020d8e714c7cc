"""Where a search begins, and what it does where the objective jumps."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from driven import driven
from motion import SHAPE, car, recorded

from greybox_id.engine.motion.simulator import Simulator
from greybox_id.fitting import attempt
from greybox_id.fitting.attempt import (
    _bounded_at_jumps,
    errors_at,
    off_bounds,
    predicted_share,
    refitted,
    starting_points,
    with_starts,
)
from greybox_id.fitting.how import FitOptions, quiet
from greybox_id.models.effects import EFFECTS
from greybox_id.models.parameter import Prior
from greybox_id.models.registry import build
from greybox_id.models.vehicle import vehicle


def test_what_is_believed_near_its_bound_begins_inside():
    """With all delays at none, readings jump with commands and no derivative says so."""
    model = build("single_track") + EFFECTS["steering_delay"] + EFFECTS["steering_lag"]
    model = model.with_parameters(replace(model["steering_delay"], prior=Prior(0.002)))
    for point in starting_points(model, FitOptions(starts=3)):
        found = dict(zip([own.name for own in model.parameters], point, strict=True))
        assert 0.0 < found["steering_delay"] < 0.02
        assert found["steering_lag"] == 0.0, "nothing is believed of it"
    first = starting_points(model, FitOptions())[0]
    assert np.flatnonzero(first != model.values).tolist() == [
        [own.name for own in model.parameters].index("steering_delay")
    ]
    assert np.array_equal(off_bounds(model, first), first)


@pytest.mark.parametrize(("away", "side"), [(1.0, 0), (-1.0, 1)])
def test_an_objective_that_jumps_is_bounded_there_and_nowhere_else(away, side):
    """0.5 |x - (0, 3)|^2 with x_0 at `away`, towards whose optimum it jumps up."""
    x = np.array([away, 2.0])

    def objective(x, nodes):
        return 0.5 * x[0] ** 2 + 0.5 * (x[1] - 3.0) ** 2 + 9.0 * (away * x[0] < 1.0)

    def equations(x, nodes):
        return SimpleNamespace(g=x - [0.0, 3.0], H=np.eye(2))

    problem = SimpleNamespace(
        bounds=(np.full(2, -5.0), np.full(2, 5.0)), free=np.ones(2, dtype=bool), objective=objective,
        simulated_nodes=lambda x: None, normal_equations=equations,
    )  # fmt: skip
    assert _bounded_at_jumps(problem, SimpleNamespace(x=x, nodes=None, objective=objective(x, None)))
    expected = [[-5.0, -5.0], [5.0, 5.0]]
    expected[side][0] = away
    assert np.array(problem.bounds).tolist() == expected
    assert not _bounded_at_jumps(problem, SimpleNamespace(x=x, nodes=None, objective=objective(x, None)))


def test_short_horizons_over_some_rows_lead_to_the_same_optimum(monkeypatch):
    simulator = Simulator(car(held=SHAPE, wrong={"I_z": 1.3, "B_f": 0.8}), compiled=False)
    recordings = [recorded(seconds=8.0, rate=100.0)]
    found = []
    for rows in (attempt.SHORT_ROWS, 200):
        monkeypatch.setattr(attempt, "SHORT_ROWS", rows)
        reached = attempt.attempted(simulator, recordings, simulator.trace.model.values, FitOptions(), quiet, "car")
        found.append(reached.problem.shared(reached.solution.x))
    assert np.any(found[0] != found[1])
    assert found[1] == pytest.approx(found[0], rel=1e-5)


@pytest.mark.parametrize("start_from", ["free", "measured"])
def test_where_an_optimum_is_known_its_starts_follow(start_from):
    simulator, how = Simulator(car(held=SHAPE), compiled=False), FitOptions(start_from=start_from)
    recordings = [recorded(seconds=6.0, rate=50.0)]
    reached = attempt.attempted(simulator, recordings, simulator.trace.model.values, how, quiet, "car")
    problem, optimum = reached.problem, reached.solution
    x = with_starts(problem, problem.unknowns(problem.shared(optimum.x)))
    assert np.array_equal(x[: problem.parameters.size], optimum.x[: problem.parameters.size])
    assert problem.objective(x, problem.simulated_nodes(x)) == pytest.approx(optimum.objective, rel=1e-9)


def test_the_reduction_predicted_of_a_fit_is_what_it_takes_away():
    recording, car = driven(runs=1, seconds=8.0, noise=0.1), build("lateral", None, {}, vehicle("full_size_car"))
    free = (replace(p, fixed=p.name not in ("B_f", "I_z"), prior=None) for p in car.parameters)
    simulator = Simulator(car.with_parameters(*free))
    ones, how = np.ones(len(car.outputs)), FitOptions(horizon=1.0, start_from="measured")
    noise = np.nanstd(errors_at(simulator, [recording], ones, how, car.values), axis=0)
    how = replace(how, noise=dict(zip(car.outputs, noise.tolist(), strict=True)))
    best = refitted(simulator, [recording], car.values, how)
    errors = (errors_at(simulator, [recording], noise, how, p) / noise for p in (best, car.values))
    after, before = (np.nansum(error**2) for error in errors)
    assert predicted_share(simulator, [recording], best, how) < 1e-6
    assert predicted_share(simulator, [recording], car.values, how) == pytest.approx(1.0 - after / before, rel=0.1)
