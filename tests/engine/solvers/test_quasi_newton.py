"""Descent: to the optimum where nothing is held out against it, else to where the held-out error is least."""

import numpy as np
import pytest
from toys import drive, joined, linear_toy, tiny

from greybox_id.engine.least_squares import NormalEquations
from greybox_id.engine.shooting import Problem
from greybox_id.engine.solvers.gauss_newton import gauss_newton
from greybox_id.engine.solvers.quasi_newton import descend, refine, settle
from greybox_id.engine.trace import Trace
from greybox_id.models.parameter import Parameter

SCALES = np.array([1.0, 30.0, 5.0])
FREE = np.full((3, 2), [-np.inf, np.inf])


def bowl(x):
    off = SCALES * (x - np.array([1.0, -2.0, 0.5]))
    return 0.5 * float(off @ off), SCALES * off


def run(held_out, bounds=FREE, **more):
    how = {"warm_up": 5, "steps": 60, "patience": 30} | more
    heard = []
    found = descend(bowl, held_out, np.zeros(3), bounds, say=lambda *told: heard.append(told), **how)
    return found, heard


def test_it_finds_the_optimum():
    found, heard = run(lambda x: bowl(x)[0])
    assert found.converged
    assert found.x == pytest.approx([1.0, -2.0, 0.5], abs=1e-4)
    assert len(heard) == len(found.held_out) - 1


def test_it_keeps_the_point_that_fits_best_what_is_held_out():
    found, _ = run(lambda x: float(np.sum((x - [0.2, -0.4, 0.1]) ** 2)), patience=4)
    assert found.held_out[found.best] == min(found.held_out)
    assert found.best < len(found.held_out) - 1
    assert "not lower for 4 steps" in found.status


def test_bounds_hold():
    found, _ = run(lambda x: bowl(x)[0], bounds=np.array([[-1.0, 0.3], [-9.0, 9.0], [-9.0, 9.0]]))
    assert found.x == pytest.approx([0.3, -2.0, 0.5], abs=1e-4)


def test_an_interruption_keeps_the_best_so_far():
    calls = 0

    def interrupted(x):
        nonlocal calls
        calls += 1
        if calls == 9:
            raise KeyboardInterrupt
        return bowl(x)[0]

    found, _ = run(interrupted)
    assert found.status == "interrupted"
    assert not found.converged
    assert found.held_out[found.best] < found.held_out[0]


def test_refining_comes_to_the_optimum_without_linearising_again():
    problem = Problem(Trace(tiny("msnn_lat")), [joined(300, 200)], noise=np.array([0.3]))
    near = gauss_newton(problem, problem.start, tolerance=1e-5)
    best = gauss_newton(problem, near.x, tolerance=1e-13, negligible=0.0)
    linearised, usual = [], problem.normal_equations
    problem.normal_equations = lambda *given: linearised.append(given) or usual(*given)
    x, history = refine(problem, near.x, problem.gradient, tolerance=1e-11, steps=40)
    assert len(linearised) == 1
    assert all(after < before for before, after in zip(history[:-1], history[1:], strict=True))
    assert history[-1] == problem.objective(x, [])
    assert history[-1] - best.objective < 2e-11 * best.objective < near.objective - best.objective


def test_refining_stops_before_a_bound_and_leaves_what_is_held():
    model = linear_toy(2)
    bounded = model.with_parameters(Parameter("F", "1/s", np.zeros(2), (-0.01, 0.01)))
    for own in (bounded, model.with_parameters(Parameter("F", "1/s", np.zeros(2), fixed=True))):
        problem = Problem(Trace(own), [drive(100)], noise=np.array([0.3]))
        x, history = refine(problem, problem.start, problem.gradient, tolerance=1e-9, steps=9)
        assert np.array_equal(x, problem.start)
        assert len(history) == 1


class Corner:
    """A bowl with corners along straight lines: its optimum lies in `corners` of them."""

    free, bounds = np.array([True, True, False, True]), (np.full(4, -9.0), np.full(4, 9.0))
    scales = np.array([1.0, 30.0, 7.0, 5.0])

    def __init__(self, *corners):
        self.corners = [np.array(own) for own in corners]

    def simulated_nodes(self, x):
        return []

    def normal_equations(self, x, nodes):
        return NormalEquations(np.diag(self.scales**2), self.gradient(x, nodes))

    def objective(self, x, nodes):
        off = self.scales * (x - 1.0)
        return 0.5 * float(off @ off) + sum(abs(own @ x) for own in self.corners)

    def gradient(self, x, nodes):
        g = self.scales**2 * (x - 1.0) + sum((np.sign(own @ x) * own for own in self.corners), np.zeros(4))
        return np.where(self.free, g, 0.0)


@pytest.mark.parametrize(
    "corners",
    [(), ([1.5, 0.0, 0.0, 0.0],), ([1.2, -10.0, 0.0, 3.0], [0.0, 40.0, 0.0, -8.0])],
    ids=["none", "one", "two"],
)
def test_an_optimum_in_corners_is_found_and_gradients_about_it_balance(corners):
    problem, x = Corner(*corners), np.array([1.4, 0.99, 1.0, 1.1])
    for radius in (0.3, 0.05, 0.01):
        x, objective, average = settle(problem, x, problem.gradient, radius=radius, least=5e-3, steps=100)
    assert average <= 5e-3
    assert objective == problem.objective(x, [])
    around = np.random.default_rng(0).standard_normal((2000, 4)) * np.where(problem.free, 0.1 / problem.scales, 0.0)
    within = 0.01 * sum(np.linalg.norm(own / problem.scales) for own in problem.corners)
    assert min(problem.objective(x + own, []) for own in around) > objective - within - 1e-3


def test_where_nothing_balances_it_says_so():
    problem = Corner()
    x, _, average = settle(problem, np.array([4.0, 1.0, 1.0, 1.0]), problem.gradient, radius=0.01, least=5e-3, steps=5)
    assert average > 1.0
    assert problem.objective(x, []) < problem.objective(np.array([4.0, 1.0, 1.0, 1.0]), [])
