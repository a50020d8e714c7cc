"""The least-squares problem: total derivatives, priors, mirror images, run-scoped parameters."""

from dataclasses import replace

import numpy as np
import pytest
from toys import TINY, drive, joined, linear_toy, scattered, speed_toy, tiny

from greybox_id.engine.series import Run
from greybox_id.engine.shooting import Problem
from greybox_id.engine.trace import Trace
from greybox_id.models.effects import sensor_latency_imu, steering_rate_limit
from greybox_id.models.parameter import Parameter, Prior, placed


def problem_of(model, *recordings, closed_loop=False, **more):
    noise = np.linspace(0.3, 0.7, len(model.outputs))
    return Problem(Trace(model), recordings or [joined(26, 18)], closed_loop=closed_loop, noise=noise, **more)


def limited(model):
    """With a rate limit that is estimated."""
    free = Parameter("steering_rate_limit", "rad/s", 1.7, (0.1, 10.0))
    return (model + steering_rate_limit.at(1.7)).with_parameters(free)


def late(model):
    """With a latency that is estimated, away from its null, where it has one slope only."""
    model = model + sensor_latency_imu
    return model.with_parameters(model["sensor_latency_imu"].with_value(0.07))


full, lat = tiny("msnn_full"), tiny("msnn_lat")
CASES = {
    "lat, open": (lat, False),
    "lat, symmetric": (replace(lat, symmetric=True), False),
    "full, open": (full, False),
    "full, closed": (full, True),
    "full, closed, symmetric": (replace(full, symmetric=True), True),
    "full, closed, limit held": (full + steering_rate_limit.at(1.7), True),
    "full, closed, limit free": (limited(full), True),
    "full, closed, late": (late(full), True),
    "full, closed, limit free, late, symmetric": (replace(late(limited(full)), symmetric=True), True),
    "lat, limit free, late": (late(limited(lat)), False),
    "plus, closed": (tiny("msnn_full_plus"), True),
    "loop, closed": (speed_toy(), True),
}


COVERED = {"full, closed, symmetric", "full, closed, limit free", "full, closed, late"}
"""Cases that the one with everything in it covers too: they only say which of the three is at fault."""
ALL = [pytest.param(case, marks=pytest.mark.slow if case in COVERED else ()) for case in CASES]


def residuals_at(problem, x):
    return np.concatenate([r.ravel() for r, _ in problem.residuals(x, problem.simulated_nodes(x))])


def directions(problem, x):
    """Per parameter, one random direction in all of its free entries, and one in its first entry alone."""
    rng = np.random.default_rng(7)
    for parameter, place in placed(problem.trace.model.parameters):
        own = np.unique([index[place] for index in problem.layout.index])
        for entries in (own, own[:1]):
            e = np.zeros(len(x))
            e[entries] = rng.standard_normal(len(entries)) * np.maximum(np.abs(x[entries]), 1e-2)
            if not parameter.fixed:
                yield parameter.name, e


@pytest.mark.parametrize("case", ALL)
def test_total_derivatives_are_those_of_finite_differences_of_a_simulation(case):
    model, closed = CASES[case]
    model = scattered(model, 2, share=0.2)
    problem = problem_of(model, closed_loop=closed)
    x = problem.start
    found = []
    for index, (r, J) in zip(problem.layout.index, problem.residuals(x, problem.simulated_nodes(x)), strict=True):
        wide = np.zeros((r.size, len(x)))
        wide[:, index] = J.reshape(r.size, -1)
        found.append(wide)
    found = np.vstack(found)
    for name, e in directions(problem, x):
        slope = (residuals_at(problem, x + 1e-6 * e) - residuals_at(problem, x - 1e-6 * e)) / 2e-6
        np.testing.assert_allclose(found @ e, slope, atol=2e-4 * (np.max(np.abs(slope)) + 1e-3), err_msg=name)


