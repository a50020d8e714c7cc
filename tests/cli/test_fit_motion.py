"""`greybox fit` of equations of motion, and what becomes of the fit: simulate, predict, validate."""

import json

import numpy as np
import pandas as pd
import pytest
from calling import greybox, refused
from driven import driven, without, written

from greybox_id.datasets.recording import Recording
from greybox_id.fitting.requested_model import doubts_of_drive
from greybox_id.fitting.saved_fit import load
from greybox_id.models.registry import build

HELD = ["--fix", "C_f", "--fix", "C_r", "--fix", "m"]
STIFF = 1.2
"""B_f of the car that was driven, over the vehicle file's."""


pytestmark = pytest.mark.usefixtures("_uncompiled")


@pytest.fixture(scope="module")
def laps(tmp_path_factory):
    """Two recordings of a car whose front tyres are stiffer, and whose steering is later, than stated."""
    folder = tmp_path_factory.mktemp("laps")
    lacking = {"effects": {"steering_delay": 0.06}, "values": {"B_f": 9.3 * STIFF}}
    return [written(driven("lateral", seed=s, **lacking), folder / f"lap{s}.csv") for s in (0, 10)]


@pytest.fixture(scope="module")
def fitted(laps, tmp_path_factory):
    """A fit, as a file, and what was printed as JSON."""
    out = tmp_path_factory.mktemp("fitted")
    called = greybox(
        "fit", "--model", "lateral", laps[0], "--vehicle", "full_size_car", "--with", "steering_delay", *HELD,
        "--validate", laps[1], "--prior", "I_z=2274±200 kg m^2", "--horizon", "2", "--start-from", "measured",
        "--starts", "2", "--out", out, "--json",
    )  # fmt: skip
    assert called.code == 0, called.err
    return out / "fit.json", called.told


def test_a_fit_finds_what_the_vehicle_file_has_wrong(fitted):
    _, told = fitted
    for name, truth in (("B_f", 9.3 * STIFF), ("steering_delay", 0.06)):
        own = told["parameters"][name]
        assert own["interval"][0] < truth < own["interval"][1]
        assert own["sd"] < (0.25 if name == "steering_delay" else 0.1) * truth  # rows of 50 ms: half a row is 14 ms


def test_json_is_one_object_with_what_a_fit_is(fitted):
    path, told = fitted
    assert told["written"] == str(path)
    assert told["vehicle"] == "full-size car"
    assert {name: told["how"][name] for name in ("horizon", "start_from", "robust")} == {
        "horizon": 2.0,
        "start_from": "measured",
        "robust": None,
    }
    assert set(told["how"]["counted"]) == {"v_y", "yaw_rate", "a_y"}
    assert told["free"] == ["I_z", "B_f", "D_f", "B_r", "D_r", "steering_delay"]
    assert told["parameters"]["m"]["fixed"]
    assert told["parameters"]["I_z"]["prior"]["sd"] == 200.0
    assert told["parameters"]["B_f"]["dof"] > 0
    assert {c["name"] for c in told["combinations"]} >= {"C_alpha_f", "l_f + l_r", "K_us"}
    correlation = np.array(told["correlation"]["matrix"])
    assert told["correlation"]["names"] == told["covariance"]["names"] == told["free"]
    assert np.diag(correlation) == pytest.approx(1.0)
    assert set(told["metrics"]) == {"train", "validate"}
    assert set(told["metrics"]["validate"]["0.5 s ahead"]["yaw_rate"]) == {"rmse", "rmse_sd", "fvu", "samples"}
    assert set(told["noise"]) == {"v_y", "yaw_rate", "a_y"}
    assert len(told["stages"][0]["starts"]) == 2
    assert told["warnings"] == []


def test_a_person_sees_data_fit_parameters_and_errors(laps, tmp_path):
    called = greybox(
        "fit", "--model", "lateral", laps[0], "--vehicle", "full_size_car", "--with", "steering_delay", *HELD,
        "--with", "yaw_rate_bias=0±1deg/s", "--per-run", "yaw_rate_bias", "--solver", "gauss-newton", "--out", tmp_path,
    )  # fmt: skip
    assert called.code == 0, called.err
    words = " ".join(called.out.split())
    assert "data lap0: 2 runs, 15.9 s at 25 Hz, 400 samples" in words
    assert "vehicle full-size car" in words
    assert "fit lateral, 7 free parameters, fitted to whole runs" in words
    assert "fixed m = 1457.2 kg, l_f = 1.296 m" in words
    assert "by run yaw_rate_bias:" in words
    assert "identifiable combination" in words
    assert "C_alpha_f" in words
    assert "N/rad cornering stiffness, front axle" in words
    assert "RMSE 0.1 s 0.5 s 1 s 2 s free run residual sd" in words
    assert "yaw_rate [rad/s]" in words
    assert str(tmp_path / "fit.json") in words
    told = load(tmp_path / "fit.json", build)
    assert told.per_run["yaw_rate_bias"].shape == (2,)
    assert told.model["yaw_rate_bias"].scope == "run"


