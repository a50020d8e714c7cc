"""Errors under every protocol, against examples written out."""

import json
from dataclasses import replace

import numpy as np
import pytest
from toys import DT, drive, joined, linear_toy, scattered, speed_toy, tiny, without

from greybox_id.datasets.read import read
from greybox_id.engine.simulation import Prediction
from greybox_id.fitting.scores.memory import BATCH, aic, errors, predictions
from greybox_id.fitting.scores.metrics import as_dict, score
from greybox_id.models.registry import build, prepared


def as_prediction(residual, measured=None):
    measured = np.linspace(-1, 1, len(residual)) if measured is None else measured
    rows = np.arange(len(residual))
    return Prediction(rows, (measured + residual)[:, None], measured[:, None], np.zeros(len(rows)))


def test_published_is_the_mean_of_batches_of_100_and_drops_the_last():
    residual = np.concatenate([np.full(100, 1.0), np.full(100, 3.0), np.full(50, 1000.0)])
    found = errors(linear_toy(), as_prediction(residual), "published")["yaw_rate"]
    assert found.rmse == pytest.approx((1.0 + 3.0) / 2)
    assert found.samples == 250


def test_honest_pools_all_samples():
    residual = np.concatenate([np.full(100, 1.0), np.full(100, 3.0), np.full(50, 5.0)])
    found = errors(linear_toy(), as_prediction(residual), "honest")["yaw_rate"]
    assert found.rmse == pytest.approx(np.sqrt((100 * 1 + 100 * 9 + 50 * 25) / 250))


def test_fvu_is_the_variance_of_the_error_over_that_of_the_measurement():
    rng = np.random.default_rng(0)
    measured, residual = 2 * rng.standard_normal(500), 0.5 + rng.standard_normal(500)
    for protocol in ("honest", "published"):
        found = errors(linear_toy(), as_prediction(residual, measured), protocol)["yaw_rate"]
        assert found.fvu == pytest.approx(np.var(residual) / np.var(measured))


def test_a_perfect_prediction_has_no_error():
    found = errors(linear_toy(), as_prediction(np.zeros(150)), "honest")["yaw_rate"]
    assert (found.rmse, found.rmse_sd, found.fvu) == (0.0, 0.0, 0.0)


@pytest.mark.parametrize("rho", [0.0, 0.8])
def test_the_standard_error_of_the_rmse_is_its_scatter_over_recordings(rho):
    rng, values, stated = np.random.default_rng(1), [], []
    for _ in range(200):
        residual = ar1(rng, 1000, rho)
        found = errors(linear_toy(), as_prediction(residual), "honest")["yaw_rate"]
        values.append(found.rmse)
        stated.append(found.rmse_sd)
    assert np.mean(stated) == pytest.approx(np.std(values), rel=0.2)


def ar1(rng, samples, rho):
    noise = rng.standard_normal(samples + 50)
    for k in range(1, len(noise)):
        noise[k] += rho * noise[k - 1]
    return noise[50:]


def test_predictions_name_their_rows_and_runs():
    found = predictions(tiny("msnn_lat"), joined(20, 30))
    assert found.rows.tolist() == [*range(5, 20), *range(25, 50)]
    assert found.run.tolist() == [0] * 15 + [1] * 25
    assert np.array_equal(found.measured[:, 0], joined(20, 30)["yaw_rate"][found.rows])


def test_published_windows_run_across_joins_and_honest_ones_do_not():
    recording = joined(20, 30)
    found = predictions(tiny("msnn_lat"), recording, "published")
    assert found.rows.tolist() == list(range(5, 50))
    assert score(tiny("msnn_lat"), recording)["honest"]["yaw_rate"].samples == 40


def test_only_a_model_with_a_loop_is_scored_in_closed_loop():
    assert set(score(tiny("msnn_lat"), drive())) == {"honest", "published"}
    assert set(score(tiny("msnn_full"), drive())) == {"honest", "published", "closed_loop"}


def test_closed_loop_and_open_loop_differ():
    model = scattered(tiny("msnn_full"))
    assert not np.allclose(*(predictions(model, drive(), p).predicted for p in ("honest", "closed_loop")))


def test_a_recording_without_a_fed_back_input_predicts_with_what_follows_from_the_outputs():
    model = scattered(tiny("msnn_full"))
    recording = drive()
    implied = recording.with_signals(a_y=recording["yaw_rate"] * recording["v_x"])
    for protocol in ("honest", "published", "closed_loop"):
        lacking = predictions(model, without(recording, "a_y"), protocol).predicted
        assert np.all(np.isfinite(lacking)), protocol
        np.testing.assert_allclose(lacking, predictions(model, implied, protocol).predicted, atol=1e-12)


def test_scores_as_plain_data_hold_numbers():
    plain = as_dict(score(speed_toy(), drive()))
    assert set(plain["honest"]["a_x"]) == {"rmse", "rmse_sd", "fvu", "samples"}
    assert plain["honest"]["a_x"]["samples"] == round(drive().duration / DT) + 1 - 2


def test_the_papers_fractions_of_variance_unexplained_are_the_validators_and_the_pooled_one():
    rng = np.random.default_rng(0)
    measured, residual = 2 + rng.standard_normal(250), 0.5 + 0.3 * rng.standard_normal(250)
    found = errors(linear_toy(), as_prediction(residual, measured), "published")["yaw_rate"]
    e, y = residual[:200], measured[:200]  # the last 50 are no full batch
    assert found.fvu_published == pytest.approx(0.5 * np.var(e) / np.var(y) + 0.5 * np.var(e) / np.var(y + e))
    assert found.fvu_pooled == pytest.approx(np.sum(residual**2) / np.sum((measured - measured.mean()) ** 2))
    assert np.isnan(errors(linear_toy(), as_prediction(residual, measured), "honest")["yaw_rate"].fvu_published)


