"""Maps with memory under diagnosis: the bench simulates what the package predicts."""

from dataclasses import replace

import numpy as np
import pytest
from memory_cases import CARRIED, FITTED
from toys import TINY, drive, joined, scattered, tiny, without

from greybox_id.base.errors import BadInput
from greybox_id.fitting.scores.memory import predictions
from greybox_id.gap.estimation.axes import candidates, shifting
from greybox_id.gap.estimation.memory_bench import MemoryBench, must_suit
from greybox_id.gap.estimation.noise import blocks
from greybox_id.gap.estimation.preparing import prepare
from greybox_id.models.effects import EFFECTS
from greybox_id.models.parameter import Stated
from greybox_id.models.vehicle import Vehicle


def index_of(model, name):
    sizes = np.cumsum([0] + [parameter.size for parameter in model.parameters])
    return int(sizes[[parameter.name for parameter in model.parameters].index(name)])


def prepared_bench(model, *recordings):
    prepared = prepare(model, recordings, EFFECTS, FITTED)
    return prepared, prepared.bench(recordings)


@pytest.mark.parametrize("name", TINY)
def test_simulations_are_the_package_s_free_run(name):
    model, recordings = scattered(tiny(name)), [joined(60, 45), drive(50, 9)]
    prepared, bench = prepared_bench(model, *recordings)
    assert isinstance(bench, MemoryBench)
    expected = [predictions(model, own, "closed_loop") for own in recordings]
    found = bench.simulate(bench.model.values[None])[0]
    np.testing.assert_allclose(found, np.vstack([own.predicted for own in expected]), rtol=1e-9, atol=1e-9)
    np.testing.assert_array_equal(bench.measured, np.vstack([own.measured for own in expected]))
    np.testing.assert_array_equal(
        bench.time, np.concatenate([r.time[own.rows] for r, own in zip(recordings, expected, strict=True)])
    )
    assert [own.stop - own.start for own in bench.rows] == [len(run.time) for run in bench.runs]
    assert bench.inputs.shape == (len(bench.measured), len(model.inputs))
    assert np.all(np.isfinite(bench.inputs))
    assert set(prepared.effects) == {own for own in CARRIED if own in model.effects or EFFECTS[own].concerns(model)}


@pytest.mark.parametrize("name", TINY)
def test_effects_do_on_a_bench_what_they_do_on_a_model(name):
    model, drives = scattered(tiny(name)), joined(60, 45)
    _, bench = prepared_bench(model, drives)
    p = bench.model.values.copy()
    changed = model
    for effect, value in {"steering_rate_limit": 0.8, "sensor_latency_imu": 0.07, "motor_gain": 0.8}.items():
        if effect not in model.effects and not EFFECTS[effect].concerns(model):
            continue
        p[index_of(bench.model, effect)] = value
        if effect in model.effects:
            changed = changed.with_parameters(changed[effect].with_value(value))
        else:
            changed = changed + EFFECTS[effect].at(value)
    both = bench.simulate(np.array([bench.model.values, p]))
    np.testing.assert_allclose(both[1], predictions(changed, drives, "closed_loop").predicted, rtol=1e-9, atol=1e-9)
    assert np.max(np.abs(both[1] - both[0])) > 1e-3


def test_derivatives_are_those_of_simulations():
    _, bench = prepared_bench(scattered(tiny("msnn_full")), joined(60, 45))
    p = bench.model.values.copy()
    for at in (0.0, 0.03):
        late, mass = (index_of(bench.model, name) for name in ("sensor_latency_imu", "m"))
        p[late] = at
        y, J, S = bench.linearise(p, [late, mass, index_of(bench.model, "steering_rate_limit")])
        np.testing.assert_array_equal(y, bench.simulate(p[None])[0])
        assert S.shape == (*y.shape, 0)
        for k, (column, step) in enumerate([(late, 3e-4), (mass, 2e-3)]):
            sides = np.array([p, p])
            sides[:, column] += [0.0 if at == 0.0 and column == late else -step, step]
            below, above = bench.simulate(sides)
            slope = (above - below) / (sides[1, column] - sides[0, column])
            np.testing.assert_allclose(J[:, :, k], slope, rtol=1e-5, atol=1e-6 * np.max(np.abs(slope)))
        assert not np.any(J[:, :, 2])  # a limit at infinity limits nothing


def test_nothing_asked_is_nothing_simulated():
    _, bench = prepared_bench(tiny("msnn_lat"), drive(60))
    assert bench.simulate(np.empty((0, bench.model.size))).shape == (0, *bench.measured.shape)
    assert bench.linearise(bench.model.values, [])[1].shape == (*bench.measured.shape, 0)


def test_the_first_moments_of_runs_do_not_count_and_blocks_stay_within_runs():
    _, bench = prepared_bench(tiny("msnn_lat"), joined(60, 45))
    for rows in bench.rows:
        np.testing.assert_array_equal(np.flatnonzero(bench.counted[rows, 0])[0], 10)  # 0.5 s
    for a, b in blocks(bench):
        assert b - a <= 40
        assert any(rows.start <= a < b <= rows.stop for rows in bench.rows)


def test_weights_are_held_and_no_instant_moves():
    model = tiny("msnn_full")
    for vehicle in (FITTED, None):
        prepared = prepare(model, [drive(60)], EFFECTS, vehicle)
        assert all(parameter.fixed for parameter in prepared.everything.parameters)
    assert shifting(prepared.everything) == frozenset()
    own = {each.effect: each for each in candidates(prepared.everything, prepared.effects, frozenset())}
    assert own["sensor_latency_imu"].gradual
    assert not own["steering_rate_limit"].gradual
    assert own["steering_rate_limit"].axes[0].inverse
    stated = prepare(model, [drive(60)], EFFECTS, Vehicle("car", {"m": Stated(3.4, 0.1)}))
    assert [own.name for own in stated.nominal.parameters if not own.fixed] == ["m"]


def test_a_recording_that_does_not_suit_is_refused():
    model = tiny("msnn_full")
    must_suit(model, [drive(60)])
    for recording in (without(drive(60), "motor_current"), drive(4), replace(drive(60), time=0.02 * np.arange(60))):
        with pytest.raises(BadInput):
            must_suit(model, [drive(60), recording])