def test_without_a_vehicle_a_fit_says_what_it_assumed(laps, tmp_path):
    called = greybox("fit", "--model", "kinematic", laps[0], "--solver", "gauss-newton", "--out", tmp_path, "--json")
    assert called.code == 3, called.err  # a wheelbase of 2.76 m is not that of the car
    (warning,) = called.told["warnings"]
    assert "kinematic starts from its default values (l_f + l_r = 2.76 m)" in warning
    assert warning in called.err


def test_a_fit_simulates(fitted, laps, tmp_path):
    path, _ = fitted
    out = tmp_path / "s.csv"
    called = greybox("simulate", path, laps[1], "--out", out, "--json")
    assert called.code == 0, called.err
    assert called.told["errors"]["yaw_rate"]["rmse"] < 0.01
    table = pd.read_csv(out)
    assert list(table) == [
        *("time", "run", "v_y", "v_y_simulated", "yaw_rate", "yaw_rate_simulated", "a_y", "a_y_simulated"),
    ]
    assert len(table) == called.told["rows"] == 400
    assert called.told["runs"] == 2


def test_a_fit_simulates_with_a_parameter_changed(fitted, laps, tmp_path):
    path, _ = fitted
    heavier = greybox("simulate", path, laps[1], "--out", tmp_path / "s.parquet", "--fix", "m=1.9t", "--json")
    as_fitted = greybox("simulate", path, laps[1], "--out", tmp_path / "t.parquet", "--json")
    assert heavier.told["errors"]["yaw_rate"]["rmse"] > 2 * as_fitted.told["errors"]["yaw_rate"]["rmse"]
    assert len(pd.read_parquet(tmp_path / "s.parquet")) == 400


def test_a_fit_predicts_so_many_seconds_ahead(fitted, laps, tmp_path):
    path, told = fitted
    called = greybox("predict", path, laps[1], "--horizon", "0.5", "--out", tmp_path / "p.csv", "--json")
    assert called.told["horizon"] == 0.5
    assert called.told["errors"] == told["metrics"]["validate"]["0.5 s ahead"]
    assert list(pd.read_csv(tmp_path / "p.csv"))[:4] == ["time", "run", "v_y", "v_y_predicted"]
    shown = greybox("predict", path, laps[1], "--out", tmp_path / "p.csv")
    assert "400 rows in 2 runs, free run" in shown.out


def test_a_fit_is_validated_on_several_recordings_beside_the_persistence(fitted, laps):
    path, told = fitted
    called = greybox("validate", path, *laps, "--json")
    assert set(called.told["metrics"]) == set(map(str, laps))
    assert called.told["metrics"][str(laps[1])] == told["metrics"]["validate"]
    held = called.told["persistence"][str(laps[1])]
    assert held["1 s ahead"]["yaw_rate"]["rmse"] > 3 * told["metrics"]["validate"]["1 s ahead"]["yaw_rate"]["rmse"]
    shown = greybox("validate", path, laps[1]).out
    assert "persistence" in shown
    assert "±" in shown
    assert "free run" in shown


