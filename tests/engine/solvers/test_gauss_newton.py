"""Gauss-Newton: optima that are known otherwise, bounds, how it ends, and Ctrl-C."""

from dataclasses import replace

import numpy as np
import pytest
from independent import free_run_of_full, lateral, longitudinal, predict_rows, weights_of
from scipy.optimize import least_squares
from toys import drive, joined, linear_toy, looping, obeying_toy, scattered, speed_toy, tiny

from greybox_id.engine.least_squares import NormalEquations
from greybox_id.engine.shooting import Problem
from greybox_id.engine.solvers.gauss_newton import Status, gauss_newton
from greybox_id.engine.trace import Trace
from greybox_id.fitting.scores.memory import predictions
from greybox_id.models.msnn_full import FullSettings, covering_full, msnn_full
from greybox_id.models.msnn_lat import LateralSettings, covering_lat, msnn_lat
from greybox_id.models.msnn_long import LongitudinalSettings
from greybox_id.models.parameter import Parameter, Prior


def problem_of(model, *recordings, closed_loop=False, noise=None, **more):
    noise = np.full(len(model.outputs), 0.3) if noise is None else noise
    return Problem(Trace(model), recordings or [drive()], closed_loop=closed_loop, noise=noise, **more)


def weak(model, factor):
    """The model with priors that many times as wide."""
    return model.with_parameters(
        *(
            replace(p, prior=replace(
                p.prior, sd=factor * np.asarray(p.prior.sd),
                step_sd=tuple(None if s is None else factor * np.asarray(s) for s in p.prior.step_sd)))
            for p in model.parameters if p.prior is not None
        )
    )  # fmt: skip


def test_a_linear_model_is_solved_as_by_the_normal_equations():
    recording, prior = drive(), Prior(0.8, mean=0.3)
    problem = problem_of(linear_toy(3, prior), recording)
    A = np.array([recording["steer"][k - 3 : k] for k in range(3, 150)])
    H = A.T @ A / 0.3**2 + np.eye(3) / 0.8**2
    expected = np.linalg.solve(H, A.T @ recording["yaw_rate"][3:] / 0.3**2 + 0.3 / 0.8**2)
    solution = gauss_newton(problem, problem.start, tolerance=1e-14)
    assert solution.status is Status.CONVERGED
    np.testing.assert_allclose(solution.x, expected, rtol=1e-6)


def test_a_loop_is_solved_as_by_scipy_on_a_naive_simulation():
    recording = looping(drive(), 0.7, 0.9, noise=0.3)
    a, i = recording["a_x"], recording["motor_current"]

    def residuals(x):
        y = a[:2].tolist()
        for k in range(2, len(a)):
            y.append(x[0] * (0.2 * y[k - 2] + 0.8 * y[k - 1]) + x[1] * i[k - 1])
        return np.append((np.array(y[2:]) - a[2:]) / 0.3, (x[1] - 0.5) / 1.0)

    expected = least_squares(residuals, [0.6, 0.5], bounds=([0, -np.inf], [0.95, np.inf]), xtol=1e-12, ftol=1e-12)
    problem = problem_of(speed_toy(), recording, closed_loop=True)
    solution = gauss_newton(problem, problem.start, tolerance=1e-12)
    np.testing.assert_allclose(solution.x, expected.x, atol=1e-5)
    assert solution.objective == pytest.approx(expected.cost, rel=1e-8)


def test_a_bound_is_kept_and_the_others_are_best_with_it():
    free = obeying_toy(np.array([0.5, 1.0]), noise=0.05)
    model = linear_toy(2).with_parameters(Parameter("F", "1/s", [0.0, 0.0], (-np.inf, 0.7)))
    solution = gauss_newton(problem_of(model, free), np.zeros(2), tolerance=1e-14)
    steer, y = free["steer"], free["yaw_rate"]
    left = y[2:] - 0.7 * steer[1:-1]
    assert solution.x[1] == 0.7
    assert solution.x[0] == pytest.approx(left @ steer[:-2] / (steer[:-2] @ steer[:-2]), rel=1e-6)
    assert solution.status is Status.CONVERGED


