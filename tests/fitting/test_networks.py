"""Training feed-forward networks: down to the noise, from a known vehicle where there is one, saved, exported."""

from dataclasses import replace

import casadi as cs
import numpy as np
import pytest
from calling import greybox, refused
from driven import driven, written
from windows_of import window_error

from greybox_id.base.errors import BadInput
from greybox_id.engine.hybrid.cell import Cell
from greybox_id.fitting.how import FitOptions, quiet
from greybox_id.fitting.hybrid import fit_network
from greybox_id.fitting.pretraining import Pretraining, faster, known_physics, taught
from greybox_id.fitting.saved_fit import load
from greybox_id.fitting.scores.metrics import simulate
from greybox_id.fitting.verb import fit
from greybox_id.models.registry import build, prepared

pytestmark = pytest.mark.usefixtures("_uncompiled")
QUICK = ("--set", "hidden=[6]", "--set", "window=11", "--set", "integrator=euler")


@pytest.fixture(scope="module")
def laps():
    return driven("lateral", runs=5, seconds=6.0)


@pytest.fixture(scope="module")
def vehicle():
    """The vehicle that drove, and others near it."""
    from greybox_id.models.vehicle import vehicle

    model = build("lateral", None, {}, vehicle("full_size_car"))
    rng = np.random.default_rng(0)
    spread = np.where([p.name in ("C_f", "I_z") for p in model.parameters], 0.02, 0.0)
    return Pretraining(model, model.values * (1 + spread * rng.standard_normal((20, model.size))), 2000)


def test_a_network_learns_the_motion_to_near_the_noise(laps):
    """Readings have noise of 0.02 m/s and 0.005 rad/s."""
    model = prepared("mlp_lateral", laps, {"hidden": [8], "integrator": "euler"})
    found = fit(model, [laps], validate=driven("lateral", seed=30), how=FitOptions(seed=1))
    errors = found.metrics["validate"]["free run"]
    assert errors["v_y"]["rmse"] < 0.03
    assert errors["yaw_rate"]["rmse"] < 0.01
    assert found.how["stopped_by"]
    assert found.verdict.reasons[0] == "Training stopped where the held-out error was smallest."
    assert set(found.stages[-1].noise) == {"v_y", "yaw_rate"}


def test_rates_taught_are_the_vehicle_s(laps, vehicle):
    vehicle = replace(vehicle, draws=vehicle.model.values[None])
    model = prepared("bicycle_mlp", laps, {"hidden": [4]})
    model = known_physics(model, vehicle)
    x, u, rates, scale = taught(model, [laps], vehicle, seed=0)
    own = np.array(Cell(model).rates(cs.DM(x), cs.DM(u), cs.DM(model.values)))  # weights of zero: the bicycle
    assert np.max(np.abs(own - rates) / np.std(rates, axis=1, keepdims=True)) < 0.005
    assert np.all(scale > 0)


def test_the_box_is_wider_than_the_recording(laps, vehicle):
    model = prepared("mlp_lateral", laps, {"hidden": [4]})
    inside = taught(model, [laps], vehicle, seed=0)[0]
    wide = taught(model, [laps], replace(vehicle, span="box"), seed=0)[0]
    assert np.all(np.max(np.abs(wide), axis=1) > 1.1 * np.max(np.abs(inside), axis=1))


def test_it_is_driven_faster_than_recorded_and_not_harder(laps, vehicle):
    """As the vehicle itself says, run freely from the same start along the same inputs."""
    model = prepared("mlp_lateral", laps, {"hidden": [4]})
    (driven_on,) = faster(model, [laps], replace(vehicle, draws=vehicle.model.values[None], beyond=1.5), seed=0)
    for start, stop in laps.runs:
        at_most = np.max(driven_on["v_x"][start:stop]) / np.max(laps["v_x"])
        assert 1.0 <= at_most <= 1.5
    hardest = np.max(np.abs(laps["v_x"] * laps["yaw_rate"]))
    taught_rows = np.isfinite(driven_on["yaw_rate"])
    assert np.mean(taught_rows) > 0.9
    assert np.max(np.abs((driven_on["v_x"] * driven_on["yaw_rate"])[taught_rows])) <= 1.3 * hardest
    inputs = driven_on.with_signals(v_y=laps["v_y"], yaw_rate=laps["yaw_rate"])
    known = simulate(vehicle.model, inputs)
    index = vehicle.model.outputs.index("yaw_rate")
    own = driven_on["yaw_rate"][known.rows]
    assert own[np.isfinite(own)] == pytest.approx(known.predicted[np.isfinite(own), index], abs=1e-9)


def test_what_it_teaches_of_higher_speeds_is_not_forgotten(laps, vehicle):
    """Held to the vehicle that drove, at speeds that no recording has."""
    known = replace(vehicle, draws=vehicle.model.values[None], span="box")
    model = prepared("mlp_lateral", laps, {"hidden": [8], "integrator": "euler", "window": 21})
    (fast,) = faster(model, [laps], replace(known, beyond=1.5), seed=9)
    noise, errors = np.array([0.02, 0.005]), []
    for beyond in (1.0, 1.5):
        found = fit_network(model, [laps], FitOptions(seed=1), quiet, replace(known, beyond=beyond)).model
        errors.append(window_error(found, fast, noise))
    assert errors[1] < 0.7 * errors[0]


