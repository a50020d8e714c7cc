"""MS-NN-lat against the paper's equations written out, and against the authors' own weights."""

import json

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from independent import lateral, predict_rows, weights_of
from toys import drive, scattered

from greybox_id.base.errors import BadInput
from greybox_id.datasets.read import read
from greybox_id.fitting.scores.memory import predictions
from greybox_id.fitting.scores.metrics import score
from greybox_id.models.msnn_lat import LateralSettings, covering_lat, msnn_lat


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize(("n_delta", "n_v", "n_x", "q"), [(5, 2, 2, 19), (3, 2, 2, 4), (4, 3, 1, 0), (1, 1, 3, 7)])
def test_predictions_are_those_of_the_paper_written_out(n_delta, n_v, n_x, q, seed):
    chosen = LateralSettings(n_delta=n_delta, n_v=n_v, n_x=n_x, q=q)
    drawn = scattered(msnn_lat(chosen), seed)
    covering = covering_lat(chosen, drive(60, seed + 10))
    model = msnn_lat(covering).with_values(drawn.values)
    recording = drive(60, seed)
    expected = predict_rows(
        lambda w: lateral(w, weights_of(model), covering.steer, covering.v_x, covering.a_x),
        {n: recording[n] for n in model.inputs}, q + 1, len(recording),
    )  # fmt: skip
    found = predictions(model, recording)
    assert np.array_equal(found.rows, np.arange(q + 1, 60))
    np.testing.assert_allclose(found.predicted[:, 0], expected, rtol=0, atol=1e-12 * max(1, np.max(np.abs(expected))))


def test_the_papers_hyperparameters_give_160_weights():
    assert msnn_lat().size == 160


@given(st.integers(1, 7), st.integers(1, 4), st.integers(1, 4), st.integers(0, 24))
@settings(max_examples=25)
def test_the_number_of_weights_is_equation_6(n_delta, n_v, n_x, q):
    model = msnn_lat(LateralSettings(n_delta=n_delta, n_v=n_v, n_x=n_x, q=q))
    assert model.size == 4 * n_delta * n_v * n_x + (q + 1) * n_v * n_x


@pytest.mark.parametrize(
    "wrong",
    [{"n_v": 0}, {"n_delta": 2, "steer": (0.0, 0.1, 0.2)}, {"n_delta": 2, "steer": (0.2, 0.1)}, {"q": -1}],
)
def test_impossible_hyperparameters_are_refused_in_a_sentence(wrong):
    with pytest.raises(BadInput):
        msnn_lat(LateralSettings(**wrong))


def test_a_recording_that_lacks_a_signal_cannot_set_the_centres():
    bare = drive(60)
    with pytest.raises(BadInput, match="lacks"):
        covering_lat(LateralSettings(), type(bare)("bare", bare.time, {"v_x": bare["v_x"]}))


def test_a_symmetric_model_has_centres_symmetric_in_steer_alone():
    chosen = covering_lat(LateralSettings(), drive(200), symmetric=True)
    np.testing.assert_allclose(chosen.steer, -np.array(chosen.steer)[::-1], atol=1e-15)
    assert chosen.v_x == (pytest.approx(np.min(drive(200)["v_x"])), pytest.approx(np.max(drive(200)["v_x"])))


@pytest.fixture
def authors(real_data):
    """The authors' trained network and their validation recording, with their sign of a_x."""
    net = json.loads((real_data / "roboracer" / "lateral_net.json").read_text(encoding="utf-8"))
    model = msnn_lat(LateralSettings(**{name: tuple(net["centres"][name]) for name in ("steer", "v_x", "a_x")}))
    stored = net["parameters"]
    kappa = {
        f"kappa_{q}": np.array(
            [[[np.squeeze(stored[f"k{q}_{l}_{j}_{p}"]) for p in range(2)] for j in range(5)] for l in range(2)]  # noqa: E741
        )
        for q in (1, 2, 3, 4)
    }
    F = np.array([np.ravel(stored[f"PFir{n}W"]) for n in (101, 103, 105, 107)]).reshape(2, 2, 20)
    values = {**kappa, "F": F}
    valid = read(real_data / "roboracer" / "valid.csv", "roboracer")
    return (
        model.with_parameters(*(p.with_value(values[p.name]) for p in model.parameters)),
        valid.with_signals(a_x=-valid["a_x"]),
    )


def test_the_authors_weights_give_their_published_error(authors):
    model, valid = authors
    assert score(model, valid)["published"]["yaw_rate"].rmse == pytest.approx(0.1088, abs=5e-4)


def test_the_authors_weights_give_their_pooled_error_across_joins(authors):
    found = predictions(*authors, "published")
    assert np.sqrt(np.mean((found.predicted - found.measured) ** 2)) == pytest.approx(0.1169, abs=5e-4)
    assert len(found.rows) == len(authors[1]) - 20


def test_the_honest_protocol_scores_no_window_across_a_join(authors):
    model, valid = authors
    honest = score(model, valid)["honest"]["yaw_rate"]
    assert honest.samples == sum(stop - start - 20 for start, stop in valid.runs)
