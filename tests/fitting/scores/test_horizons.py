"""Errors over horizons are told of predictions that stay with the vehicle; others diverge."""

import numpy as np
import pytest
from driven import driven
from gap_cases import CAR
from toys import joined, tiny

from greybox_id.engine.kernel import Kernel
from greybox_id.engine.motion.simulator import Predictor, Simulator
from greybox_id.fitting.scores.horizons import by_horizon, diverges, mean_squares
from greybox_id.fitting.scores.memory import predictions
from greybox_id.models.registry import build

pytestmark = pytest.mark.usefixtures("_uncompiled")


def test_errors_beyond_ten_times_the_range_of_the_readings_diverge():
    assert diverges(np.array([0.1, 21.0]), np.array([-1.0, 1.0]))
    assert not diverges(np.array([0.1, 19.0]), np.array([-1.0, 1.0]))
    assert not diverges(np.array([5.0]), np.array([1.0]))  # of one value nothing is a range
    assert not diverges(np.empty(0), np.empty(0))


def test_a_vehicle_that_spins_in_free_run_has_no_error_there():
    lap, sd = driven("lateral", runs=1, seconds=4.0), np.array([0.02, 0.005, 0.1])
    sound = build("lateral", {"tyre": "linear"}, {}, CAR)
    # at 18 m/s rear tyres this soft leave a yaw that grows a hundredfold each second
    loose = sound.with_parameters(sound["C_alpha_r"].with_value(2e4), sound["I_z"].with_value(200.0))
    found = {(own.channel, own.horizon): own for own in by_horizon(loose, sound, [lap], sd)}
    assert found["yaw_rate", None].before == np.inf
    assert 0 < found["yaw_rate", None].after < 1.0
    assert 0 < found["yaw_rate", 0.1].before < np.inf


def test_windows_that_overlap_less_predict_some_of_the_same_rows():
    lap, model = driven("lateral", runs=1, seconds=4.0), build("lateral", {"tyre": "linear"}, {}, CAR)
    predictor = Predictor(Simulator(model), lap, model.values)
    every, some = predictor.ahead(1.0), predictor.ahead(1.0, 5)
    assert 10 < len(some.rows) < len(every.rows) / 2
    at = np.searchsorted(every.rows, some.rows)
    np.testing.assert_array_equal(every.rows[at], some.rows)
    np.testing.assert_allclose(every.predicted[at], some.predicted, rtol=1e-9)


def test_errors_of_a_map_with_memory_are_those_of_its_predictions():
    model, drives = tiny("msnn_full"), joined(60, 45)
    before = {(own.channel, own.horizon): own.before for own in by_horizon(model, model, [drives], np.ones(2))}
    for horizon, protocol in {None: "closed_loop", 0.05: "honest"}.items():
        found = predictions(model, drives, protocol)
        for k, channel in enumerate(model.outputs):
            rmse = np.sqrt(np.mean((found.predicted - found.measured)[:, k] ** 2))
            assert before[channel, horizon] == pytest.approx(rmse)


@pytest.mark.parametrize(("rows", "asked"), [(100, 0), (700, 1)])
def test_equations_are_compiled_before_an_observer_steps_along_a_long_recording(monkeypatch, rows, asked):
    lap, model, seen = driven("lateral", runs=1, seconds=50.0), build("lateral", {"tyre": "linear"}, {}, CAR), []
    monkeypatch.setattr(Kernel, "prepare", lambda _: seen.append("prepared"))
    mean_squares(model, [lap.rows(0, rows)])
    assert len(seen) == asked
