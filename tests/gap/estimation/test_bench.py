"""The bench simulates as the package simulates, many vectors at once as one at a time, with true derivatives."""

from dataclasses import replace

import numpy as np
import pytest
from driven import driven, without
from gap_cases import CAR, place

from greybox_id.datasets.recording import join
from greybox_id.fitting.scores.metrics import simulate
from greybox_id.gap.estimation.bench import Bench
from greybox_id.gap.estimation.calibration import CAL
from greybox_id.models.registry import build

HERE = {
    "mass_change": 1.05, "steering_lag": 0.04, "steering_delay": 0.033, "sensor_latency_yaw": 0.0271,
    "accel_bias_y": 0.1, "tyre_relaxation": 0.3, "wheel_speed_scale": 1.02,
}  # fmt: skip
COLUMNS = (*HERE, "m", "D_r", "B_f")


pytestmark = pytest.mark.usefixtures("_uncompiled")


def moved(bench, name, by):
    p = np.array(bench.model.values)
    p[place(bench, name)] += by
    return p


def counted(bench, monkeypatch):
    """How many lanes the kernel is asked for, call by call."""
    asked, plain = [], bench.simulator.kernel.simulate

    def simulate(z0, *given):
        asked.append(len(z0))
        return plain(z0, *given)

    monkeypatch.setattr(bench.simulator.kernel, "simulate", simulate)
    return asked


@pytest.mark.parametrize("effects", [{}, HERE], ids=["plain", "with effects"])
def test_a_simulation_is_that_of_the_package(drive, effects):
    model = build("single_track", None, effects, CAR)
    drive = join([run.rows(3, 125) for run in drive.each_run()], "late")  # from a row that has all readings
    expected = simulate(model, drive).predicted
    found = Bench(model, [drive]).simulate(model.values[None])[0]
    there = np.isfinite(expected)  # a late sensor reads nothing at first
    assert np.mean(there) > 0.99
    np.testing.assert_allclose(found[there], expected[there], rtol=1e-9, atol=1e-9)


def test_the_lateral_model_is_simulated_at_its_recorded_speed():
    drive = driven("lateral", runs=1, seconds=5.0, effects={"steering_delay": 0.05})
    model = build("lateral", None, {"steering_delay": 0.05}, CAR)
    expected = simulate(model, drive).predicted
    np.testing.assert_allclose(Bench(model, [drive]).simulate(model.values[None])[0], expected, rtol=1e-9, atol=1e-9)


def test_many_vectors_at_once_are_simulated_as_one_at_a_time(bench):
    rng, base = np.random.default_rng(0), np.array(bench.model.values)
    P = np.repeat(base[None], 11, axis=0)
    P[:, place(bench, "mass_change")] *= rng.uniform(0.9, 1.1, 11)
    P[::2, place(bench, "steering_delay")] = rng.uniform(0.0, 0.1, 6)
    P[3, place(bench, "steering_delay")] = 0.0
    P[4, place(bench, "sensor_latency_yaw")] = 0.0
    alone = np.concatenate([bench.simulate(p[None]) for p in P])
    np.testing.assert_allclose(bench.simulate(P), alone, rtol=1e-9, atol=1e-9)
    np.testing.assert_array_equal(bench.simulate(P), bench.simulate(P))


def test_runs_are_simulated_each_by_itself(drive, bench):
    both = bench.simulate(bench.model.values[None])[0]
    parts = [Bench(bench.model, [run]).simulate(bench.model.values[None])[0] for run in drive.each_run()]
    np.testing.assert_allclose(both, np.concatenate(parts), rtol=1e-9, atol=1e-9)
    apart = Bench(bench.model, list(drive.each_run())).simulate(bench.model.values[None])[0]
    np.testing.assert_allclose(both, apart, rtol=1e-9, atol=1e-9)
    assert [own.stop - own.start for own in bench.rows] == [125, 125]


@pytest.mark.parametrize("name", COLUMNS)
def test_derivatives_are_those_of_central_differences(bench, name):
    step = 1e-5 * max(abs(bench.model.values[place(bench, name)]), 0.1)
    ahead, behind = bench.simulate(np.array([moved(bench, name, step), moved(bench, name, -step)]))
    y, J, _ = bench.linearise(bench.model.values, [place(bench, name)])
    expected = np.where(bench.counted, (ahead - behind) / (2 * step), 0.0)
    found = np.where(bench.counted, J[:, :, 0], 0.0)
    np.testing.assert_allclose(found, expected, rtol=1e-4, atol=2e-5 * np.max(np.abs(expected)))
    np.testing.assert_allclose(y, bench.simulate(bench.model.values[None])[0], rtol=1e-9, atol=1e-9)


