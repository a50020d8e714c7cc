"""Descent: to the optimum where nothing is held out against it, else to where the held-out error is least."""

import numpy as np
import pytest
from toys import drive, joined, linear_toy, tiny

from greybox_id.engine.shooting import Problem
from greybox_id.engine.trace import Trace
from greybox_id.parameter import Parameter
from greybox_id.solvers.gauss_newton import gauss_newton
from greybox_id.solvers.quasi_newton import descend, refine

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
