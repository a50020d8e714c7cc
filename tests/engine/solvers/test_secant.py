"""The curvature that Gauss-Newton leaves out."""

import numpy as np
import pytest

from greybox_id.engine.least_squares import NormalEquations
from greybox_id.engine.solvers.gauss_newton import Status, gauss_newton
from greybox_id.engine.solvers.secant import MissingCurvature


class Decay:
    """A decay fitted to readings that are none: residuals stay large, and what they add to the curvature with them.

    far : what the readings are off by.
    """

    t = np.linspace(0.0, 3.0, 30)
    free, bounds = np.ones(2, dtype=bool), (np.full(2, 1e-3), np.full(2, 50.0))

    def __init__(self, far):
        self.readings = np.exp(-0.5 * self.t) + far * np.cos(2.0 * self.t)

    def simulated_nodes(self, x):
        return x[0] * np.exp(-x[1] * self.t)

    def objective(self, x, nodes):
        return 0.5 * float(np.sum((nodes - self.readings) ** 2))

    def normal_equations(self, x, nodes):
        J = np.column_stack([nodes / x[0], -self.t * nodes])
        return NormalEquations(J.T @ J, J.T @ (nodes - self.readings))


def searched(problem, x=(0.3, 2.0), tolerance=1e-12):
    return gauss_newton(problem, np.array(x), tolerance=tolerance, negligible=0.0, search="levenberg_marquardt")


@pytest.fixture
def without(monkeypatch):
    """What Gauss-Newton leaves out stays left out."""

    def never(self, fallen, foretold, without):
        self.trusted = False

    def run(*args, **more):
        with monkeypatch.context() as patch:
            patch.setattr(MissingCurvature, "compare", never)
            return searched(*args, **more)

    return run


def test_the_change_of_the_gradient_over_the_last_step_is_met_exactly():
    rng, left_out, x = np.random.default_rng(5), MissingCurvature(), np.zeros(6)
    A, bend = rng.standard_normal((6, 6)), rng.standard_normal((6, 6))
    H, curvature = A @ A.T + np.eye(6), A @ A.T + np.eye(6) + 0.1 * (bend + bend.T)
    left_out.learn(x, NormalEquations(H, curvature @ x))
    assert left_out.S is None
    for _ in range(4):
        before, x = x, x + rng.standard_normal(6)
        left_out.learn(x, NormalEquations(H, curvature @ x))
        np.testing.assert_allclose((H + left_out.S) @ (x - before), curvature @ (x - before), atol=1e-10)
        np.testing.assert_allclose(left_out.S, left_out.S.T, atol=1e-12)


def test_an_unknown_that_stands_at_infinity_has_no_part_in_it():
    left_out, H = MissingCurvature(), np.diag([2.0, 0.0])
    for x in (1.0, 0.5):
        left_out.learn(np.array([x, np.inf]), NormalEquations(H, np.array([3.0 * x, 0.0])))
    np.testing.assert_allclose(left_out.S, np.diag([1.0, 0.0]), atol=1e-12)


def test_curvature_that_is_not_positive_is_not_trusted():
    left_out, free = MissingCurvature(), np.ones(1, dtype=bool)
    left_out.S, left_out.trusted = np.array([[-3.0]]), True
    whole = left_out.added(NormalEquations(np.array([[2.0]]), np.zeros(1)), np.ones(1), free)
    assert whole.H == -1.0
    assert not left_out.trusted
    left_out.S, left_out.trusted = np.array([[-1.0]]), True
    left_out.added(NormalEquations(np.array([[2.0]]), np.zeros(1)), np.ones(1), free)
    assert left_out.trusted


@pytest.mark.parametrize("far", [1.0, 1.5])
def test_where_residuals_stay_large_the_same_optimum_takes_half_the_steps(far, without):
    found, plain = searched(Decay(far)), without(Decay(far))
    best = without(Decay(far), tolerance=1e-20)
    assert found.status is plain.status is Status.CONVERGED
    assert found.x == pytest.approx(best.x, rel=1e-5)
    assert found.objective == pytest.approx(best.objective, rel=1e-11)
    assert found.steps <= plain.steps / 2


@pytest.mark.parametrize("far", [0.0, 0.2, 0.5])
def test_where_residuals_are_small_it_takes_no_more_steps(far, without):
    found, plain = searched(Decay(far)), without(Decay(far))
    assert found.x == pytest.approx(plain.x, rel=1e-5)
    assert found.steps <= plain.steps


def test_bounds_are_kept(without):
    problem = Decay(1.0)
    problem.bounds = (np.full(2, 1e-3), np.array([50.0, 1.5]))
    found, plain = searched(problem), without(problem)
    assert found.x[1] == plain.x[1] == 1.5
    assert found.x[0] == pytest.approx(plain.x[0], rel=1e-5)