def test_akaikes_criterion_is_that_of_normal_residuals():
    rng = np.random.default_rng(1)
    residual = 0.2 + 0.3 * rng.standard_normal(250)
    full, variance = residual[:200], np.var(residual[:200])
    density = -0.5 * np.log(2 * np.pi * variance) - full**2 / (2 * variance)
    assert aic(residual, 7) == pytest.approx(-2 * np.sum(density) + 2 * 7)
    counted = -2 * 50 * np.mean(-0.5 * np.log(2 * np.pi * np.var(residual)) - residual**2 / (2 * np.var(residual)))
    assert aic(residual, 7, effective=50) == pytest.approx(counted + 14)


def test_the_authors_weights_have_the_figures_that_their_validator_printed(real_data):
    """Golden row: Lateral_Dynamics_Ablation_1 of the authors' repository on valid.csv, all digits that are known."""
    saved = json.loads((real_data / "roboracer" / "lateral_net.json").read_text())
    model = prepared("msnn_lat", drive(60), {**saved["centres"], "curvature_gain": 3.0})
    weights = saved["parameters"]
    kappa = {q: np.array([weights[f"k{q}_{v}_{d}_{a}"][0][0] for v, d, a in np.ndindex(2, 5, 2)]) for q in range(1, 5)}
    fir = np.array([[weights[f"PFir10{1 + 4 * v + 2 * a}W"] for a in range(2)] for v in range(2)])[..., 0]
    model = model.with_values(np.concatenate([*kappa.values(), fir.ravel()]))
    valid = read(real_data / "roboracer" / "valid.csv", "roboracer")
    found = predictions(model, valid.with_signals(a_x=-valid["a_x"]), "published")  # it was fed -a_x
    error = errors(model, found, "published")["yaw_rate"]
    residual = found.predicted[:, 0] - found.measured[:, 0]
    assert error.rmse == pytest.approx(0.1088, abs=5e-5)
    assert np.sqrt(np.mean(residual**2)) == pytest.approx(0.1169, abs=5e-5)
    assert error.fvu_published == pytest.approx(0.0310, abs=5e-5)
    full, measured = residual[:1100], found.measured[:1100, 0]
    assert len(residual) - len(full) < 100
    assert np.var(full) / np.var(measured) == pytest.approx(0.0309, abs=5e-5)
    assert aic(residual, model.size) == pytest.approx(-1234.5, abs=0.05)


def lateral_benchmark(net):
    """The authors' weight A has a pole above the speeds driven, which the model's bounds forbid."""
    F = np.array([weights_of(net, name) for name in ("PFir7W", "PFir9W")])
    model = build("msnn_bench_lat", {"v_x": net["Functions"]["FFuzzify5"]["centers"]})
    free = replace(model["A"], bounds=(-1.0, 1.0)).with_value(weights_of(net, "FParamFun11A")[0])
    return model.with_parameters(free, model["F"].with_value(F))


def longitudinal_benchmark(net):
    named = {"w": "PLinear4W", "b": "PLinear4b", "F_t": "PFir10W", "b_t": "PFir10b", "F_b": "PFir13W", "b_b": "PFir13b"}
    model = build("msnn_bench_long")
    return model.with_parameters(
        *(model[own].with_value(weights_of(net, theirs).reshape(model[own].shape)) for own, theirs in named.items())
    )


def weights_of(net, name):
    return np.ravel(net["Parameters"][name]["values"])


@pytest.mark.parametrize(
    ("name", "made", "batch_mean", "pooled", "fvu", "variances", "akaike"),
    [
        ("Lateral_Dynamics_Benchmark", lateral_benchmark, 0.1604, 0.1668, 0.0653, 0.0614, -676.8),
        ("longitudinal_dynamics_Benchmark", longitudinal_benchmark, 0.6110, 0.7613, 0.467, 0.341, 2457.7),
    ],
)
def test_the_authors_benchmarks_have_the_figures_that_their_validator_printed(
    real_data, name, made, batch_mean, pooled, fvu, variances, akaike
):
    """Golden rows, where trained_models/ of the authors' repository lies beside the recordings."""
    file = real_data / "roboracer" / "trained_models" / name / "net.json"
    if not file.exists():
        pytest.skip(f"trained_models/{name}/net.json of the authors' repository is not there")
    model = made(json.loads(file.read_text()))
    found = predictions(model, read(real_data / "roboracer" / "valid.csv", "roboracer"), "published")
    residual, measured = found.predicted[:, 0] - found.measured[:, 0], found.measured[:, 0]
    error = errors(model, found, "published")[model.outputs[0]]
    full = len(residual) // BATCH * BATCH
    assert error.rmse == pytest.approx(batch_mean, abs=5e-5)
    assert np.sqrt(np.mean(residual**2)) == pytest.approx(pooled, abs=5e-5)
    assert error.fvu_published == pytest.approx(fvu, abs=5e-5 if fvu < 0.1 else 5e-4)
    share = np.var(residual[:full]) / np.var(measured[:full])
    assert share == pytest.approx(variances, abs=5e-5 if fvu < 0.1 else 5e-4)
    assert aic(residual, model.size) == pytest.approx(akaike, abs=0.05)