@pytest.mark.parametrize("case", ALL)
def test_the_gradient_of_the_normal_equations_is_that_of_the_objective(case):
    model, closed = CASES[case]
    problem = problem_of(scattered(model, 2, share=0.2), closed_loop=closed)
    x = problem.start
    g = problem.normal_equations(x, problem.simulated_nodes(x)).g
    rng = np.random.default_rng(0)
    for _ in range(3):
        direction = np.where(problem.free, rng.standard_normal(len(x)) * (np.abs(x) + 0.01), 0.0)
        up, down = (
            problem.objective(x + h * direction, problem.simulated_nodes(x + h * direction)) for h in (1e-6, -1e-6)
        )
        scale = np.linalg.norm(g * direction)
        assert (up - down) / 2e-6 == pytest.approx(g @ direction, abs=1e-4 * scale)


@pytest.mark.parametrize("braking", [slice(20, 25), slice(20, 25, 3), slice(60, 150)])
def test_derivatives_that_are_zero_in_most_rows_are_left_out_of_products(braking):
    model, recording = scattered(tiny("msnn_long")), drive(150)
    current = np.abs(recording["motor_current"]) + 0.1
    current[braking] *= -1.0
    problem = problem_of(model, drive(150).with_signals(motor_current=current))
    for x in (problem.start, 1.1 * problem.start):
        equations = problem.normal_equations(x, [])
        ((residuals, J),) = problem.residuals(x, [])
        J, prior = J.reshape(-1, len(x)), problem.R.toarray()
        np.testing.assert_allclose(equations.H, J.T @ J + prior.T @ prior, rtol=1e-9, atol=1e-9)
        np.testing.assert_allclose(
            equations.g, J.T @ residuals.ravel() + prior.T @ problem.prior_residuals(x), rtol=1e-9
        )


def test_another_recording_of_the_signal_s_zeros_is_noticed():
    problem = problem_of(tiny("msnn_long"), drive(150))
    J, other = np.ones((60, 9)), np.ones((60, 9))
    J[5:, 2:7], other[10:, 2:7] = 0.0, 0.0
    for matrix in (J, other):
        rare = problem._rare_of(0, matrix)
        assert rare.columns == slice(2, 7)
        assert not np.any(matrix[rare.beside, rare.columns])


def test_parameters_as_numbers_leave_residuals_and_the_other_derivatives_as_they_are():
    model = scattered(late(limited(full)), 2, share=0.2)
    names = [*(p.name for p in full.parts[1].parameters), "steering_rate_limit", "sensor_latency_imu"]
    whole, fewer = (problem_of(own, closed_loop=True) for own in (model, model.with_constants(names)))
    places = np.concatenate([np.arange(whole.layout.size)[place] for p, place in placed(model.parameters)
                             if p.name not in names])  # fmt: skip
    assert len(places) == fewer.layout.size == fewer.trace.model.size
    found, wanted = (list(own.residuals(own.start, own.simulated_nodes(own.start))) for own in (fewer, whole))
    for (r, J), (all_r, all_J), index in zip(found, wanted, whole.layout.index, strict=True):
        np.testing.assert_allclose(r, all_r, rtol=1e-10, atol=1e-10)
        columns = [int(np.flatnonzero(index == place)[0]) for place in places]
        np.testing.assert_allclose(J, all_J[:, :, columns], rtol=1e-9, atol=1e-9)


OPEN = {model.name: (model, False) for model in (tiny(name) for name in TINY if name != "msnn_full")}


@pytest.mark.parametrize("case", [*ALL, *(pytest.param(name, id=f"{name}, tiny") for name in OPEN)])
def test_the_adjoint_gradient_is_that_of_the_normal_equations(case):
    model, closed = {**CASES, **OPEN}[case]
    problem = problem_of(scattered(model, 3, share=0.2), closed_loop=closed)
    x = problem.start
    nodes = problem.simulated_nodes(x)
    equations = problem.normal_equations(x, nodes)
    unit = 1.0 / np.sqrt(np.maximum(np.diag(equations.H), 1e-300))
    expected = np.where(problem.free, unit * equations.g, 0.0)
    np.testing.assert_allclose(unit * problem.gradient(x, nodes), expected, atol=1e-9 * np.max(np.abs(expected)))


