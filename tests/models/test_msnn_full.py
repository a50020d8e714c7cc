"""The coupled model and its extension."""

import numpy as np
import pytest
from independent import free_run_of_full, lateral, longitudinal, weights_of
from toys import drive, scattered, tiny

from greybox_id.base.errors import BadInput
from greybox_id.fitting.scores.memory import predictions
from greybox_id.models.msnn_full import (
    FullSettings,
    PlusSettings,
    covering_full,
    covering_plus,
    msnn_full,
    msnn_full_plus,
)
from greybox_id.models.msnn_lat import LateralSettings
from greybox_id.models.msnn_long import LongitudinalSettings


def test_the_authors_hyperparameters_give_544_parameters():
    assert msnn_full().size == 544


@pytest.mark.parametrize(("q", "gamma"), [(4, 3), (2, 6)])
def test_the_closed_loop_is_the_papers_equations_in_a_naive_loop(q, gamma):
    chosen = FullSettings(LateralSettings(n_delta=3, q=q), LongitudinalSettings(n_y=2, eta=2, gamma=gamma))
    recording = drive(70, 5)
    chosen = covering_full(chosen, drive(200, 6))
    model = scattered(msnn_full(chosen), 1)
    w = weights_of(model)
    memory = max(q, gamma) + 1
    expected = free_run_of_full(
        {"road_slope": np.zeros(70), **{n: recording[n] for n in ("v_x", "steer", "motor_current")}},
        (lambda x: lateral(x, w, chosen.lat.steer, chosen.lat.v_x, chosen.lat.a_x), q + 1),
        (lambda x: longitudinal(x, w, chosen.long.v_x, chosen.long.a_y), gamma + 1),
        memory, {"yaw_rate": recording["yaw_rate"], "a_x": recording["a_x"]},
    )  # fmt: skip
    found = predictions(model, recording, "closed_loop")
    np.testing.assert_allclose(found.predicted, expected[memory:], rtol=1e-10, atol=1e-10)


def test_open_loop_the_full_model_is_its_two_parts_side_by_side():
    model = scattered(tiny("msnn_full"), 3)
    recording = drive(60, 1)
    whole = predictions(model, recording)
    for k, part in enumerate(model.parts):
        own = part.with_parameters(*(model[p.name] for p in part.parameters))
        alone = predictions(own, recording)
        same = np.isin(alone.rows, whole.rows)
        np.testing.assert_allclose(alone.predicted[same, 0], whole.predicted[:, k], atol=1e-12)


def test_parts_with_different_sample_times_are_refused():
    with pytest.raises(BadInput, match="needs the same sample time for both"):
        msnn_full(FullSettings(LateralSettings(sample_time=0.02), LongitudinalSettings()))


def test_additions_switched_off_leave_the_plain_model():
    plain = FullSettings(LateralSettings(n_delta=3, q=4), LongitudinalSettings(eta=2, gamma=3))
    off = PlusSettings(plain.lat, plain.long, symmetric=False, steering_rate_limit=None, timing_offset=False)
    recording = drive(60)
    plus = msnn_full_plus(off)
    full = msnn_full(plain)
    for protocol in ("honest", "closed_loop"):
        mine = predictions(plus.with_values(full.values), recording, protocol).predicted
        assert np.array_equal(mine, predictions(full, recording, protocol).predicted)


def test_additions_reach_the_parts_too():
    model = msnn_full_plus(PlusSettings(symmetric=True, timing_offset=True))
    lat, long = model.parts
    assert lat.symmetric
    assert long.symmetric
    assert [a.signal for a in lat.actuators] == [a.signal for a in long.actuators] == ["steer"]
    assert [s.signal for s in lat.sensors] == ["yaw_rate"]
    assert [s.signal for s in long.sensors] == ["a_x"]


def test_centres_cover_the_training_recording():
    recording = drive(300)
    chosen = covering_plus(PlusSettings(), recording)
    assert chosen.lat.v_x[0] == np.min(recording["v_x"])
    assert chosen.lat.v_x[-1] == np.max(recording["v_x"])
    assert chosen.long.a_y[-1] == pytest.approx(np.max(recording["a_y"]))
