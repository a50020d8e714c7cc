"""Grids: every cell is fitted once, cross-validation is what leaving out would have been, one structure is chosen."""

import json
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from calling import greybox, refused
from toys import drive

from greybox_id.base.errors import BadInput
from greybox_id.engine.shooting import Problem
from greybox_id.engine.solvers.gauss_newton import gauss_newton
from greybox_id.engine.trace import Trace
from greybox_id.fitting.crossvalidation import FOLDS, WORST, blocks
from greybox_id.fitting.grid import cells, cross_validated, fit_grid, least_aic, one_standard_error, values_of
from greybox_id.models.registry import prepared


def test_values_are_lists_and_ranges():
    assert list(values_of("5,6,7")) == [5, 6, 7]
    assert list(values_of("1:4")) == [1, 2, 3, 4]
    assert list(values_of("false")) == [False]
    for wrong in ("1:x", "a", "4:1", "", "1:99999999"):
        with pytest.raises(BadInput, match="settings"):
            list(values_of(wrong))


def test_cells_are_all_combinations():
    assert cells({"a": [1, 2], "b": [3, 4]}) == [{"a": 1, "b": 3}, {"a": 1, "b": 4}, {"a": 2, "b": 3}, {"a": 2, "b": 4}]
    with pytest.raises(BadInput, match="1000000 structures"):
        cells({name: range(10) for name in "abcdef"})


def test_cross_validation_of_a_linear_model_is_that_of_fits_without_the_fold():
    recording = drive(900)
    model = prepared("msnn_bench_long", recording, {"gamma": 4})
    problem = Problem(Trace(model), [recording], noise=np.array([0.5]))
    x = gauss_newton(problem, problem.start).x
    error, spread = cross_validated(problem, x, np.array([1.0]))
    squares = []
    for kept, held_out in blocks(problem, FOLDS):
        own = gauss_newton(problem.counted(keep=kept), x, tolerance=1e-14)
        (run,), (rows,) = problem.runs, held_out
        off = (run.predict(own.x) - run.measured[run.predicted])[rows[run.predicted] > 0] / 0.5
        squares.append(np.mean(np.minimum(np.abs(off), WORST) ** 2))
    assert error == pytest.approx(np.sqrt(np.mean(squares)), rel=1e-6)
    assert spread > 0


def test_the_fewest_parameters_within_a_standard_error_are_chosen():
    table = pd.DataFrame({"parameters": [100, 40, 20], "cv_error": [0.10, 0.104, 0.12], "cv_se": [0.005, 0.001, 0.001]})
    assert one_standard_error(table)["parameters"] == 40


def test_a_grid_carries_on_where_it_was_stopped_and_says_the_same():
    train, valid = drive(500), drive(300, 1)
    varied = {"q": [3, 6], "n_v": [1, 2]}
    kept = []
    whole = fit_grid("msnn_bench_lat", train, varied, validate=valid, strength=1.0, keep=kept.append)
    assert [len(table) for table in kept] == [1, 2, 3, 4]
    assert whole.table["parameters"].tolist() == [5, 9, 8, 15]
    again = fit_grid("msnn_bench_lat", train, varied, validate=valid, strength=1.0, done=kept[1], keep=kept.append)
    assert len(kept) == 6  # two were there
    numbers = ["parameters", "cv_error", "aic", "aic_effective", "valid_honest_yaw_rate", "valid_published_yaw_rate"]
    pd.testing.assert_frame_equal(whole.table[numbers], again.table[numbers])
    assert again.chosen["q"] == whole.chosen["q"]
    with pytest.raises(BadInput, match="other data"):
        fit_grid("msnn_bench_lat", valid, varied, strength=1.0, done=kept[1])


def test_the_strength_of_priors_is_cross_validated_once():
    found = fit_grid("msnn_bench_lat", drive(900), {"q": [3, 5]})
    assert len(set(found.table["strengths"])) == 1
    assert set(json.loads(found.table["strengths"][0])) == {"transient"}


@pytest.mark.parametrize("name", ["msnn_full", "kinematic", "hybrid_force"])
def test_models_of_another_kind_are_refused(name):
    with pytest.raises(BadInput):
        fit_grid(name, drive(200), {"q": [3]})


def test_the_command_writes_a_table_continues_it_and_refuses_in_sentences(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    drive(500).to_pandas().drop(columns="run").to_csv("train.csv", index=False)
    call = ("grid", "msnn_bench_lat", "train.csv", "--set", "q=3,5", "--strength", 1)
    told = greybox(*call, "--json").told
    assert told["fits"] == len(told["table"]) == 2
    assert set(told) >= {"fits", "cpu_seconds", "chosen", "aic_best", "table"}
    assert len(pd.read_parquet("grid.parquet")) == 2
    again = greybox(*call, "--set", "n_v=2")
    assert "other settings" in again.err
    assert "2 of 3 structures were computed earlier" in greybox(*call[:4], "q=3,5,7", *call[5:]).err
    assert "several values" in refused("grid", "msnn_lat", "train.csv", "--set", "q=3")
    assert "nothing.csv" in refused("grid", "msnn_lat", "nothing.csv", "--set", "q=3,4")
    assert "no setting qq" in refused("grid", "msnn_lat", "train.csv", "--set", "qq=3,4", "--out", "other.parquet")


def test_what_speaks_against_the_recordings_is_told_first():
    recording = drive(600)
    found = fit_grid("msnn_bench_long", recording, {"gamma": [3, 4]}, strength=1.0, validate=recording)
    assert any("nothing was held out" in own for own in found.doubts)
    wrong = replace(recording, signals={**recording.signals, "v_x": recording["v_x"] * 1000})
    told = fit_grid("msnn_bench_long", wrong, {"gamma": [3, 4]}, strength=1.0)
    assert any("v_x" in own for own in told.doubts)
    assert told.as_dict()["doubts"] == list(told.doubts)


def test_errors_that_cannot_be_compared_choose_nothing():
    nothing = pd.DataFrame({"parameters": [3, 4], "cv_error": [0.0, 0.0], "cv_se": [np.nan] * 2, "aic": [np.nan] * 2})
    assert one_standard_error(nothing)["parameters"] == 3
    for broken, choose in ((nothing, least_aic), (nothing.assign(cv_error=np.inf), one_standard_error)):
        with pytest.raises(BadInput, match="does the vehicle move"):
            choose(broken)


@pytest.mark.parametrize(("wrong", "says"), [
    ({"strength": -1.0}, "above zero"), ({"strength": np.nan}, "above zero"), ({"strength": "a"}, "above zero"),
    ({"jobs": 0}, "from 1 on"),
])  # fmt: skip
def test_numbers_that_are_none_are_refused(wrong, says):
    with pytest.raises(BadInput, match=says):
        fit_grid("msnn_bench_long", drive(300), {"gamma": [3, 4]}, **({"strength": 1.0} | wrong))


def test_a_grid_is_counted_before_it_is_laid_out():
    with pytest.raises(BadInput, match="99980001 structures"):
        cells({"a": range(9999), "b": range(9999)})
    with pytest.raises(BadInput, match="0 structures"):
        cells({"a": []})


def test_a_range_that_is_too_long_says_so():
    with pytest.raises(BadInput, match="10000 values at most"):
        list(values_of("1:100000"))
