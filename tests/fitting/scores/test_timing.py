"""The delay of a run is told by its first seconds; what follows is predicted and scored with it."""

import numpy as np
import pytest
from calling import greybox, refused
from late_readings import NOISE, car, driven
from toys import drive

import greybox_id as gb
from greybox_id.base.errors import BadInput
from greybox_id.datasets.recording import join
from greybox_id.fitting.how import FitOptions, quiet
from greybox_id.fitting.memory import alignment
from greybox_id.fitting.scores.timing import (
    RunDelay,
    Timing,
    aligned_together,
    calibrated_errors,
    calibrated_predictions,
    calibrated_seconds,
    calibrated_timing,
)
from greybox_id.fitting.verb import fit
from greybox_id.models.registry import build, prepared

LATE = (0.03, -0.02, 0.0)


@pytest.fixture(scope="module")
def trained():
    return join([driven(car(), 700, 1 + k, late) for k, late in enumerate((0.02, -0.02, 0.0))], "trained")


@pytest.fixture(scope="module")
def new():
    return join([driven(car(), 300, 20 + k, late) for k, late in enumerate(LATE)], "new")


@pytest.fixture(scope="module")
def fitted(trained, new):
    how = FitOptions(strengths=1.0, solver="gauss-newton", calibrate="timing")
    return fit(prepared("msnn_bench_lat", trained), [trained], validate=new, how=how)


def test_training_runs_are_aligned_before_the_model_is_fitted(trained):
    found = alignment(prepared("msnn_bench_lat", trained), [trained], quiet)
    (delays,) = (own[("yaw_rate",)] for own in found.delays)
    late = np.array([own.delay for own in delays])
    np.testing.assert_allclose(late - late.mean(), [0.02, -0.02, 0.0], atol=0.004)


def test_what_follows_the_first_seconds_is_scored_with_the_delay_that_they_told(fitted, new):
    told = fitted.how["timing"]["validate"]
    for run, late in enumerate(LATE, 1):
        own = told["runs"][str(run)]["yaw_rate"]
        assert own["delay"] == pytest.approx(late, abs=4 * own["sd"])
        assert own["sd"] < 0.006
    calibrated = fitted.metrics["validate"]["timing calibrated on 5 s"]["yaw_rate"]
    assert calibrated["rmse"] < 1.1 * NOISE < fitted.metrics["validate"]["honest"]["yaw_rate"]["rmse"]
    assert calibrated["samples"] < len(new) - 3 * (100 + 20)


def test_calibrated_seconds_are_neither_scored_nor_predicted(fitted, new):
    timing = calibrated_timing(fitted, new, 8.0)
    found = calibrated_predictions(fitted.model, new, timing)
    for start, stop in new.runs:
        own = found.rows[(found.rows >= start) & (found.rows < stop)]
        assert own.min() >= start + 160
    assert calibrated_errors(fitted.model, new, timing)["yaw_rate"].samples == len(found.rows)


def test_readings_behind_the_calibrated_seconds_do_not_change_the_delay(fitted, new):
    first = calibrated_timing(fitted, new)
    yaw_rate = new["yaw_rate"].copy()
    yaw_rate[first.delays[("yaw_rate",)][0].stop : new.runs[0][1]] *= -1
    again = calibrated_timing(fitted, new.with_signals(yaw_rate=yaw_rate))
    assert again.of(("yaw_rate",)) == first.of(("yaw_rate",))


def test_in_closed_loop_each_command_moves_with_the_output_that_it_drives():
    model, recording = build("msnn_full"), drive(200)
    delays = {("yaw_rate",): 0.05, ("a_x",): 0.1}
    timing = Timing(5.0, {own: [_delay(value)] for own, value in delays.items()})
    moved = aligned_together(model, recording, timing)
    for name, rows in {"steer": 1, "motor_current": 2, "v_x": 2}.items():
        np.testing.assert_allclose(moved[name][rows + 1 :], recording[name][1:-rows], atol=1e-9)
    np.testing.assert_array_equal(moved["a_y"], recording["a_y"])


def _delay(value):
    return RunDelay(0, value, 0.01, 0)


@pytest.mark.parametrize(
    ("word", "seconds"), [("timing", 5.0), ("timing=8s", 8.0), ("timing = 2.5", 2.5), (None, None), ([], None)]
)
def test_the_seconds_may_be_stated(word, seconds):
    assert calibrated_seconds(word) == seconds


@pytest.mark.parametrize(
    "word", ["time", "timing=", "timing=0", "timing=-1s", "timing=nan", "timing=1e9", "timing=--1"]
)
def test_what_is_no_calibration_is_refused(word):
    with pytest.raises(BadInput, match="calibrate"):
        calibrated_seconds(word)


def test_models_without_memory_and_recordings_that_are_too_short_are_refused(fitted, new):
    with pytest.raises(BadInput, match="nothing of new is left"):
        calibrated_timing(fitted, new, 60.0)
    with pytest.raises(BadInput, match="for models with memory"):
        gb.fit("lateral", new, options=gb.FitOptions(calibrate="timing"))
    with pytest.raises(BadInput, match="a fit is needed"):
        gb.predict("kinematic", new, calibrate="timing")
    with pytest.raises(BadInput, match="a fit is needed"):
        gb.predict(fitted.model, new, calibrate="timing")
    with pytest.raises(BadInput, match="omit horizon"):
        gb.predict(fitted, new, 0.5, calibrate="timing")


def test_predictions_of_the_library_are_those_of_the_command(fitted, new, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    fitted.save("fit.json")
    new.to_pandas().to_csv("new.csv", index=False)
    told = greybox("predict", "fit.json", "new.csv", "--calibrate", "timing=6s", "--json").told
    assert told["timing"]["seconds"] == 6.0
    assert told["timing"]["runs"]["1"]["yaw_rate"]["delay"] == pytest.approx(0.03, abs=0.01)
    found = gb.predict(gb.load("fit.json"), "new.csv", calibrate="timing=6s")
    assert np.count_nonzero(np.isfinite(found["yaw_rate"])) == told["rows"]
    said = greybox("predict", "fit.json", "new.csv", "--calibrate", "timing").out
    assert "run 1: yaw_rate" in said
    assert "ms late, estimated from its first 5 s of motion" in said
    assert "--horizon" in refused("predict", "fit.json", "new.csv", "--calibrate", "timing", "--horizon", 1)
    assert "left" in refused("predict", "fit.json", "new.csv", "--calibrate", "timing=70s")