def test_a_start_outside_the_bounds_is_brought_inside():
    model = linear_toy(2).with_parameters(Parameter("F", "1/s", [0.0, 0.0], (-0.1, 0.1)))
    solution = gauss_newton(problem_of(model), np.array([5.0, -5.0]))
    assert np.all(np.abs(solution.x) <= 0.1)


@pytest.mark.parametrize(("name", "closed"), [("msnn_lat", False), ("msnn_full", True)])
def test_held_parameters_stay_and_the_objective_never_rises(name, closed):
    model = scattered(tiny(name))
    model = model.with_parameters(replace(model["F"], fixed=True))
    problem = problem_of(model, joined(60, 50), closed_loop=closed)
    solution = gauss_newton(problem, problem.start, max_steps=8)
    held = ~problem.free
    assert np.array_equal(solution.x[held], problem.start[held])
    assert np.all(np.diff(solution.history) < 0)
    assert solution.objective == solution.history[-1]
    assert solution.objective == pytest.approx(problem.objective(solution.x, problem.simulated_nodes(solution.x)))


def test_nothing_to_find_is_found_at_once():
    model = linear_toy(2).with_parameters(replace(linear_toy(2)["F"], fixed=True))
    solution = gauss_newton(problem_of(model), np.zeros(2))
    assert (solution.status, solution.steps) == (Status.CONVERGED, 0)


def test_at_the_step_limit_it_says_so():
    problem = problem_of(scattered(tiny("msnn_lat")))
    solution = gauss_newton(problem, problem.start, max_steps=1)
    assert (solution.status, solution.steps, len(solution.history)) == (Status.STEP_LIMIT, 1, 2)


def test_the_caller_can_stop_it():
    problem = problem_of(scattered(tiny("msnn_lat")))
    solution = gauss_newton(problem, problem.start, on_step=lambda step, objective, x: step < 2)
    assert (solution.status, solution.steps) == (Status.STOPPED, 2)


def test_ctrl_c_keeps_the_best_point_so_far():
    problem, seen = problem_of(scattered(tiny("msnn_full")), closed_loop=True), []

    def on_step(step, objective, x):
        seen.append((objective, x))
        if step == 2:
            raise KeyboardInterrupt
        return True

    solution = gauss_newton(problem, problem.start, on_step=on_step)
    assert (solution.status, solution.steps) == (Status.INTERRUPTED, 2)
    assert np.array_equal(solution.x, seen[-1][1])
    assert solution.objective == seen[-1][0] < solution.history[0]
    assert problem.objective(solution.x, solution.nodes) == pytest.approx(solution.objective)


@pytest.mark.filterwarnings("ignore::RuntimeWarning")
def test_a_model_that_is_not_finite_at_the_start_is_said_to_be_so():
    model = replace(speed_toy(), equations=lambda u, p, past: {"a_x": past(u.a_x, [p.gain]) / (p.pole - 0.6)})
    problem = problem_of(model)
    assert gauss_newton(problem, problem.start).status is Status.NOT_FINITE


def test_a_parameter_that_nothing_tells_does_not_stop_the_others():
    model = linear_toy(2)
    model = replace(model, parameters=(*model.parameters, Parameter("silent", "1", 1.0)))
    recording = obeying_toy(np.array([0.5, 1.0]))
    solution = gauss_newton(problem_of(model, recording), np.array([0.0, 0.0, 1.0]))
    np.testing.assert_allclose(solution.x, [0.5, 1.0, 1.0], atol=1e-6)


