"""The formulas of docs/mathematics.md hold in the code."""

import numpy as np
from scipy.signal import lfilter
from scipy.stats import t as student

from greybox_id.datasets.read import read
from greybox_id.datasets.recording import Recording
from greybox_id.datasets.shipped import shipped
from greybox_id.engine.least_squares import prior_rows
from greybox_id.engine.motion.shooting import MotionProblem
from greybox_id.engine.motion.simulator import Simulator
from greybox_id.engine.solvers.gauss_newton import gauss_newton
from greybox_id.filters.kernel import SigmaPoints
from greybox_id.fitting.uncertainty.profile import profile
from greybox_id.fitting.uncertainty.sandwich import correlation_time, uncertainty
from greybox_id.gap.evidence import tempering
from greybox_id.models.effects import EFFECTS
from greybox_id.models.motion_model import MotionModel, State
from greybox_id.models.msnn_parts import fading_prior
from greybox_id.models.parameter import Parameter
from greybox_id.models.registry import build
from greybox_id.models.smooth import mean_and_slope
from greybox_id.models.vehicle import vehicle

INTEGRATOR = MotionModel(
    name="integrator",
    about="a yaw rate that is the integral of the steering",
    states=(State("yaw_rate", "rad/s"),),
    inputs=("steer",),
    commands=("steer",),
    outputs=("yaw_rate",),
    parameters=(Parameter("gain", "1/s", 1.0, about="of the integral"),),
    quantities=(),
    dynamics=lambda x, u, p, q: {"yaw_rate": p.gain * u.steer},
)


def test_an_integrator_stands_where_a_late_step_leaves_it():
    time = 0.01 * np.arange(101)
    steps = {"steer": np.where(time >= 0.5, 1.0, 0.0), "yaw_rate": np.zeros(101)}
    late = INTEGRATOR + EFFECTS["steering_delay"].starting_at(0.037)
    problem = MotionProblem(
        Simulator(late), [Recording("step", time, steps, hold="zero")], noise=np.ones(1), starts="measured"
    )
    nodes = problem.simulated_nodes(problem.start)
    ((_, J),) = problem.residuals(problem.start, nodes)
    assert np.isclose(nodes.y[-1, 0], 1.0 - 0.5 - 0.037)
    assert np.allclose(J[-1, 0], (0.463, -1.0))  # by the gain, by the delay


def test_a_lag_hands_on_a_line_of_the_same_mean_and_first_moment():
    s = (np.arange(10_000) + 0.5) / 10_000
    mean, slope = (float(value) for value in mean_and_slope(2.3))
    line, true = mean + slope * (s - 0.5), np.exp(-2.3 * s)
    assert np.isclose(np.mean(line), np.mean(true))
    assert np.isclose(np.mean(s * line), np.mean(s * true))


def test_a_first_order_process_has_its_correlation_time():
    white = np.random.default_rng(1).standard_normal((200_000, 1))
    assert np.isclose(correlation_time(lfilter([1.0], [1.0, -0.8], white, axis=0)), 9.0, rtol=0.05)


def test_condensed_equations_are_those_of_residuals_along_whole_runs():
    car = build("lateral", vehicle=vehicle("roboracer")) + EFFECTS["steering_delay"].starting_at(0.03)
    lap = read(shipped("racer_train"), "roboracer")
    problem = MotionProblem(Simulator(car), [lap.rows(0, 400)], noise=np.ones(len(car.outputs)))
    x, free = problem.start, problem.free
    nodes = problem.simulated_nodes(x)
    condensed = problem.normal_equations(x, nodes)
    H = (problem.R.T @ problem.R).toarray()
    for index, (_, J) in zip(problem.layout.index, problem.residuals(x, nodes), strict=True):
        flat = J.reshape(-1, J.shape[-1])
        H[np.ix_(index, index)] += flat.T @ flat
    assert np.allclose(H[np.ix_(free, free)], condensed.H[np.ix_(free, free)], rtol=1e-9)

    for k in np.flatnonzero(free):
        step = 1e-5 * max(abs(x[k]), 1e-3) * np.eye(len(x))[k]
        up, down = (problem.objective(x + side, problem.simulated_nodes(x + side)) for side in (step, -step))
        assert np.isclose((up - down) / (2 * np.sum(step)), condensed.g[k], rtol=1e-5)


def test_profile_and_sandwich_agree_for_a_linear_problem():
    random = np.random.default_rng(2)
    driven = 0.5 * np.sin(np.arange(600) * 0.03)
    read_off = 0.8 * np.cumsum(0.01 * np.append(0.0, driven[:-1])) + 0.01 * random.standard_normal(600)
    signals = {"steer": driven, "yaw_rate": read_off}
    problem = MotionProblem(
        Simulator(INTEGRATOR), [Recording("drive", 0.01 * np.arange(600), signals, hold="zero")], noise=np.array([0.01])
    )
    found = gauss_newton(problem, problem.start, search="levenberg_marquardt")
    told = uncertainty(problem, found.x, found.nodes)
    half = student.ppf(0.975, told.dof) * told.sd
    assert np.allclose(told.interval()[0], found.x[0] + half[0] * np.array([-1, 1]))
    assert np.allclose(profile(problem, found.x, found.nodes, 0, known=told).interval, told.interval()[0], rtol=1e-3)


def test_impulse_responses_have_the_tuned_correlated_kernel():
    prior = fading_prior(6, sd=0.4, decay=0.7, axes=1, mean=0.0)
    R, _ = prior_rows([Parameter("w", "1", np.zeros(6), prior=prior)])
    age = np.arange(6)[::-1]  # the oldest sample first
    kernel = 0.4**2 * np.minimum.outer(0.7**age, 0.7**age)
    assert np.allclose(np.linalg.inv((R.T @ R).toarray()), kernel)


def test_sigma_points_have_the_covariance():
    P = np.array([[4.0, 1.0, 0.5], [1.0, 2.0, 0.3], [0.5, 0.3, 1.0]])
    mean_weight, middle, other, reach = SigmaPoints().weights(3)
    root = reach * np.linalg.cholesky(P)
    points = np.vstack([np.zeros(3), root.T, -root.T])
    assert np.isclose(reach, np.sqrt(3))
    assert np.isclose(mean_weight + 6 * other, 1.0)
    assert min(mean_weight, middle, other) >= 0
    assert np.allclose(other * points.T @ points, P)


def test_readings_of_rough_models_are_tempered():
    assert np.isclose(tempering(10_000, inexact=True), 10 / (10 + 1.2e-3 * 10_000))
    assert np.isclose(tempering(10_000, inexact=True, left=0.5), 10 / (10 + (1.2e-3 + 0.01 * 0.5) * 10_000))
    assert tempering(10_000, inexact=False) == 1.0
