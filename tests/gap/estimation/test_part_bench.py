"""A parameter that differs in part of the rows differs there and nowhere else, and all else goes on as it was."""

import numpy as np
import pytest
from gap_cases import place

from greybox_id.gap.estimation.part_bench import PartBench

HERE = {
    "mass_change": 1.05, "steering_lag": 0.04, "steering_delay": 0.033, "sensor_latency_yaw": 0.0271,
    "yaw_rate_bias": 0.01, "grip_scale": 0.95,
}  # fmt: skip
PARTS = {"begins": slice(300, 500), "ends": slice(0, 120), "within": slice(60, 190), "second run": slice(250, 500)}


pytestmark = pytest.mark.usefixtures("_uncompiled")


def vector(bench, value):
    return np.append(bench.model.values, value)


@pytest.mark.parametrize("rows", PARTS.values(), ids=PARTS)
def test_what_does_not_differ_changes_nothing(bench, rows):
    index = place(bench, "mass_change")
    part, whole = PartBench(bench, index, rows), bench.simulate(bench.model.values[None])[0]
    for value in (np.nan, bench.model.values[index]):
        np.testing.assert_allclose(part.simulate(vector(bench, value)[None])[0], whole, rtol=1e-8, atol=1e-8)


@pytest.mark.parametrize("rows", PARTS.values(), ids=PARTS)
def test_a_bias_is_read_in_its_rows_alone(bench, rows):
    bench.measured[:, 1] = np.where(np.isfinite(bench.measured[:, 1]), bench.measured[:, 1], 0.0)
    part = PartBench(bench, place(bench, "yaw_rate_bias"), rows)
    c = bench.channels.index("yaw_rate")
    plain, other = (part.simulate(vector(bench, own)[None])[0] for own in (np.nan, 0.25))
    late = 3  # rows that a late sensor reads from before
    inside = np.zeros(len(plain), dtype=bool)
    inside[rows] = True
    off = other[:, c] - plain[:, c]
    starts = [own.start for own in bench.rows]
    begins_inside = [k for k in starts if inside[k]]
    for k in range(len(off)):
        run = max(start for start in starts if start <= k)
        if np.any(inside[max(k - late, run) : k + 1] != inside[k]) or np.isnan(off[k]):
            continue
        if run in begins_inside:  # where a run begins, its bias tells where its state does
            continue
        assert off[k] == pytest.approx(0.24 if inside[k] else 0.0, abs=1e-9)


def test_before_it_begins_nothing_is_known_of_it_and_afterwards_it_acts_as_it_does_everywhere(bench):
    index, start = place(bench, "grip_scale"), 80
    part = PartBench(bench, index, slice(start, 250))
    everywhere = PartBench(bench, index, slice(0, 250))
    before, begins, always = (
        own.simulate(vector(bench, value)[None])[0] for own, value in ((part, np.nan), (part, 0.6), (everywhere, 0.6))
    )
    p = np.array(bench.model.values)
    p[index] = 0.6
    np.testing.assert_allclose(always[:250], bench.simulate(p[None])[0][:250], rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(begins[:start], before[:start], rtol=1e-8, atol=1e-8)
    np.testing.assert_allclose(begins[250:], before[250:], rtol=1e-8, atol=1e-8)
    assert np.nanmax(np.abs(begins[start:250] - before[start:250])) > 0.01


@pytest.mark.parametrize("name", ["m", "D_r", "grip_scale", "steering_lag"])
def test_derivatives_are_those_of_the_simulation(bench, name):
    part = PartBench(bench, place(bench, "grip_scale"), slice(80, 390))
    p, index = vector(bench, 0.8), place(bench, name)
    y, J, _ = part.linearise(p, [index])
    step = 1e-5 * max(abs(p[index]), 1.0)
    sides = np.array([p, p])
    sides[:, index] += (step, -step)
    there = part.simulate(sides)
    np.testing.assert_allclose(y, part.simulate(p[None])[0], rtol=1e-9, atol=1e-9)
    expected = (there[0] - there[1]) / (2 * step)
    known = np.isfinite(expected)
    scale = np.nanmax(np.abs(expected))
    np.testing.assert_allclose(J[:, :, 0][known], expected[known], atol=2e-4 * scale)


def test_many_at_once_are_as_one_at_a_time(bench):
    part = PartBench(bench, place(bench, "grip_scale"), slice(80, 390))
    P = np.array([vector(bench, value) for value in (0.5, 0.7, np.nan, 0.9, 1.1)])
    P[3, place(bench, "steering_delay")] = 0.051
    for p, own in zip(P, part.simulate(P), strict=True):
        np.testing.assert_allclose(PartBench(bench, part.index, part.part).simulate(p[None])[0], own, atol=1e-11)


def test_states_and_parameters_along_segments_belong_together(bench):
    part = PartBench(bench, place(bench, "grip_scale"), slice(80, 390))
    p = vector(bench, 0.6)
    trajectory, along = part.trajectory(p), part.along(p)
    assert len(along) == sum(len(plan.segments) for plan, _ in trajectory)
    plan, z = trajectory[0]
    np.testing.assert_array_equal(
        along[: len(plan.segments), part.index] == 0.6, np.arange(len(plan.segments)) >= plan.row_segment[80]
    )
    assert len(z) == len(plan.segments)
    assert np.all(np.isfinite(z))
