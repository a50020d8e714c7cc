"""MS-NN-long against the paper's equations written out."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from independent import longitudinal, predict_rows, weights_of
from toys import drive, scattered

from greybox_id.base.errors import BadInput
from greybox_id.fitting.scores.memory import predictions
from greybox_id.models.msnn_long import LongitudinalSettings, covering_long, msnn_long


def sloped(rows, seed):
    recording = drive(rows, seed)
    return recording.with_signals(road_slope=0.1 * np.random.default_rng(seed).standard_normal(rows))


def written_out(model, chosen, recording):
    return predict_rows(
        lambda w: longitudinal(w, weights_of(model), chosen.v_x, chosen.a_y),
        {n: recording[n] for n in model.inputs}, chosen.gamma + 1, len(recording),
    )  # fmt: skip


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize(
    "hyper",
    [
        {},
        {"one_inertia": False},
        {"n_v": 1, "n_y": 1, "eta": 3, "gamma": 0},
        {"n_v": 3, "n_y": 2, "eta": 2, "gamma": 5},
    ],
)
def test_predictions_are_those_of_the_paper_written_out(hyper, seed):
    chosen = covering_long(LongitudinalSettings(**hyper), drive(60, seed + 10))
    model = scattered(msnn_long(chosen), seed)
    recording = sloped(60, seed)
    expected = written_out(model, chosen, recording)
    found = predictions(model, recording).predicted[:, 0]
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-12 * max(1, np.max(np.abs(expected))))


def test_a_recording_without_road_slope_is_taken_to_be_on_a_flat_road():
    recording = drive(40)
    flat = recording.with_signals(road_slope=np.zeros(40))
    model = scattered(msnn_long())
    assert np.array_equal(predictions(model, recording).predicted, predictions(model, flat).predicted)


def test_the_speed_window_adds_its_impulse_response():
    chosen = covering_long(LongitudinalSettings(speed_window=True, gamma=4), drive(60, 1))
    plain = covering_long(LongitudinalSettings(gamma=4), drive(60, 1))
    model = scattered(msnn_long(chosen), 2)
    weights = weights_of(model)
    base = msnn_long(plain)
    base = base.with_parameters(*(p.with_value(weights[p.name]) for p in base.parameters))
    recording = sloped(50, 3)
    more = predictions(model, recording).predicted - predictions(base, recording).predicted
    expected = [weights["F_v"] @ recording["v_x"][k - 5 : k] for k in range(5, 50)]
    np.testing.assert_allclose(more[:, 0], expected, atol=1e-12)


def test_the_papers_hyperparameters_give_384_parameters_and_385_with_two_inertias():
    assert msnn_long().size == 384
    assert msnn_long(LongitudinalSettings(one_inertia=False)).size == 385


@given(st.integers(1, 4), st.integers(1, 4), st.integers(1, 12), st.integers(0, 24))
@settings(max_examples=25)
def test_the_number_of_parameters_is_equation_15(n_v, n_y, eta, gamma):
    model = msnn_long(LongitudinalSettings(n_v=n_v, n_y=n_y, eta=eta, gamma=gamma, one_inertia=False))
    assert model.size == 7 + 2 * ((gamma + 1) * eta + 2 * eta) + 2 * n_y + (gamma + 1) * n_v


@pytest.mark.parametrize("wrong", [{"n_y": 0}, {"gamma": -3}, {"n_v": 3, "v_x": (0.0, 1.0)}])
def test_impossible_hyperparameters_are_refused_in_a_sentence(wrong):
    with pytest.raises(BadInput):
        msnn_long(LongitudinalSettings(**wrong))
