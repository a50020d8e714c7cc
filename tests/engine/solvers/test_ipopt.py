"""Ipopt against Gauss-Newton on the same problems."""

from dataclasses import replace

import numpy as np
import pytest
from toys import drive, joined, linear_toy, looping, obeying_toy, scattered, speed_toy, tiny

from greybox_id.engine.shooting import Problem
from greybox_id.engine.solvers.gauss_newton import Status, gauss_newton
from greybox_id.engine.solvers.ipopt import ipopt
from greybox_id.engine.trace import Trace
from greybox_id.models.effects import sensor_latency_imu, steering_rate_limit
from greybox_id.models.parameter import Parameter


def problem_of(model, *recordings, closed_loop=False, strength=3.0):
    names = {p.prior.strength for p in model.parameters if p.prior is not None and p.prior.strength}
    return Problem(
        Trace(model), recordings or [drive()], closed_loop=closed_loop,
        noise=np.linspace(0.3, 1.0, len(model.outputs)), strengths=dict.fromkeys(names, strength),
    )  # fmt: skip


def settled(problem):
    """Gauss-Newton's optimum, carried on where it stopped because progress was negligible."""
    solution = gauss_newton(problem, problem.start, tolerance=1e-10)
    for _ in range(30):
        if solution.status is Status.CONVERGED:
            break
        solution = gauss_newton(problem, solution.x, tolerance=1e-10)
    return solution


CASES = {
    "lat": (tiny("msnn_lat"), False),
    "lat, symmetric": (replace(tiny("msnn_lat"), symmetric=True), False),
    "lat, late": (tiny("msnn_lat") + sensor_latency_imu.at(0.06), False),
    "lat, limited": (tiny("msnn_lat") + steering_rate_limit.at(1.5), False),
    "loop": (speed_toy(), True),
    "full": (tiny("msnn_full"), True),
    "full, limited": (tiny("msnn_full") + steering_rate_limit.at(1.5), True),
    "full, late": (tiny("msnn_full") + sensor_latency_imu.at(0.06), True),
    "plus": (tiny("msnn_full_plus"), True),
}


@pytest.mark.parametrize("case", CASES)
def test_its_objective_is_that_of_the_problem(case):
    model, closed = CASES[case]
    problem = problem_of(scattered(model), joined(40, 30), closed_loop=closed)
    solution, verdict = ipopt(problem, problem.start, warm=True, max_iterations=0)
    assert verdict.words == "Maximum Iterations Exceeded"
    assert solution.history[0] == pytest.approx(
        problem.objective(problem.start, problem.simulated_nodes(problem.start))
    )


@pytest.mark.parametrize("case", ["lat", "lat, symmetric", "loop", "full"])
def test_it_reaches_the_same_optimum_as_gauss_newton(case):
    model, closed = CASES[case]
    problem = problem_of(model, looping(drive(100), 0.7, 0.9, noise=0.3), closed_loop=closed)
    mine = settled(problem)
    assert mine.status is Status.CONVERGED
    theirs, verdict = ipopt(problem, problem.start, max_iterations=300)
    assert theirs.status is Status.CONVERGED, verdict
    assert theirs.objective == pytest.approx(mine.objective, rel=1e-5)
    same = problem.simulated_nodes(theirs.x) if closed else [run.predict(theirs.x) for run in problem.runs]
    own = mine.nodes if closed else [run.predict(mine.x) for run in problem.runs]
    np.testing.assert_allclose(same[0], own[0], atol=0.02)


@pytest.mark.parametrize("case", ["lat", "loop", "full"])
def test_it_confirms_the_optimum_of_gauss_newton(case):
    model, closed = CASES[case]
    problem = problem_of(model, looping(drive(100), 0.7, 0.9, noise=0.3), closed_loop=closed)
    found = settled(problem)
    solution, verdict = ipopt(problem, found.x, warm=True, max_iterations=50)
    assert solution.status is Status.CONVERGED
    assert found.objective - solution.objective < 1e-6 * found.objective
    assert verdict.gradient < 1e-3


def test_bounds_are_respected():
    model = linear_toy(2).with_parameters(Parameter("F", "1/s", [0.0, 0.0], (-np.inf, 0.7)))
    problem = problem_of(model, obeying_toy(np.array([0.5, 1.0]), noise=0.05))
    solution, _ = ipopt(problem, np.zeros(2))
    np.testing.assert_allclose(solution.x, gauss_newton(problem, np.zeros(2)).x, atol=1e-5)
    assert solution.x[1] <= 0.7


def test_held_parameters_stay():
    model = scattered(tiny("msnn_full"))
    model = model.with_parameters(replace(model["F"], fixed=True), replace(model["m"], fixed=True))
    problem = problem_of(model, drive(60), closed_loop=True)
    solution, _ = ipopt(problem, problem.start, max_iterations=5)
    assert np.array_equal(solution.x[~problem.free], problem.start[~problem.free])
    assert not np.array_equal(solution.x[problem.free], problem.start[problem.free])


def test_an_effect_held_at_an_infinite_null_can_be_solved():
    problem = problem_of(tiny("msnn_lat") + steering_rate_limit.at(np.inf))
    bare = problem_of(tiny("msnn_lat"))
    both = [ipopt(p, p.start, max_iterations=300)[0].objective for p in (problem, bare)]
    assert both[0] == pytest.approx(both[1], rel=1e-6)


def test_the_nodes_it_returns_match():
    problem = problem_of(tiny("msnn_full"), drive(60), closed_loop=True)
    solution, _ = ipopt(problem, problem.start, max_iterations=3)
    np.testing.assert_allclose(solution.nodes[0], problem.simulated_nodes(solution.x)[0], atol=1e-12)


def test_a_run_shorter_than_the_latest_sensor_can_be_solved():
    problem = problem_of(tiny("msnn_full") + sensor_latency_imu.at(0.06), drive(8), closed_loop=True)
    solution, _ = ipopt(problem, problem.start, max_iterations=2, warm=True)
    assert solution.history[0] == pytest.approx(
        problem.objective(problem.start, problem.simulated_nodes(problem.start))
    )


def test_out_of_iterations_it_says_so():
    problem = problem_of(scattered(tiny("msnn_lat")))
    assert ipopt(problem, problem.start, max_iterations=1)[0].status is Status.STEP_LIMIT