def test_inputs_alone_are_simulated_with_a_model_made_from_options(tmp_path):
    bare = without(driven("single_track", runs=1), "v_x", "v_y", "yaw_rate", "a_x", "a_y")
    inputs = written(bare, tmp_path / "in.csv")
    asked = ["--model", "single_track", "--vehicle", "full_size_car", "--with", "steering_delay=30ms"]
    called = greybox("simulate", *asked, inputs, "--start-state", "v_x=65km/h", "--out", tmp_path / "s.csv", "--json")
    assert called.code == 0, called.err
    assert called.told["start"]["v_x"] == pytest.approx(18.0556, rel=1e-4)
    assert called.told["errors"] == {}
    assert pd.read_csv(tmp_path / "s.csv")["v_x_simulated"][0] == pytest.approx(18.0556, rel=1e-4)
    guessed = greybox("simulate", *asked, inputs, "--out", tmp_path / "s.csv")
    assert "does not hold v_x, so it starts at 0 m/s" in guessed.err


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (["--model", "laterl"], "Did you mean lateral?"),
        (["--model", "lateral", "--vehicle", "full_size_cart"], 'Did you mean full_size_car?'),
        (["--model", "lateral", "--vehicle", "missing.toml"], "missing.toml"),
        (["--vehicle", "full_size_car"], "names no model; add --model"),
        ([], "No model is named; add --model"),
        (["--model", "lateral", "--with", "stering_delay"], "Did you mean steering_delay?"),
        (["--model", "lateral", "--with", "steering_delay=3kg"], "--with steering_delay: unit"),
        (["--model", "lateral", "--with", "steering_delay=3"], "outside its bounds"),
        (["--model", "lateral", "--with", "motor_lag"], "motor_lag acts on drive"),
        (["--model", "lateral", "--fix", "mm=3kg"], "no parameter mm"),
        (["--model", "lateral", "--fix", "m=3.5m"], "whose SI unit is kg"),
        (["--model", "lateral", "--fix", "m=1g"], "outside the range that models accept"),
        (["--model", "lateral", "--free", "steering_lag"], "--with steering_lag"),
        (["--model", "lateral", "--noise", "v_x=0.1"], "has no output v_x"),
        (["--model", "lateral", "--set", "tyre=brsh"], "Did you mean brush?"),
        (["--model", "lateral", "--horizon", "60"], "longer than the longest unbroken run"),
        (["--model", "lateral", "--horizon", "-1"], "--horizon"),
        (["--model", "lateral", "--strength", "2"], "--strength is for models with memory"),
        (["--model", "msnn_lat", "--horizon", "1"], "--horizon is for equations of motion"),
        (["--model", "msnn_lat", "--with", "steering_rate_limit"], "--with steering_rate_limit=VALUE"),
        (["--model", "longitudinal"], "the signals suffice for lateral and kinematic"),
        (["--model", "lateral", "--columns", "roboracer"], "column"),
    ],
)  # fmt: skip
def test_wrong_use_is_a_sentence(arguments, says, laps, tmp_path):
    lap = tmp_path / "lap.csv"
    table = pd.read_csv(laps[0]).drop(columns="ax_cmd")
    table.to_csv(lap, index=False)
    assert says in refused("fit", lap, "--out", tmp_path / "out", *arguments)
    assert not (tmp_path / "out").exists()


def test_an_empty_file_and_one_without_rows_are_sentences(tmp_path):
    (tmp_path / "empty.csv").write_text("")
    (tmp_path / "headed.csv").write_text("time,steer,v_x,yaw_rate\n")
    for name in ("empty.csv", "headed.csv"):
        assert name in refused("fit", "--model", "lateral", tmp_path / name, "--out", tmp_path / "out")


def test_wrong_use_of_a_fit_is_a_sentence(fitted, laps, tmp_path):
    path, _ = fitted
    out = ["--out", tmp_path / "p.csv"]
    assert "longer than the longest" in refused("predict", path, laps[0], "--horizon", "60", *out)
    assert "is for models with memory" in refused("predict", path, laps[0], "--open-loop", *out)
    assert "Did you mean yaw_rate?" in refused("simulate", path, laps[0], "--start-state", "yawrate=1", *out)
    assert "whose SI unit is rad/s" in refused("simulate", path, laps[0], "--start-state", "yaw_rate=1m", *out)
    assert "no FIT" in refused("simulate", path, laps[0], "--model", "lateral", *out)
    assert "Name a FIT and a RECORDING" in refused("simulate", laps[0], *out)
    assert ".csv, .parquet, .mf4 or .mcap" in refused("simulate", path, laps[0], "--out", tmp_path / "p.xlsx")
    assert "is not a fit of greybox-id" in refused("validate", _json(tmp_path / "no.json"), laps[0])
    bare = written(without(driven("single_track", runs=1), "steer"), tmp_path / "bare.csv")
    assert "lacks steer, which lateral needs" in refused("validate", path, bare)


def _json(path):
    path.write_text(json.dumps({"format": "other"}))
    return path


def test_a_force_per_unit_that_belongs_to_another_drive_signal_is_doubted():
    recording = Recording("run", np.arange(4.0), {"drive_force": np.ones(4)})
    (doubt,) = doubts_of_drive(build("single_track"), [recording])
    assert "fix force_per_unit at 1," in doubt
    commanded = Recording("run", np.arange(4.0), {"ax_cmd": np.ones(4)})
    assert doubts_of_drive(build("single_track"), [commanded]) == []