def test_lateral_weights_are_recovered_up_to_their_scale_from_an_independent_simulation():
    recording = drive(1500, 3)
    chosen = covering_lat(LateralSettings(n_delta=3, q=4), recording)
    truth = scattered(msnn_lat(chosen), 1, share=0.2)
    y = predict_rows(
        lambda w: lateral(w, weights_of(truth), chosen.steer, chosen.v_x, chosen.a_x),
        {n: recording[n] for n in truth.inputs}, 5, 1500,
    )  # fmt: skip
    told = recording.with_signals(yaw_rate=np.append(recording["yaw_rate"][:5], y))
    problem = problem_of(weak(msnn_lat(chosen), 100.0), told, noise=np.array([1e-3]))
    solution = gauss_newton(problem, problem.start, max_steps=60)
    found = msnn_lat(chosen).with_values(solution.x)
    np.testing.assert_allclose(predictions(found, told).predicted[:, 0], y, atol=2e-3 * np.std(y))
    scale = np.sum(found["F"].array) / np.sum(truth["F"].array)  # only the product with kappa acts
    np.testing.assert_allclose(found["F"].array / scale, truth["F"].array, atol=0.05)


def test_the_parameters_of_a_loop_are_recovered_from_an_independent_simulation():
    model = speed_toy().with_parameters(Parameter("gain", "m/(s^2 A)", 0.5))
    problem = problem_of(model, looping(drive(400, 3), 0.8, 1.3), closed_loop=True)
    np.testing.assert_allclose(gauss_newton(problem, problem.start).x, [0.8, 1.3], rtol=1e-6)


@pytest.mark.slow
def test_the_closed_loop_is_fitted_to_an_independent_simulation_of_the_full_model():
    recording = drive(400, 3)
    chosen = covering_full(
        FullSettings(LateralSettings(n_delta=3, q=3), LongitudinalSettings(n_y=2, eta=2, gamma=3)), recording
    )
    truth = scattered(msnn_full(chosen), 1, share=0.1)
    w, measured = weights_of(truth), {n: recording[n] for n in ("yaw_rate", "a_x")}
    y = free_run_of_full(
        {"road_slope": np.zeros(400), **{n: recording[n] for n in ("v_x", "steer", "motor_current")}},
        (lambda x: lateral(x, w, chosen.lat.steer, chosen.lat.v_x, chosen.lat.a_x), 4),
        (lambda x: longitudinal(x, w, chosen.long.v_x, chosen.long.a_y), 4), 4, measured,
    )  # fmt: skip
    told = recording.with_signals(yaw_rate=y[:, 0], a_x=y[:, 1])
    spread = 1e-3 * np.std(y[4:], axis=0)
    problem = problem_of(weak(msnn_full(chosen), 30.0), told, closed_loop=True, noise=spread)
    solution = gauss_newton(problem, problem.start, max_steps=60)
    found = predictions(msnn_full(chosen).with_values(solution.x), told, "closed_loop")
    assert np.all(np.std(found.predicted - y[4:], axis=0) < 20 * spread)


class Overwhelmed:
    """Half of (x_0 - 3)^2 beside a curvature so large that rounding leaves nothing of the step."""

    free, bounds = np.ones(2, dtype=bool), (np.full(2, -10.0), np.full(2, 10.0))

    def simulated_nodes(self, x):
        return x

    def objective(self, x, nodes):
        return 0.5 * float((x[0] - 3.0) ** 2)

    def normal_equations(self, x, nodes):
        return NormalEquations(self.H, self.pull(x))

    H = np.array([[1.0, 1e150], [1e150, 1e300]])

    def pull(self, x):
        return np.array([x[0] - 3.0, (x[0] - 3.0) * 1e150])


def test_a_point_with_a_large_gradient_is_no_optimum_though_rounding_leaves_no_step():
    found = gauss_newton(Overwhelmed(), np.zeros(2), search="levenberg_marquardt", negligible=0.0)
    assert found.status is not Status.CONVERGED or found.objective < 1e-6
