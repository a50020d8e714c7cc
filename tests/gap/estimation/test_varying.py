"""Courses of magnitudes that vary: what they are made of, and that one along the path holds on another drive."""

import json
from dataclasses import replace

import casadi as cs
import numpy as np
import pytest
from driven import commands, without
from gap_cases import CAR, lap, nominal
from hypothesis import given
from hypothesis import strategies as st

import greybox_id as gb
from greybox_id.fitting.scores.metrics import simulate
from greybox_id.gap.estimation.bench import Bench
from greybox_id.gap.estimation.calibration import CAL
from greybox_id.gap.estimation.preparing import prepare
from greybox_id.gap.estimation.varying import PATH, TIME, MagnitudeCourse, Places, _knots, responses
from greybox_id.models.effects import EFFECTS
from greybox_id.models.registry import build
from greybox_id.models.vehicle import vehicle

NOISE = {"v_x": 0.02, "yaw_rate": 0.01, "a_x": 0.15, "a_y": 0.15}
NOTHING = np.empty(0)


def test_readings_respond_to_a_course_that_stays_as_to_the_parameter():
    known = {name: EFFECTS[name] for name in ("road_bank", "road_slope", "steering_offset")}
    driven = [lap(seconds=4.0), lap(seconds=3.0, seed=2)]
    bench = prepare(nominal(), driven, known, CAR).bench(driven)
    assert isinstance(bench, Bench)
    bench.loose = ()
    names = [parameter.name for parameter in bench.model.parameters]
    for name in known:
        index, p = names.index(name), bench.model.values
        _, J, _ = bench.linearise(p, [index])
        everywhere = responses(bench, p, index, np.ones((len(bench.measured), 1)))
        np.testing.assert_allclose(everywhere, np.where(bench.counted[..., None], J, 0.0), rtol=1e-6, atol=1e-9)
        halves = np.zeros((len(bench.measured), 2))
        halves[: len(halves) // 3, 0] = halves[len(halves) // 3 :, 1] = 1.0
        apart = responses(bench, p, index, halves)
        np.testing.assert_allclose(np.sum(apart, axis=2), everywhere[..., 0], rtol=1e-9, atol=1e-12)


def test_between_knots_a_course_is_the_expectation_of_its_process():
    at, value = np.array([0.0, 1.0, 2.5]), np.array([1.0, -1.0, 0.5])
    course = MagnitudeCourse("road_bank", "rad", TIME, 0.02, 2.0, at, NOTHING, NOTHING, NOTHING, value, np.ones(3))
    time = np.array([0.0, 0.5, 1.0, 2.5, 4.5, 200.0])
    found = course.weights(Places(time, NOTHING, NOTHING, NOTHING, NOTHING)) @ value
    np.testing.assert_allclose(found[[0, 2, 3]], value, atol=1e-9)
    assert found[1] == pytest.approx(0.0, abs=1e-9)  # as far from both
    assert json.loads(json.dumps(course.to_json()))["value"] == [1.0, -1.0, 0.5]
    assert found[4] == pytest.approx(0.5 * np.exp(-1.0))  # a Markov process: the last knot alone counts
    assert found[5] == pytest.approx(0.0, abs=1e-9)


def test_a_place_passed_the_other_way_is_another_place():
    straight, ones = np.linspace(0.0, 50.0, 11), np.ones(11)
    course = MagnitudeCourse("road_bank", "rad", PATH, 0.02, 10.0, straight, straight, 0 * ones, 0 * ones, ones, ones)
    there = Places(straight, straight, straight, 0 * ones, 0 * ones)
    back = replace(there, yaw=np.pi * ones)
    np.testing.assert_allclose(course.weights(there) @ ones, 1.0, atol=1e-9)
    assert np.max(course.weights(back) @ ones) < 0.4


@given(st.integers(2, 300), st.floats(0.01, 30.0), st.integers(0, 10))
def test_knots_are_apart_and_near_every_row(rows, apart, seed):
    coordinates = np.cumsum(np.random.default_rng(seed).standard_normal((rows, 2)), axis=0)
    knots = coordinates[_knots(coordinates, apart)]
    off = np.linalg.norm(coordinates[:, None] - knots[None], axis=2)
    between = np.linalg.norm(knots[:, None] - knots[None], axis=2) + 1e9 * np.eye(len(knots))
    assert len(knots) <= CAL.most_knots
    assert np.min(between) >= apart
    if rows <= CAL.most_knots:  # all may be knots: none is farther apart than it has to be
        assert np.max(np.min(off, axis=1)) < apart


def driven(seed, seconds=60.0, lap_time=20.0, sd=0.03):
    """Laps of a circle whose bank varies along it, with other commands for other seeds."""
    model, road = build("single_track", None, {}, vehicle("full_size_car")), np.random.default_rng(5)
    commanded = commands(seconds, seed, dt=0.02)
    phase, rng = (commanded.time % lap_time) / lap_time, np.random.default_rng(seed)
    waves = [(k, *(sd / 2 * road.standard_normal(2))) for k in (1, 2, 3, 5)]
    bank = sum(a * np.sin(2 * np.pi * k * phase) + b * np.cos(2 * np.pi * k * phase) for k, a, b in waves)
    model = replace(model, inputs=(*model.inputs, "varies")).altered(
        gravity_y=lambda g_y, q: g_y + 9.81 * cs.sin(q.u.varies)
    )
    found = simulate(model, without(commanded.with_signals(varies=bank), "v_x"), {"v_x": 18.0})
    read = {name: found.predicted[:, k] + NOISE[name] * rng.standard_normal(len(bank))
            for k, name in enumerate(model.outputs) if name in NOISE}  # fmt: skip
    x, y = (60 * wave(2 * np.pi * phase) + 0.1 * rng.standard_normal(len(bank)) for wave in (np.cos, np.sin))
    return replace(without(commanded, "v_x").with_signals(**read, x=x, y=y), name=f"drive{seed}"), bank


@pytest.mark.slow
def test_a_bank_along_the_path_closes_the_gap_on_another_drive():
    (first, bank), (second, _) = (driven(seed) for seed in (11, 12))
    found = gb.diagnose("single_track", first, vehicle="full_size_car", held_out=second)
    (course,) = found.courses
    assert (course.effect, course.along, course.held_out, course.recordings) == ("road_bank", PATH, True, ("drive12",))
    assert course.closed > 0.7
    assert course.closed_interval[0] > 0.5
    true = np.array([bank[np.argmin((first["x"] - x) ** 2 + (first["y"] - y) ** 2)]
                     for x, y in zip(course.x, course.y, strict=True)])  # fmt: skip
    off = (course.value - true - np.mean(course.value - true)) / course.value_sd  # its constant part is a nuisance
    assert np.corrcoef(course.value, true)[0, 1] > 0.85
    assert 0.3 < np.std(off) < 1.6
    json.dumps(found.to_json(), allow_nan=True)  # plain data
    assert "with a course of road_bank along the path" in found.summary()
