"""Maps with memory under diagnosis: the bench simulates what the package predicts, and effects are found."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from memory_cases import NOISE, made
from toys import TINY, drive, joined, scattered, tiny, without

from greybox_id.api.closed_vehicle import closed_vehicle, fitted_vehicle
from greybox_id.errors import BadInput
from greybox_id.estimation.axes import candidates, shifting
from greybox_id.estimation.blocks import blocks
from greybox_id.estimation.colour import Colour
from greybox_id.estimation.hypothesis import Hypothesis
from greybox_id.estimation.memory_bench import MemoryBench, must_suit
from greybox_id.estimation.preparing import prepare
from greybox_id.estimation.variance import jitter, repeats
from greybox_id.fitting import How, fit
from greybox_id.gap.diagnosis import diagnose
from greybox_id.gap.plainly import plainly
from greybox_id.gap.selection import Selection
from greybox_id.models.effects import EFFECTS
from greybox_id.scores.horizons import by_horizon
from greybox_id.scores.memory import predictions
from greybox_id.vehicle import Stated, Vehicle

CARRIED = {name for name, effect in EFFECTS.items() if effect.apply_to_memory}
"""Effects that are known for maps with memory."""
FITTED = Vehicle("fit", noise=NOISE)
"""What training left."""


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
        np.testing.assert_array_equal(np.flatnonzero(bench.counted[rows, 0])[0], 4)
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
    assert not own["sensor_latency_imu"].starts
    assert own["steering_rate_limit"].starts
    assert own["steering_rate_limit"].axes[0].inverse
    stated = prepare(model, [drive(60)], EFFECTS, Vehicle("car", {"m": Stated(3.4, 0.1)}))
    assert [own.name for own in stated.nominal.parameters if not own.fixed] == ["m"]


@pytest.mark.parametrize(
    ("name", "effect", "value", "off"),
    [("msnn_lat", "steering_rate_limit", 0.8, 0.08), ("msnn_full", "sensor_latency_imu", 0.03, 0.006)],
)
def test_an_effect_is_found_and_closes_the_gap_on_another_recording(name, effect, value, off):
    model = tiny(name)
    one, other = (made(model, {effect: value}, seed) for seed in (0, 1))
    found = diagnose(model, [one], EFFECTS, vehicle=FITTED, held_out=[other])
    assert found.gap_detected
    assert found.applied == (effect,)
    assert found.ranking[0].effect == effect
    assert abs(found.ranking[0].magnitude - value) < off
    assert found.unknown_probability < 0.2
    assert found.held_out.closed > 0.8
    assert found.closed.effects == (effect,)
    horizons = {own.horizon for own in found.held_out.errors}
    assert horizons == ({None} if model.feedback is None else {None, 0.05})


def test_two_effects_are_found_together():
    model = tiny("msnn_lat")
    found = diagnose(
        model, [made(model, {"steering_rate_limit": 0.8, "sensor_latency_imu": 0.04})], EFFECTS, vehicle=FITTED
    )
    assert set(found.applied) == {"steering_rate_limit", "sensor_latency_imu"}


@pytest.mark.parametrize("seed", range(2))
def test_the_map_s_own_recording_alarms_nobody(seed):
    model = tiny("msnn_full")
    found = diagnose(model, [made(model, seed=seed)], EFFECTS, vehicle=FITTED)
    assert not found.gap_detected
    assert found.applied == ()
    assert found.p_value > 1e-3
    assert found.unknown_probability < 0.1


def test_what_no_effect_of_a_map_does_is_a_gap_without_a_name():
    model = tiny("msnn_lat")
    drives = made(model)
    swaying = drives["steer"] + 0.08 * np.sin(4.0 * drives.time)
    found = diagnose(model, [drives.with_signals(steer=swaying)], EFFECTS, vehicle=FITTED)
    assert found.gap_detected
    assert found.applied == ()
    assert found.unknown_probability > 0.9


def test_a_gap_is_what_exceeds_what_training_left():
    """Errors that last, such as training leaves, are no gap as long as they are no larger; nor is jitter looked for."""
    model = tiny("msnn_full")
    drives = made(model, noise=0.1)
    rng = np.random.default_rng(3)
    slow = [np.convolve(rng.standard_normal(len(drives) + 9), np.ones(10) / np.sqrt(10), "valid") for _ in range(2)]
    lasting = {name: drives[name] + NOISE[name] * own for name, own in zip(model.outputs, slow, strict=True)}
    found = diagnose(model, [drives.with_signals(**lasting)], EFFECTS, vehicle=FITTED)
    assert not found.gap_detected
    assert found.gap.before == pytest.approx(1.0, abs=0.25)
    assert {own.effect for own in found.ranking} <= CARRIED


def test_what_training_left_is_no_less_where_a_recording_has_less():
    model = tiny("msnn_full")
    found = diagnose(model, [made(model, noise=0.5)], EFFECTS, vehicle=FITTED)
    assert not found.gap_detected
    assert found.gap.before == pytest.approx(0.25, abs=0.05)


def test_scatter_of_readings_is_not_looked_for():
    _, bench = prepared_bench(tiny("msnn_full"), drive(60))
    bench.measured[10:50] = bench.measured[9]
    assert not np.any(repeats(bench))
    e = bench.simulate(bench.model.values[None])[0] - bench.measured
    assert jitter(bench, e, e + bench.measured, np.ones(2), bench.counted) is None


@pytest.mark.parametrize(("ar", "lasting"), [((), 1.0), ((0.5,), 3.0)])
def test_an_effect_gains_no_more_than_plain_errors_say(ar, lasting):
    rng, rows = np.random.default_rng(0), (slice(0, 300),)
    good = np.ones((300, 1), dtype=bool)
    sd = np.array([0.5])
    search = SimpleNamespace(colour=Colour(sd, (np.array(ar),), rows, good), trust=1.0)
    nothing = np.empty(0)

    def of(share, cost):
        e = share * np.sqrt(1000.0) * base
        return Hypothesis((), nothing, nothing, nothing, cost, e, np.zeros((300, 1, 0)))

    base = rng.standard_normal((300, 1))
    base /= np.sqrt(np.sum(base**2))
    tried = (of(1.1, 0.0), of(0.8, 1.0), of(0.99, 2.0), of(0.5, 99.0))
    found = plainly(Selection(search, of(1.0, 100.0), tried, ()), sd, good)
    costs = {round(float(np.sum(own.e**2)) / 1000.0, 4): own.cost for own in found.tried}
    assert [own.cost for own in found.tried] == sorted(own.cost for own in found.tried)
    assert costs[1.21] > 100.0  # whitened it gained, plainly it lost
    assert costs[0.64] == pytest.approx(max(1.0, 100.0 - 0.5 * 360.0 / 0.25 / lasting))
    assert costs[0.9801] == pytest.approx(100.0 - 0.5 * 19.9 / 0.25 / lasting)
    assert costs[0.25] == 99.0


def test_a_fit_s_training_errors_are_its_noise():
    drives = made(tiny("msnn_full"), rows=800)  # enough that its weights are near those that made it
    found = fit(tiny("msnn_full"), [drives], how=How(strengths=1.0, solver="gauss-newton"))
    stated = fitted_vehicle(found, "lap")
    for output in found.model.outputs:
        assert stated.noise[output] == found.metrics["train"]["closed_loop"][output]["rmse"]
    assert not stated.values
    assert stated.model.name == "msnn_full"
    assert fitted_vehicle(replace(found, metrics={}), "lap").noise == {}
    said = diagnose(found.model, [made(tiny("msnn_full"), seed=4)], EFFECTS, vehicle=stated)
    assert not said.gap_detected
    with pytest.raises(BadInput, match="no place for the weights of msnn_full"):
        closed_vehicle(stated, said)


def test_a_model_s_own_effect_may_differ():
    """The rate limit that MS-NN-full-plus has by its settings is a candidate at its own value."""
    model = tiny("msnn_full_plus")
    assert "steering_rate_limit" in model.effects
    slower = model.with_parameters(model["steering_rate_limit"].with_value(0.8))
    found = diagnose(model, [made(slower)], EFFECTS, vehicle=FITTED)
    assert found.applied == ("steering_rate_limit",)
    assert found.ranking[0].magnitude == pytest.approx(0.8, abs=0.1)
    assert float(found.closed["steering_rate_limit"].array) == pytest.approx(0.8, abs=0.1)


def test_errors_by_horizon_are_those_of_its_predictions():
    model, drives = tiny("msnn_full"), joined(60, 45)
    before = {(own.channel, own.horizon): own.before for own in by_horizon(model, model, [drives], np.ones(2))}
    for horizon, protocol in {None: "closed_loop", 0.05: "honest"}.items():
        found = predictions(model, drives, protocol)
        for k, channel in enumerate(model.outputs):
            rmse = np.sqrt(np.mean((found.predicted - found.measured)[:, k] ** 2))
            assert before[channel, horizon] == pytest.approx(rmse)


def test_a_recording_that_does_not_suit_is_refused():
    model = tiny("msnn_full")
    must_suit(model, [drive(60)])
    for recording in (without(drive(60), "motor_current"), drive(4), replace(drive(60), time=0.02 * np.arange(60))):
        with pytest.raises(BadInput):
            must_suit(model, [drive(60), recording])
        with pytest.raises(BadInput):
            diagnose(model, [recording], EFFECTS)


def test_an_input_that_is_fed_back_need_not_be_recorded():
    """Lateral acceleration follows from yaw rate and speed: regimes are told by what the map makes of it."""
    model = tiny("msnn_full")
    drives = made(model, {"sensor_latency_imu": 0.05})
    found = diagnose(model, [without(drives, "a_y")], EFFECTS, vehicle=FITTED, held_out=[without(drives, "a_y")])
    assert found.applied == ("sensor_latency_imu",)
    assert found.where.regimes["lateral"][0] > 0
