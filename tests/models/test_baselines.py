"""G-NN, MS-NN-bench and the ablations, against the paper's equations written out."""

import numpy as np
import pytest
from independent import predict_rows, psi, weights_of
from toys import drive, scattered, without

from greybox_id.base.errors import BadInput
from greybox_id.fitting.scores.memory import predictions
from greybox_id.models.registry import build, prepared

ABLATION_1 = {"transient_over_a_x": False}
ABLATION_2 = {"transient_over_a_x": False, "steady_over_a_x": False}


@pytest.mark.parametrize(
    ("name", "settings", "size"),
    [
        ("gnn", {}, 528),
        ("msnn_bench_lat", {}, 41),
        ("msnn_bench_long", {}, 34),
        ("msnn_bench_long", {"slope": True}, 35),
        ("msnn_lat", ABLATION_1, 120),
        ("msnn_lat", ABLATION_2, 70),
        ("msnn_long", {"lateral_force": False}, 346),
    ],
)
def test_the_papers_hyperparameters_give_its_number_of_parameters(name, settings, size):
    assert build(name, settings).size == size


def compared(model, step, recording, memory):
    weights = weights_of(model)
    for k, output in enumerate(model.outputs):
        expected = predict_rows(
            lambda w, output=output: step(w, weights)[output],
            {n: recording[n] if n in recording else np.zeros(len(recording)) for n in model.inputs},
            memory, len(recording),
        )  # fmt: skip
        found = predictions(model, recording).predicted[:, k]
        np.testing.assert_allclose(found, expected, rtol=0, atol=1e-12 * max(1, np.max(np.abs(expected))))


@pytest.mark.parametrize("seed", range(2))
def test_the_network_without_structure_is_one_hidden_layer(seed):
    recording = drive(60, seed)
    model = scattered(prepared("gnn", recording, {"neurons": 3, "gamma": 4}), seed)

    def step(u, w):
        seen = w["W_v"] @ u["v_x"] + w["W_i"] @ u["motor_current"] + w["W_delta"] @ u["steer"]
        h = np.tanh(seen + w["b"])
        return {"yaw_rate": w["G_yaw"] @ h, "a_x": w["G_x"] @ h}

    compared(model, step, recording, 5)


@pytest.mark.parametrize("seed", range(2))
def test_the_lateral_benchmark_is_a_gain_on_local_responses_at_the_newest_speed(seed):
    recording = drive(60, seed)
    model = scattered(prepared("msnn_bench_lat", recording, {"q": 4}), seed)
    v_0 = model["F"].axes[0][1]

    def step(u, w):
        v = u["v_x"][-1]
        return {"yaw_rate": v / (1 + w["A"] * v**2) * sum(psi(v, v_0, n) * w["F"][n] @ u["steer"] for n in range(2))}

    compared(model, step, recording, 5)


@pytest.mark.parametrize("slope", [False, True])
def test_the_longitudinal_benchmark_is_linear_in_drag_and_both_branches_of_current(slope):
    recording = drive(60, 3)
    recording = recording.with_signals(road_slope=0.1 * np.sin(recording.time))
    model = scattered(build("msnn_bench_long", {"gamma": 3, "slope": slope}), 3)

    def step(u, w):
        i = np.asarray(u["motor_current"])
        a_x = w["w"] * u["v_x"][-1] ** 2 + w["b"] + w["b_t"] + w["b_b"]
        a_x += w["F_t"] @ np.maximum(i, 0) + w["F_b"] @ np.minimum(i, 0)
        return {"a_x": a_x + (w["G_6"] * np.sin(u["road_slope"][-1]) if slope else 0)}

    compared(model, step, recording, 4)


@pytest.mark.parametrize("settings", [ABLATION_1, ABLATION_2])
def test_ablations_of_the_lateral_network_are_its_equations_without_a_x(settings):
    recording = drive(60, 4)
    model = scattered(prepared("msnn_lat", recording, {"n_delta": 3, "q": 4, **settings}), 4)
    steer_0, v_0, a_0 = (model.settings[name] for name in ("steer", "v_x", "a_x"))
    steady = settings.get("steady_over_a_x", True)

    def step(u, w):
        total = 0.0
        for age in range(5):
            v, d = u["v_x"][age], u["steer"][age]
            curvature = 0.0
            for n, j, i in np.ndindex(*w["kappa_1"].shape):
                s = w["kappa_1"][n, j, i] + w["kappa_2"][n, j, i] * (d - steer_0[j])
                s += w["kappa_3"][n, j, i] * (v - v_0[n])
                if steady:
                    s += w["kappa_4"][n, j, i] * (u["a_x"][age] - a_0[i])
                    s *= psi(u["a_x"][age], a_0, i)
                curvature += s * psi(d, steer_0, j) * psi(v, v_0, n)
            total += v * curvature * sum(psi(v, v_0, n) * w["F"][n, age] for n in range(2))
        return {"yaw_rate": total}

    compared(model, step, recording, 5)


@pytest.mark.parametrize(
    ("name", "settings", "unread"),
    [("msnn_lat", ABLATION_2, ("a_x",)), ("msnn_long", {"lateral_force": False}, ("steer", "a_y"))],
)
def test_what_an_ablation_does_not_read_need_not_be_recorded(name, settings, unread):
    recording = drive(80)
    lacking = without(recording, *unread)
    model = prepared(name, lacking, settings)
    assert not set(unread) & set(model.inputs)
    assert np.array_equal(predictions(model, lacking).predicted, predictions(model, recording).predicted)


def test_without_the_lateral_force_the_longitudinal_network_is_the_one_whose_force_is_zero():
    recording = drive(80)
    whole = prepared("msnn_long", recording, {"gamma": 3, "eta": 2})
    whole = whole.with_parameters(whole["F_y"].with_value(np.zeros(whole["F_y"].shape)))
    ablated = prepared("msnn_long", recording, {"gamma": 3, "eta": 2, "lateral_force": False})
    np.testing.assert_allclose(
        predictions(ablated, recording).predicted, predictions(whole, recording).predicted, rtol=0, atol=1e-12
    )


def test_the_coupled_network_runs_on_parts_that_are_ablated():
    recording = drive(80)
    settings = {"lat": {"n_delta": 3, "q": 4, **ABLATION_2}, "long": {"gamma": 3, "eta": 2, "lateral_force": False}}
    model = prepared("msnn_full", recording, settings)
    assert not {"a_x", "a_y"} & set(model.inputs)
    assert model.feedback is None
    half = prepared("msnn_full", recording, {**settings, "long": {"gamma": 3, "eta": 2}})
    closed = predictions(half, recording, "closed_loop").predicted
    assert np.all(np.isfinite(closed))
    assert not np.array_equal(closed, predictions(half, recording).predicted)


def test_the_benchmarks_pole_stays_beyond_the_speeds_that_were_driven():
    recording = drive(200)
    model = prepared("msnn_bench_lat", recording)
    assert 1 + model["A"].bounds[0] * np.max(recording["v_x"]) ** 2 == pytest.approx(0.5)


@pytest.mark.parametrize(
    ("name", "settings"),
    [
        ("gnn", {"neurons": 0}),
        ("gnn", {"steer": 0.0}),
        ("msnn_bench_lat", {"q": -1}),
        ("msnn_bench_long", {"gamma": -1}),
    ],
)
def test_impossible_hyperparameters_are_refused_in_a_sentence(name, settings):
    with pytest.raises(BadInput):
        build(name, settings)
