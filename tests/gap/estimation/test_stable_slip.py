"""A simulation that is slower or stiffer than its steps are made for stays a simulation."""

import numpy as np
import pytest

import greybox_id as gb
from greybox_id.fitting.scores.metrics import simulate
from greybox_id.gap.estimation.bench import Bench
from greybox_id.gap.estimation.stable_slip import STEP, with_stable_slip
from greybox_id.models.registry import build

STIFF = {"B_f": 3.0, "B_r": 3.0, "I_z": 1 / 3, "force_per_unit": 0.4}
"""A car that is slower than the recorded one, of stiffer tyres and less inertia, as searches pass by."""


@pytest.fixture(scope="module")
def lap():
    return gb.read(gb.datasets.shipped("racer_train"), columns="roboracer").rows(0, 700)


@pytest.fixture(scope="module")
def racer():
    return gb.models.single_track(vehicle="roboracer")


def changed(bench, by):
    names = [parameter.name for parameter in bench.model.parameters]
    return bench.model.values * np.array([by.get(name, 1.0) for name in names])


def jitter(bench, p):
    """How far a change of a millionth of every parameter moves the yaw rate, rad/s."""
    P = np.vstack([p, p * (1 + 1e-6 * np.random.default_rng(0).normal(size=len(p)))])
    one, other = bench.simulate(P)[:, :, bench.channels.index("yaw_rate")]
    return np.sqrt(np.mean((one - other) ** 2))


def of_short_steps(model, lap, p):
    bench = Bench(model, [lap])
    bench.longest = [longest / 16 for longest in bench.longest]
    return bench.simulate(p[None])[0]


def test_a_simulation_as_it_is_stated_stays_as_it_is(lap, racer):
    plain, stable = Bench(racer, [lap]), Bench(with_stable_slip(racer), [lap])
    (expected,), (found,) = (bench.simulate(bench.model.values[None]) for bench in (plain, stable))
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-12)


def test_a_stiff_and_slow_vehicle_is_no_noise(lap, racer):
    plain, stable = Bench(racer, [lap]), Bench(with_stable_slip(racer), [lap])
    p = changed(plain, STIFF)
    assert jitter(plain, p) > 1e-2  # what this is for
    assert jitter(stable, p) < 1e-4
    exact, c = of_short_steps(racer, lap, p), plain.channels.index("yaw_rate")
    off, noise = (np.sqrt(np.mean((bench.simulate(p[None])[0] - exact)[:, c] ** 2)) for bench in (stable, plain))
    assert off < 0.2 * np.std(exact[:, c])
    assert noise > 5 * off


def test_derivatives_are_those_of_what_is_simulated(lap, racer):
    bench = Bench(with_stable_slip(racer), [lap.rows(0, 120)])
    p, k = changed(bench, STIFF), [parameter.name for parameter in bench.model.parameters].index("I_z")
    _, J, _ = bench.linearise(p, [k])
    step = 1e-6 * p[k] * (np.arange(len(p)) == k)
    up, down = bench.simulate(np.vstack([p + step, p - step]))
    there = bench.counted
    np.testing.assert_allclose(J[there][:, 0], ((up - down) / (2e-6 * p[k]))[there], rtol=1e-3, atol=1e-3)


def test_without_steps_nothing_is_limited(lap, racer):
    model = with_stable_slip(racer)
    found, expected = (simulate(one, lap).predicted for one in (model, racer))
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-12)
    assert model.defaults[STEP] == 0.0


@pytest.mark.parametrize("name", ["kinematic", "longitudinal"])
def test_a_model_without_slip_angles_stays_as_it_is(name):
    model = build(name)
    assert with_stable_slip(model) is model


def test_a_model_whose_speed_is_read_has_it_too():
    model = with_stable_slip(gb.models.lateral())
    assert STEP in model.inputs
    assert model.defaults[STEP] == 0.0
