"""The verbs simulate and predict on equations of motion, and what any model must beat."""

import numpy as np
import pytest
from driven import NOISE, commands, driven, without
from toys import tiny

from greybox_id.base.errors import BadInput
from greybox_id.datasets.recording import Recording, join
from greybox_id.fitting.scores.metrics import as_table, assumed, predict, score_with_persistence, simulate
from greybox_id.models.effects import EFFECTS
from greybox_id.models.registry import build
from greybox_id.models.vehicle import vehicle

CAR = vehicle("full_size_car")


@pytest.fixture(scope="module")
def car():
    return build("single_track", vehicle=CAR)


def test_inputs_alone_are_simulated_from_states_that_are_given(car):
    given = without(commands(), "v_x")
    found = simulate(car, given, {"v_x": 18.0, "yaw_rate": 0.1})
    assert found.predicted[0, :3] == pytest.approx([18.0, 0.1 * float(car["l_r"].array), 0.1])
    assert np.all(np.isnan(found.measured))
    assert np.all(np.isfinite(found.predicted))
    assert list(as_table(car, given, found, "simulated"))[:4] == ["time", "run", "v_x_simulated", "v_y_simulated"]


def test_what_is_given_counts_instead_of_readings_and_is_no_reading(car):
    biased = car + EFFECTS["yaw_rate_bias"].at(0.05)
    recording = driven("single_track", runs=1, noise=0.0)
    found = simulate(biased, recording, {"yaw_rate": 0.0})
    yaw_rate = biased.outputs.index("yaw_rate")
    assert found.predicted[0, yaw_rate] == pytest.approx(0.05)
    assert found.predicted[0, 0] == pytest.approx(recording["v_x"][0])


def test_a_simulation_from_given_states_is_as_fine_as_the_model_is_stiff(car):
    """Slow cars are stiff: nothing is read that would say so, and rows 0.2 s apart are far too coarse for them."""
    given = without(commands(dt=0.2), "v_x")
    coarse = simulate(car, given, {"v_x": 3.0}).predicted
    fine = simulate(car, _refined(given, 20), {"v_x": 3.0}).predicted[::20]
    assert np.max(np.abs(coarse[: len(fine)] - fine)) < 2e-3


def test_states_nobody_knows_are_named(car):
    (first, second) = assumed(car, without(commands(), "v_x"), {})
    assert "does not hold v_x, so it starts at 0 m/s" in first
    assert "state its start" in second
    assert assumed(car, driven("single_track", runs=1), {}) == []


def test_predictions_ahead_stand_at_the_row_they_are_of(car):
    recording = driven("single_track", noise=0.0)
    found = predict(car, recording, 0.4)
    assert found.predicted == pytest.approx(found.measured, abs=1e-6)
    assert set(found.run) == {0, 1}
    assert len(found.rows) == len(recording) - 2 * 10


def test_a_free_run_is_what_a_prediction_without_horizon_is(car):
    recording = driven("single_track")
    assert np.array_equal(predict(car, recording).predicted, simulate(car, recording).predicted)


@pytest.mark.parametrize(("horizon", "says"), [(9.0, "longer than the longest"), (0.01, "shorter than a sample")])
def test_a_horizon_that_does_not_suit_the_recording_is_a_sentence(car, horizon, says):
    with pytest.raises(BadInput, match=says):
        predict(car, driven("single_track"), horizon)


def test_a_horizon_longer_than_some_runs_predicts_the_others(car):
    recording = join([driven("single_track", runs=1, seconds=s, noise=0.0) for s in (1.0, 4.0)], "both")
    found = predict(car, recording, 2.0)
    assert set(found.run) == {1}
    assert found.predicted == pytest.approx(found.measured, abs=1e-6)


def test_models_with_memory_say_what_they_cannot():
    recording = driven("single_track")
    with pytest.raises(BadInput, match="use greybox predict"):
        simulate(tiny("msnn_lat"), recording)
    with pytest.raises(BadInput, match="omit horizon"):
        predict(tiny("msnn_lat"), recording, 0.5)
    with pytest.raises(BadInput, match="has no states"):
        simulate(tiny("msnn_full"), recording, {"v_x": 1.0})


def test_errors_of_the_true_model_are_the_noise_and_holding_is_worse():
    model = build("lateral", vehicle=CAR)
    own, held = score_with_persistence(model, driven("lateral", seconds=20.0))
    assert own["free run"]["yaw_rate"].rmse == pytest.approx(NOISE["yaw_rate"], rel=0.1)
    assert held["0.1 s ahead"]["yaw_rate"].rmse > own["0.1 s ahead"]["yaw_rate"].rmse
    assert held["1 s ahead"]["yaw_rate"].rmse > 5 * own["1 s ahead"]["yaw_rate"].rmse
    assert own["1 s ahead"]["a_y"].samples == held["1 s ahead"]["a_y"].samples


def test_holding_holds_the_reading_of_that_row():
    recording = driven("lateral", runs=1, noise=0.0)
    _, held = score_with_persistence(build("lateral", vehicle=CAR), recording, [0.4])
    r = recording["yaw_rate"]
    assert held["0.4 s ahead"]["yaw_rate"].rmse == pytest.approx(np.sqrt(np.mean((r[10:] - r[:-10]) ** 2)))
    assert held["free run"]["yaw_rate"].rmse == pytest.approx(np.sqrt(np.mean((r - r[0]) ** 2)))


def _refined(recording, parts):
    """The same commands, held, in rows so many times as dense."""
    time = np.arange((len(recording) - 1) * parts + 1) * recording.sample_time / parts
    held = {name: np.repeat(values, parts)[: len(time)] for name, values in recording.signals.items()}
    return Recording("fine", time, held)
