"""Motion problems: derivatives, lanes, timing and starts, against an independent simulator."""

import gc
import weakref

import numpy as np
import pytest
from reference_manoeuvres import manoeuvre
from reference_vehicle import FULL_SIZE_CAR, simulate

from greybox_id.datasets.recording import Recording
from greybox_id.engine.motion import shooting
from greybox_id.engine.motion.shooting import MotionProblem
from greybox_id.engine.motion.simulator import Predictor, Simulator
from greybox_id.engine.solvers.gauss_newton import Status, gauss_newton
from greybox_id.engine.solvers.ipopt import ipopt
from greybox_id.models.effects import EFFECTS
from greybox_id.models.registry import build

NOISE = {"v_x": 0.02, "v_y": 0.02, "yaw_rate": 0.01, "a_x": 0.15, "a_y": 0.15}
CHANNELS = tuple(NOISE)


def car(name="single_track", *effects, free=()):
    """The reference's car as a model; effects as (name, magnitude), free ones by name."""
    model = build(name)
    model = model.with_parameters(
        *(p.with_value(FULL_SIZE_CAR[p.name]) for p in model.parameters if p.name in FULL_SIZE_CAR)
    )
    for effect, value in effects:
        model = model + (EFFECTS[effect].starting_at(value) if effect in free else EFFECTS[effect].at(value))
    return model


def driven(effects=None, duration=8.0, rate=100.0, seed=0, noise=0.0, hold="zero", kind="mixed"):
    """A recording from the independent simulator."""
    commands = manoeuvre(kind, FULL_SIZE_CAR, seed=seed, duration=duration, rate=rate)
    found = simulate(
        FULL_SIZE_CAR, commands, dict(effects or {}), hold=hold, start=(commands["v_x"][0], 0.0, 0.0), fine=5e-4
    )
    random = np.random.default_rng(seed)
    readings = {c: found[c] + noise * NOISE[c] * random.standard_normal(len(found[c])) for c in CHANNELS}
    signals = {"steer": commands["steer"], "drive_force": commands["drive"], **readings}
    return Recording("driven", commands["time"], signals, hold=hold)


def problem(model, recordings, **options):
    noise = np.array([NOISE[name] for name in model.outputs])
    return MotionProblem(Simulator(model, compiled=False), recordings, noise=noise, **options)


def misses(recording, model):
    """Largest error of a free run, by channel, over the channel's spread."""
    found = Predictor(Simulator(model, compiled=False), recording, model.values).free_run()
    error = np.nanmax(np.abs(found.predicted - found.measured), axis=0)
    return error / np.std(found.measured, axis=0)


@pytest.mark.parametrize("hold", ["zero", "linear"])
def test_a_free_run_is_that_of_an_independent_simulator(hold):
    assert np.all(misses(driven(hold=hold), car()) < 2e-4)


@pytest.mark.parametrize("delay", [0.0033, 0.01, 0.0371])
@pytest.mark.parametrize("effect", ["steering_delay", "sensor_latency_imu", "sensor_latency_yaw", "sensor_latency_vx"])
def test_delays_and_latencies_are_exact_at_fractions_of_a_sample(effect, delay):
    assert np.all(misses(driven({effect: delay}), car("single_track", (effect, delay))) < 5e-4)


def test_two_shifts_at_once_are_exact():
    shifts = {"steering_delay": 0.0137, "sensor_latency_imu": 0.0062}
    assert np.all(misses(driven(shifts), car("single_track", *shifts.items())) < 5e-4)


CASES = {
    "whole runs": ((), {}),
    "measured starts": ((), {"starts": "measured"}),
    "a horizon": ((), {"horizon": 0.5}),
    "robust": ((), {"robust": 1.5}),
    "a delay": ((("steering_delay", 0.0137),), {}),
    "a latency over a horizon": ((("sensor_latency_imu", 0.0062),), {"horizon": 0.5}),
    "a lag carried over intervals": ((("steering_lag", 0.05),), {"horizon": 0.5, "starts": "measured"}),
    "relaxation": ((("tyre_relaxation", 0.4),), {}),
}


@pytest.mark.parametrize("case", CASES)
def test_the_gradient_is_the_objectives_derivative(case):
    effects, options = CASES[case]
    model = car("single_track", *effects, free=tuple(name for name, _ in effects))
    stated = problem(model, [driven(duration=2.0, noise=1.0)], **options)
    x = stated.start
    x[stated.free] *= 1.01
    equations = stated.normal_equations(x, stated.simulated_nodes(x))

    def objective(k, step):
        moved = x.copy()
        moved[k] += step
        return stated.objective(moved, stated.simulated_nodes(moved))

    moving = np.flatnonzero(stated.free)
    for k in moving[np.linspace(0, len(moving) - 1, min(len(moving), 14)).astype(int)]:
        step = 1e-5 * max(1e-2, abs(x[k]))
        slope = (objective(k, step) - objective(k, -step)) / (2 * step)
        assert equations.g[k] == pytest.approx(slope, rel=2e-4, abs=1e-4 * np.sqrt(equations.H[k, k]) + 1e-6)