def test_a_problem_counted_otherwise_is_the_one_made_so():
    recording, prior = joined(60, 40), Prior(0.5, mean=0.2, strength="held")
    keep = [(np.arange(60) < 30).astype(float), np.ones(40)]
    F, noise = np.array([0.7, -0.3]), np.array([0.11])
    plain = problem_of(linear_toy(2, prior), recording)
    plain.objective(F, [])
    plain.normal_equations(F, [])
    other = plain.counted(noise=noise, strengths={"held": 3.0}, keep=keep)
    made = Problem(Trace(linear_toy(2, prior)), [recording], noise=noise, strengths={"held": 3.0}, keep=keep)
    for mine, theirs in ((other, made), (plain, problem_of(linear_toy(2, prior), recording))):
        assert mine.objective(F, []) == theirs.objective(F, [])
        np.testing.assert_allclose(mine.normal_equations(F, []).H, theirs.normal_equations(F, []).H, rtol=1e-14)
        np.testing.assert_allclose(mine.normal_equations(F, []).g, theirs.normal_equations(F, []).g, rtol=1e-14)


def test_what_was_linearised_still_holds_where_strengths_alone_change():
    plain = problem_of(lat)
    x = plain.start + 0.01
    nodes = plain.simulated_nodes(x)
    strengths = {p.prior.strength: 3.0 for p in lat.parameters if p.prior is not None and p.prior.strength}
    fresh = plain.counted(strengths=strengths).normal_equations(x, nodes)
    plain.normal_equations(x, nodes)
    other = plain.counted(strengths=strengths)
    assert other._last is not None
    kept = other.normal_equations(x, nodes)
    np.testing.assert_allclose(kept.H, fresh.H, rtol=1e-9, atol=1e-9 * np.max(np.abs(fresh.H)))
    np.testing.assert_allclose(kept.g, fresh.g, rtol=1e-9, atol=1e-9 * np.max(np.abs(fresh.g)))


def test_the_misfit_of_a_point_is_kept_where_strengths_alone_change(monkeypatch):
    prior, F = Prior(0.5, mean=0.2, strength="held"), np.array([0.7, -0.3])
    plain, asked = problem_of(linear_toy(2, prior)), []
    made = problem_of(linear_toy(2, prior), strengths={"held": 3.0}).objective(F, [])
    predict = Run.predict
    monkeypatch.setattr(Run, "predict", lambda run, p: asked.append(1) or predict(run, p))
    plain.objective(F, [])
    once = len(asked)
    assert plain.counted(strengths={"held": 3.0}).objective(F, []) == made
    assert len(asked) == once > 0
    assert plain.objective(2.0 * F, []) == problem_of(linear_toy(2, prior)).objective(2.0 * F, [])


def test_predictions_before_and_after_a_linearisation_elsewhere_are_those_of_fresh_runs():
    """What windows looked at is kept for one point alone."""
    first, second = (problem_of(lat).start + step for step in (0.0, 0.01))
    kept = problem_of(lat)
    for x in (first, first, second, first):
        assert kept.misfit(x, []) == problem_of(lat).misfit(x, [])
        expected = problem_of(lat).normal_equations(x, []).H
        np.testing.assert_allclose(
            kept.normal_equations(x, []).H, expected, rtol=1e-12, atol=1e-12 * np.max(np.abs(expected))
        )


