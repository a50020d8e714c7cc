"""Where a search begins, and what it does where the objective jumps."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from motion import SHAPE, car, recorded

from greybox_id.engine.motion.simulator import Simulator
from greybox_id.fitting import attempt
from greybox_id.fitting.attempt import _walled, off_bounds, starting_points, with_starts
from greybox_id.fitting.how import FitOptions, quiet
from greybox_id.models.effects import EFFECTS
from greybox_id.models.parameter import Prior
from greybox_id.models.registry import build


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
    assert _walled(problem, SimpleNamespace(x=x, nodes=None, objective=objective(x, None)))
    expected = [[-5.0, -5.0], [5.0, 5.0]]
    expected[side][0] = away
    assert np.array(problem.bounds).tolist() == expected
    assert not _walled(problem, SimpleNamespace(x=x, nodes=None, objective=objective(x, None)))


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
