"""`greybox import`: from a file of nnodely's to a fit that the other commands take."""

import json

import pytest
from calling import greybox, refused
from networks import FOLDER, FOREIGN

from greybox_id.datasets.shipped import shipped


@pytest.fixture
def fit(tmp_path):
    path = tmp_path / "run" / "fit.json"
    assert greybox("import", FOLDER / "full.json", "--out", path).code == 0
    return path


def test_what_was_recognised_is_printed(tmp_path):
    told = " ".join(greybox("import", FOLDER / "full.json", "--out", tmp_path / "fit.json").out.split())
    assert "network full.json: msnn_full, 70 numbers" in told
    assert "motor_current [A] from crt" in told
    assert "yaw_rate [rad/s] from rate" in told
    assert "lat: windows of 6 samples of 0.05 s" in told
    assert "long: centres over a_y at −3.70, 6.60 m/s²" in told
    assert "2 neurons each for traction and braking" in told
    assert "there are no intervals" in told


def test_json_is_one_object(tmp_path):
    called = greybox(
        "import", FOLDER / "renamed.json", "--inputs", ", ".join(FOREIGN), "--out", tmp_path / "a.json", "--json"
    )
    told = called.told
    assert told["model"]["name"] == "msnn_lat"
    assert told["inputs"] == {"omega_rear": "v_x", "handwheel": "steer", "imu_long": "a_x"}
    assert told["uncertainty"] is None
    assert told["difference"] < 1e-12
    assert json.loads((tmp_path / "a.json").read_text(encoding="utf-8"))["command"].startswith("greybox import")


def test_the_fit_predicts_and_validates_like_any_other(fit, tmp_path):
    recording = shipped("racer_valid")
    columns = ("--columns", "roboracer", "--json")
    assert greybox("predict", fit, recording, *columns, "--out", tmp_path / "p.csv").told["loop"] == "closed"
    metrics = greybox("validate", fit, recording, *columns).told["metrics"][str(recording)]
    assert set(metrics) == {"honest", "published", "closed_loop"}


@pytest.mark.slow
def test_the_fit_is_diagnosed_like_any_other(fit):
    assert greybox("gap", "--fit", fit, shipped("racer_valid"), "--columns", "roboracer", "--json").code == 0


def test_a_report_of_a_fit_that_saw_no_recording_is_refused(fit):
    assert "was imported and has seen no recording" in refused("report", fit)


def test_a_fit_goes_to_a_folder_of_the_models_name(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert greybox("import", FOLDER / "lat_small.json").code == 0
    assert (tmp_path / "msnn_lat" / "fit.json").is_file()


def test_bad_input_is_a_sentence(tmp_path):
    assert "is not a file" in refused("import", tmp_path / "none.json")
    assert "do not show which signal is which" in refused(
        "import", FOLDER / "renamed.json", "--out", tmp_path / "a.json"
    )
    assert "a fit is a .json file" in refused("import", FOLDER / "lat_small.json", "--out", tmp_path / "a")
    assert "write SIGNAL=INPUT" in refused("import", FOLDER / "lat_small.json", "--inputs", "v_x")
    assert list(tmp_path.iterdir()) == []


def test_the_network_itself_is_never_written_over(tmp_path):
    own = tmp_path / "net.json"
    own.write_text((FOLDER / "lat_small.json").read_text(encoding="utf-8"), encoding="utf-8")
    assert "is read by this command" in refused("import", own, "--out", own)
    assert own.read_text(encoding="utf-8") == (FOLDER / "lat_small.json").read_text(encoding="utf-8")