def test_speeds_beyond_are_of_a_vehicle_that_is_driven_by_its_speed(laps, vehicle):
    model = prepared("mlp_lateral", laps, {"hidden": [4]})
    with pytest.raises(BadInput, match="does not have v_x and steer as its inputs"):
        faster(model, [laps], replace(vehicle, model=build("single_track"), beyond=1.5), seed=0)
    for beyond in (0.9, 4.0, float("nan")):
        with pytest.raises(BadInput, match="pretrain_beyond: a number from 1 to 3"):
            replace(vehicle, beyond=beyond)


def test_bands_of_several_seeds_open_where_nothing_was_trained(laps):
    """At speeds and yaw rates that were driven trainings agree; at twice as far from their middle they part."""
    model = prepared("mlp_lateral", laps, {"hidden": [6], "integrator": "euler", "window": 11})
    names = ("v_y", "yaw_rate", "v_x", "steer")
    driven_at = np.array([laps[name] for name in names])[:, ::7]
    middle, half = (np.quantile(driven_at, share, axis=1)[:, None] for share in (0.5, 0.99))
    places = {"inside": driven_at, "outside": middle + 2.5 * (half - middle) * np.sign(driven_at - middle)}
    told = {where: [] for where in places}
    for seed in range(4):
        trained = fit(model, [laps], how=FitOptions(seed=seed)).model
        for where, at in places.items():
            told[where].append(np.array(Cell(trained).rates(cs.DM(at[:2]), cs.DM(at[2:]), cs.DM(trained.values))))
    inside, outside = (np.median(np.std(told[where], axis=0), axis=1) for where in ("inside", "outside"))
    assert np.all(outside > 3 * inside)
    assert np.all(np.isfinite(told["outside"]))


def test_the_gap_of_a_network_that_nobody_trained_is_refused(laps, tmp_path):
    lap = written(laps, tmp_path / "laps.csv")
    for name in ("mlp_lateral", "bicycle_mlp"):
        said = refused("gap", lap, "--vehicle", "full_size_car", "--model", name, "--out", tmp_path / "gap")
        assert f"{name} is a hybrid model, and no vehicle file holds its weights. Fit it" in said
        assert "name equations of motion" in said


@pytest.mark.slow
def test_commands_pretrain_save_predict_and_export(laps, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    lap = written(laps, tmp_path / "laps.csv")
    plain = ("fit", "--model", "lateral", lap, "--vehicle", "full_size_car", "--set", "tyre=linear", "--fix", "m")
    assert greybox(*plain, "--solver", "gauss-newton", "--start-from", "measured", "--out", "plain").code == 0
    assert greybox("sample", "plain/fit.json", "--method", "laplace", "--draws", "50", "--out", "p.parquet").code == 0
    few = ("--pretrain-points", "500")
    for source in ("plain/fit.json", "p.parquet"):
        called = greybox("fit", "--model", "mlp_lateral", lap, *QUICK, "--pretrain", source, *few, "--out", "net")
        assert called.code in (0, 3), called.err
        assert load("net/fit.json", build).how["pretrained_from"] == source
    faster_too = ("--pretrain", "plain/fit.json", *few, "--pretrain-beyond")
    called = greybox("fit", "--model", "bicycle_mlp", lap, *QUICK, *faster_too, "1.3", "--out", "fast")
    assert called.code in (0, 3), called.err
    said = refused("fit", "--model", "bicycle_mlp", lap, *QUICK, *faster_too, "5", "--out", "other")
    assert "--pretrain-beyond" in said
    called = greybox("predict", "net/fit.json", lap, "--out", "predicted.csv", "--json")
    assert called.code == 0, called.err
    assert "integrator=rk4" in refused("export", "net/fit.json", "--target", "c", "--out", "car")
    said = refused("fit", "--model", "bicycle_mlp", lap, *QUICK, "--pretrain", "net/fit.json", "--out", "other")
    assert "a fit of equations of motion is needed" in said
    assert "Omit it" in refused(*plain, "--pretrain", "plain/fit.json", "--out", "again")


@pytest.mark.slow
def test_a_trained_network_is_exported_for_every_kind_of_tool(laps, tmp_path):
    lap = written(laps, tmp_path / "laps.csv")
    out = tmp_path / "net"
    settings = ("--set", "hidden=[6]", "--set", "window=11")
    assert greybox("fit", "--model", "mlp_lateral", lap, *settings, "--out", out).code in (0, 3)
    for target in ("c", "casadi", "onnx"):
        called = greybox("export", out / "fit.json", "--target", target, "--out", tmp_path / target, "--json")
        assert called.code in (0, 3), called.err
        assert called.told["written"]