def test_folds_linearised_together_are_those_linearised_one_by_one():
    name = "msnn_full"
    rng = np.random.default_rng(3)
    problem = Problem(Trace(tiny(name)), [joined(60, 45)], closed_loop=True, noise=np.array([0.1, 0.4]))
    x = problem.unknowns(scattered(tiny(name), share=0.05).values)
    nodes = problem.simulated_nodes(x)
    keeps = [[rng.integers(0, 2, len(run)).astype(float) for run in problem.runs] for _ in range(3)]
    for fold, keep in zip(problem.folds(x, nodes, keeps), keeps, strict=True):
        together, alone = (one.normal_equations(x, nodes) for one in (fold, problem.counted(keep=keep)))
        assert np.allclose(together.H, alone.H, atol=1e-9 * np.max(np.abs(alone.H)))
        assert np.allclose(together.g, alone.g, atol=1e-9 * np.max(np.abs(alone.g)))
        assert fold.objective(x, nodes) == problem.counted(keep=keep).objective(x, nodes)


def test_the_objective_is_written_out_half_the_sum_of_squares():
    prior = Prior(0.5, mean=0.2)
    recording = drive(30)
    problem = problem_of(linear_toy(2, prior), recording)
    F = np.array([0.7, -0.3])
    steer, measured = recording["steer"], recording["yaw_rate"]
    residuals = [(F[0] * steer[k - 2] + F[1] * steer[k - 1] - measured[k]) / 0.3 for k in range(2, 30)]
    expected = 0.5 * np.sum(np.square(residuals)) + 0.5 * np.sum(((F - 0.2) / 0.5) ** 2)
    assert problem.objective(F, []) == pytest.approx(expected)


def test_a_mirror_image_adds_nothing_where_the_model_is_odd():
    plain, both = (problem_of(linear_toy(2, symmetric=s), joined(40, 30)) for s in (False, True))
    F = np.array([0.7, -0.3])
    assert both.misfit(F, []) == pytest.approx(plain.misfit(F, []))
    a, b = (q.normal_equations(F, []) for q in (plain, both))
    np.testing.assert_allclose(a.H, b.H)
    np.testing.assert_allclose(a.g, b.g, atol=1e-12)


def test_a_symmetric_model_fits_recording_and_mirror_image_alike():
    lopsided = replace(
        linear_toy(1), symmetric=True, equations=lambda u, p, past: {"yaw_rate": p.F[0] + past(u.steer, [1.0])}
    )
    problem = problem_of(lopsided, drive(30))
    assert problem.normal_equations(np.zeros(1), []).g == pytest.approx(0.0, abs=1e-12)


def test_rows_that_are_not_kept_do_not_count():
    recording = drive(60)
    keep = [(np.arange(60) < 30).astype(float)]
    half = problem_of(linear_toy(2), recording, keep=keep)
    first = problem_of(linear_toy(2), recording.rows(0, 30))
    F = np.array([0.7, -0.3])
    assert half.misfit(F, []) == pytest.approx(first.misfit(F, []))


def test_a_run_scoped_parameter_has_a_value_and_a_prior_per_run():
    problem = problem_of(linear_toy(1) + sensor_latency_imu, joined(30, 30, 30))
    assert problem.layout.size == 1 + 3
    x = problem.unknowns(np.array([1.0, 0.04]))
    late = x.copy()
    late[2] += 0.03
    assert np.sum(problem.prior_residuals(x) ** 2) == pytest.approx(0.0)
    assert np.sum(problem.prior_residuals(late) ** 2) == pytest.approx(1.0)
    assert problem.shared(late)[1] == pytest.approx(0.05)


def test_a_run_and_its_mirror_image_share_their_run_scoped_parameters():
    problem = problem_of(linear_toy(1, symmetric=True) + sensor_latency_imu, joined(30, 30))
    assert problem.layout.size == 1 + 2


def test_held_parameters_and_bounds_are_known():
    problem = problem_of(lat + steering_rate_limit.at(1.7), joined(40, 35))
    assert np.flatnonzero(~problem.free).tolist() == [len(problem.start) - 1]
    assert problem.bounds[0][-1] == 0.1