def test_columns_come_in_the_order_they_were_asked_for(bench):
    columns = [place(bench, name) for name in ("D_r", "steering_delay", "mass_change")]
    J = bench.linearise(bench.model.values, columns)[1]
    for k, column in enumerate(columns):
        np.testing.assert_allclose(J[:, :, k], bench.linearise(bench.model.values, [column])[1][:, :, 0], atol=1e-9)
    assert bench.linearise(bench.model.values, [])[1].shape == (*bench.measured.shape, 0)


def test_derivatives_by_starts_are_those_of_starting_elsewhere(drive):
    model = build("single_track", None, {"steering_lag": 0.05}, CAR)
    S = Bench(model, [drive]).linearise(model.values, [])[2]
    names = [state.name for state in model.states if state.name in model.outputs]
    assert S.shape[2] == 2 * len(names)
    for k, name in enumerate(names):
        for run, first in enumerate((0, 125)):
            found = []
            for by in (1e-5, -1e-5):
                changed = np.array(drive[name])
                changed[first + np.argmax(np.isfinite(changed[first:]))] += by  # a late sensor reads nothing at first
                found.append(Bench(model, [drive.with_signals(**{name: changed})]).simulate(model.values[None])[0])
            expected = (found[0] - found[1]) / 2e-5
            np.testing.assert_allclose(S[:, :, run * len(names) + k], expected, atol=1e-5 * (1 + np.max(abs(expected))))


def test_a_run_s_first_moments_and_missing_readings_do_not_count(drive):
    a_y = np.array(drive["a_y"])
    a_y[50:60] = np.nan
    bench = Bench(build("single_track", None, {}, CAR), [without(drive, "v_y").with_signals(a_y=a_y)])
    c = bench.channels.index("a_y")
    assert not np.any(bench.counted[:, bench.channels.index("v_y")])
    assert not np.any(bench.counted[50:60, c])
    first = bench.time - np.where(np.arange(250) < 125, bench.time[0], bench.time[125]) < CAL.settling
    there = ~first
    there[50:60] = False
    np.testing.assert_array_equal(bench.counted[:, c], there)


def test_what_leaves_the_range_of_numbers_says_nothing_and_harms_no_other(bench):
    p = np.array([bench.model.values, moved(bench, "m", -1457.2 + 1e-9), bench.model.values])
    found = bench.simulate(p)
    np.testing.assert_array_equal(found[0], found[2])
    np.testing.assert_allclose(found[0], bench.simulate(p[:1])[0], rtol=1e-9, atol=1e-9)


def test_a_simulation_that_was_made_is_not_made_again(bench, monkeypatch):
    asked = counted(bench, monkeypatch)
    P = np.array([bench.model.values, moved(bench, "accel_bias_y", 0.05)])
    first = bench.simulate(P)
    assert asked == [4]  # two vectors, two runs
    y, _, _ = bench.linearise(P[0], [place(bench, "m")])
    again = bench.simulate(np.array([P[1], moved(bench, "accel_bias_y", 0.1), P[0], P[0]]))
    assert asked == [4, 2]
    np.testing.assert_array_equal(again[[2, 3, 0]], first[[0, 0, 1]])
    np.testing.assert_array_equal(y, first[0])


def test_what_was_asked_for_long_ago_is_forgotten(bench, monkeypatch):
    monkeypatch.setattr(
        "greybox_id.gap.estimation.bench.CAL", replace(CAL, remembered=0)
    )  # one call's lanes are kept anyway
    asked = counted(bench, monkeypatch)
    many = np.array([moved(bench, "accel_bias_y", 0.01 * k) for k in range(12)])
    found = bench.simulate(many)
    np.testing.assert_array_equal(bench.simulate(many[-8:]), found[-8:])
    assert sum(asked) == 2 * 12
    np.testing.assert_allclose(bench.simulate(many[:1]), found[:1], rtol=1e-12, atol=1e-12)
    assert sum(asked) == 2 * 13


def test_derivatives_that_grow_beyond_all_numbers_are_limited(bench, monkeypatch):
    """So they do where steps are unstable: tyres keep the motion finite, and nothing its derivatives."""
    plain = bench.simulator.kernel.linearise
    monkeypatch.setattr(bench.simulator.kernel, "linearise", lambda *given: [1e120 * item for item in plain(*given)])
    _, J, _ = bench.linearise(np.array(bench.model.values), [place(bench, name) for name in ("m", "D_r")])
    assert np.max(np.abs(J)) == CAL.far