def test_residuals_and_normal_equations_say_the_same():
    stated = problem(car(), [driven(duration=2.0, noise=1.0)], horizon=0.5)
    nodes = stated.simulated_nodes(stated.start)
    equations, g = stated.normal_equations(stated.start, nodes), np.zeros(stated.layout.size)
    for index, (e, J) in zip(stated.layout.index, stated.residuals(stated.start, nodes), strict=True):
        g[index] += np.einsum("ro,rop->p", e, J)
    np.testing.assert_allclose(g[stated.free], equations.g[stated.free], rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize("effects", [(), ("sensor_latency_imu", 0.025)])
def test_a_long_interval_in_parts_is_the_same_as_whole(effects, monkeypatch):
    recordings = [driven(duration=2.0, noise=1.0), driven(duration=1.0, noise=1.0, seed=1)]
    model = car("single_track", effects, free=effects[:1]) if effects else car()
    whole = problem(model, recordings)
    monkeypatch.setattr(shooting, "LANE", 4)
    cut = problem(model, recordings)
    x = whole.start
    nodes = cut.simulated_nodes(x)
    expected = list(whole.residuals(x, whole.simulated_nodes(x)))
    found = [(np.zeros_like(e), np.zeros_like(J)) for e, J in expected]
    parts = list(cut.parts(x, nodes))
    assert len(parts) > len(expected)
    for k, start, e, J in parts:
        found[k][0][start : start + len(e)] += e
        found[k][1][start : start + len(e)] += J
    for (e, J), (e_found, J_found) in zip(expected, found, strict=True):
        np.testing.assert_allclose(e_found, e, atol=1e-6)
        np.testing.assert_allclose(J_found, J, atol=1e-6 * np.max(np.abs(J)))


def test_a_problem_stated_again_for_another_noise_is_laid_out_once():
    first = problem(car(), [driven(duration=2.0, noise=1.0)])
    first.simulated_nodes(first.start)
    stated = {"noise": 2.0 * first.noise, "about": first.model.values}
    again = MotionProblem(first.simulator, [driven(duration=2.0, noise=1.0)], **stated, like=first)
    afresh = MotionProblem(first.simulator, [driven(duration=2.0, noise=1.0)], **stated)
    x = first.start
    assert again.lanes(x)[1] is first.lanes(x)[1]
    assert again.unknowns_laid is first.unknowns_laid
    for other in ({"horizon": 1.0}, {"starts": "measured"}, {"strengths": {"weights": 2.0}}):
        own = MotionProblem(first.simulator, [driven(duration=2.0, noise=1.0)], **stated, **other, like=first)
        assert own.unknowns_laid is not first.unknowns_laid
    one, other = (own.normal_equations(x, own.simulated_nodes(x)) for own in (again, afresh))
    np.testing.assert_allclose(one.H, other.H, rtol=1e-9)


def test_lanes_matched_side_by_side_are_the_simulation_one_after_the_other():
    stated = problem(car(), [driven(noise=1.0)])
    x = stated.start
    stated.normal_equations(x, stated.simulated_nodes(x))
    x = x * np.where(stated.free, 1.02, 1.0)
    beside = stated.simulated_nodes(x)
    afresh = problem(car(), [driven(noise=1.0)]).simulated_nodes(x)
    np.testing.assert_allclose(beside.y, afresh.y, atol=1e-6)


def test_readings_under_other_inputs_are_those_of_the_simulation_and_no_lane_is_cut_for_them(monkeypatch):
    stated, cuts = problem(car(), [driven(noise=1.0), driven(noise=1.0, seed=1, duration=5.0)]), []
    other = stated.driven_by([1.01 * run.inputs for run in stated.runs])
    x = other.start + 0.001
    lay = shooting.lay
    monkeypatch.setattr(shooting, "lay", lambda *given: (cuts.append(len(given)), lay(*given))[1])
    alone = other.predicted_readings(x[None])[0]
    assert cuts == [2]  # plans and intervals: no number of lanes
    np.testing.assert_array_equal(alone, other.simulated_nodes(x).y)


def test_of_a_horizon_that_only_leads_the_way_some_intervals_of_every_run_are_enough():
    recordings = [driven(duration=4.0, noise=1.0, seed=seed) for seed in (0, 1)]
    whole, thinned = (problem(car(), recordings, horizon=0.5, starts="measured", most_rows=own) for own in (None, 200))
    assert thinned.intervals == whole.intervals[::4]
    assert {own.run for own in thinned.intervals} == {0, 1}


def test_a_reading_that_would_have_been_taken_before_the_run_is_not_counted():
    stated = problem(car("single_track", ("sensor_latency_imu", 0.025)), [driven(duration=1.0)])
    taken = stated.simulated_nodes(stated.start).taken
    assert not np.any(taken[:3, 2:])
    assert np.all(taken[:, :2])
    assert np.all(taken[3:])


def test_what_gauss_newton_finds_ipopt_confirms_and_a_point_beside_it_not():
    stated = problem(car(), [driven(duration=4.0, noise=1.0)])
    found = gauss_newton(stated, stated.start, tolerance=1e-12, negligible=0.0, search="levenberg_marquardt")
    assert found.status is Status.CONVERGED
    confirmed, _ = ipopt(stated, found.x, warm=True, max_iterations=30)
    assert confirmed.status is Status.CONVERGED
    assert confirmed.objective == pytest.approx(found.objective, rel=1e-6)
    beside = np.where(stated.free & (np.arange(len(found.x)) < stated.parameters.size), found.x * 1.02, found.x)
    improved, _ = ipopt(stated, beside, warm=True, max_iterations=60)
    assert improved.objective < stated.objective(beside, stated.simulated_nodes(beside)) * (1 - 1e-4)


def test_several_recordings_share_the_parameters_and_keep_a_bias_each():
    model = car("single_track", ("yaw_rate_bias", 0.0), free=("yaw_rate_bias",))
    bias = model["yaw_rate_bias"]
    model = model.with_parameters(type(bias)(**{**vars(bias), "scope": "run"}))
    drives = [driven(duration=4.0, seed=k, noise=1.0) for k in range(2)]
    drives = [d.with_signals(yaw_rate=d["yaw_rate"] + offset) for d, offset in zip(drives, (0.02, -0.03), strict=True)]
    stated = problem(model, drives)
    found = gauss_newton(stated, stated.start, tolerance=1e-10, negligible=0.0, search="levenberg_marquardt")
    place = [p.name for p in model.parameters].index("yaw_rate_bias")
    np.testing.assert_allclose(stated.per_run(found.x)[:, place], [0.02, -0.03], atol=2e-3)


def test_a_robust_loss_sees_past_outliers():
    clean = driven(noise=1.0)
    random = np.random.default_rng(3)
    hit = random.random(len(clean)) < 0.02
    spoilt = clean.with_signals(yaw_rate=clean["yaw_rate"] + hit * 0.5)
    model = car()
    free = [p.name for p in model.parameters].index("I_z")
    ends = {}
    for robust in (None, 2.0):
        stated = problem(model, [spoilt], robust=robust)
        found = gauss_newton(stated, stated.start, tolerance=1e-9, negligible=0.0, search="levenberg_marquardt")
        ends[robust] = abs(stated.shared(found.x)[free] / FULL_SIZE_CAR["I_z"] - 1)
    assert ends[2.0] < 0.02
    assert ends[2.0] < ends[None]


def test_what_ipopt_solved_is_let_go_with_its_last_name():
    lap = driven(duration=1.0)
    gc.disable()  # layouts of hours must not wait for it
    try:
        asked = problem(car("lateral"), [lap])
        ipopt(asked, asked.start, warm=True, max_iterations=1)
        left = weakref.ref(asked)
        del asked
        assert left() is None
    finally:
        gc.enable()


def test_where_derivatives_leave_the_range_of_numbers_ipopt_hears_it_and_nobody_is_warned():
    lap = problem(car("lateral"), [driven(duration=1.0)])
    far = lap.start.copy()
    far[[p.name for p in lap.model.parameters].index("I_z")] *= 1e-100
    solution, _ = ipopt(lap, far, warm=True, max_iterations=1)
    assert solution.status is not Status.CONVERGED


def test_a_whole_run_without_delays_is_laid_out_without_a_copy():
    stated = problem(car("lateral"), [driven(duration=2.03)])
    lanes, cut = stated.lanes(stated.start)
    y = stated.simulated_nodes(stated.start).read
    assert lanes.in_order
    assert not cut.in_order
    assert np.shares_memory(lanes.segments, stated._plans[1][0].segments)
    assert np.shares_memory(lanes.gathered(y), y)
    assert np.shares_memory(lanes.scattered(stated.target), stated.target)
    assert np.array_equal(cut.gathered(cut.scattered(stated.target)), stated.target)


def test_layouts_that_were_forgotten_are_made_again():
    stated = problem(car(), [driven(duration=2.0)])
    before = stated.normal_equations(stated.start, stated.simulated_nodes(stated.start))
    stated.forget()
    again = stated.normal_equations(stated.start, stated.simulated_nodes(stated.start))
    assert np.array_equal(before.H, again.H)
    assert np.array_equal(before.g, again.g)
