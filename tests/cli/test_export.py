"""`greybox export`: from a fit, a vehicle or options to files of a controller."""

import json
import re
import zipfile
from pathlib import Path

import numpy as np
import pytest
from calling import greybox, refused
from networks import FOLDER

from greybox_id.base.errors import BadInput
from greybox_id.datasets.read import read
from greybox_id.datasets.shipped import shipped
from greybox_id.export.verb import TARGETS
from greybox_id.fitting.how import FitOptions
from greybox_id.fitting.verb import fit as fit_model
from greybox_id.models.registry import build
from greybox_id.models.vehicle import vehicle


@pytest.fixture(scope="module")
def fit(tmp_path_factory):
    path = tmp_path_factory.mktemp("run") / "fit.json"
    assert greybox("import", FOLDER / "full.json", "--out", path).code == 0
    return path


def test_a_vehicle_that_names_no_model_is_a_single_track(tmp_path):
    called = greybox("export", "--vehicle", "full_size_car", "--target", "c", "--out", tmp_path / "Test car")
    assert called.code == 0
    assert (tmp_path / "Test car" / "test_car.h").is_file()
    assert "written" in called.out


def test_a_fit_is_exported_with_where_it_comes_from(fit, tmp_path):
    called = greybox("export", fit, "--target", "casadi", "--out", tmp_path / "net", "--json")
    assert called.told["model"] == "msnn_full"
    manifest = json.loads((tmp_path / "net" / "manifest.json").read_text(encoding="utf-8"))
    assert manifest["source"] == str(fit)
    assert manifest["command"].startswith("greybox export")
    assert set(manifest["files"]) | {"manifest.json"} == {file.name for file in (tmp_path / "net").iterdir()}
    assert all(
        {"unit", "value", "interval", "constant"} <= set(parameter) for parameter in manifest["parameters"].values()
    )


def test_effects_are_added_and_what_nobody_told_is_said(tmp_path):
    called = greybox("export", "--vehicle", "roboracer", "--with", "steering_lag", "--with", "steering_delay=30ms",
                     "--target", "c", "--out", tmp_path / "car")  # fmt: skip
    assert called.code == 0
    assert "The exported code has steering_lag =" in called.err
    assert "steering_delay is taken" not in called.err
    manifest = json.loads((tmp_path / "car" / "manifest.json").read_text(encoding="utf-8"))
    assert manifest["model"]["effects"]["steering_delay"] == 0.03
    assert "car_step_late" in (tmp_path / "car" / "car.h").read_text(encoding="utf-8")


@pytest.mark.parametrize(("asked", "count"), [("all", 25), ("free", 11), ("m,I_z", 2)])
def test_parameters_say_what_can_be_changed(tmp_path, asked, count):
    folder = tmp_path / "car"
    called = greybox(
        "export", "--vehicle", "full_size_car", "--target", "casadi", "--out", folder, "--parameters", asked
    )
    assert called.code == 0
    manifest = json.loads((folder / "manifest.json").read_text(encoding="utf-8"))
    moving = [name for name, own in manifest["parameters"].items() if not own["constant"]]
    assert sum(np.size(manifest["parameters"][name]["value"]) for name in moving) == count


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["--target", "c"], "FIT"),
        (["--vehicle", "full_size_car", "--target", "cc"], "target"),
        (["--vehicle", "full_size_car", "--target", "c", "--name", "int"], "--name"),
        (["--vehicle", "full_size_car", "--target", "c", "--name", "Ünder"], "--name"),
        (["--vehicle", "full_size_car", "--target", "c", "--parameters", "mm"], "no parameter"),
        (["--vehicle", "full_size_car", "--target", "c", "--with", "steering_dely"], "steering_delay"),
        (["--model", "hybrid_force", "--target", "c"], "hybrid"),
        (["missing.json", "--target", "c"], "missing.json"),
    ],
)
def test_what_cannot_be_exported_is_a_sentence_and_leaves_nothing(tmp_path, arguments, words):
    assert words in refused("export", *arguments, "--out", tmp_path / "car")
    assert not (tmp_path / "car").exists()


def test_a_users_file_in_the_folder_is_kept(tmp_path):
    folder = tmp_path / "car"
    export = ("export", "--vehicle", "full_size_car", "--target", "f1tenth", "--out", folder)
    assert greybox(*export).code == 0
    assert greybox(*export).code == 0
    (folder / "notes.txt").write_text("mine", encoding="utf-8")
    assert "notes.txt" in refused(*export)
    assert (folder / "notes.txt").read_text(encoding="utf-8") == "mine"


def test_every_target_is_in_the_help():
    told = greybox("export", "--help").out
    assert all(target in told for target in TARGETS)


def test_an_export_says_in_which_unit_the_drive_was_recorded(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    lap = read(shipped("racer_valid"), "roboracer").rows(0, 200)
    model = build("longitudinal", vehicle=vehicle("roboracer"))
    fit_model(model, [lap], how=FitOptions(solver="gauss-newton")).save("fit.json")
    greybox("export", "fit.json", "--target", "c", "--out", "car")
    header = Path("car/car.h").read_text()
    assert re.search(r"CAR_U_DRIVE +\d /\* A, motor_current \[A\] \*/", header), header
    greybox("export", "--vehicle", "roboracer", "--target", "c", "--out", "other")
    assert "as recorded, drive_force [N] or ax_cmd [m/s^2] or motor_current [A]" in Path("other/other.h").read_text()
    forces = lap.with_signals(drive_force=np.zeros(len(lap)))
    with pytest.raises(BadInput, match=r"signal for drive differs .*drive_force in .*motor_current in"):
        fit_model(model, [lap, forces], how=FitOptions(solver="gauss-newton"))


def test_every_key_of_a_parameter_file_is_told(tmp_path):
    asked = ("--vehicle", "full_size_car", "--with", "steering_lag=50ms", "--target", "autoware", "--json")
    told = greybox("export", *asked, "--out", tmp_path / "aw").told
    keys = {(key["file"], key["key"]): key for key in told["keys"]}
    assert keys["simulator_model.param.yaml", "steer_time_constant"]["from"] == "steering_lag"
    assert "default" in keys["simulator_model.param.yaml", "steer_time_delay"]
    manifest = json.loads((tmp_path / "aw" / "manifest.json").read_text())
    assert manifest["keys"] == told["keys"]


@pytest.mark.slow
def test_a_unit_may_be_named_by_itself(tmp_path):
    call = ("export", "--vehicle", "full_size_car", "--target", "fmu", "--out", tmp_path / "my car.fmu", "--json")
    assert greybox(*call).told["written"] == [str(tmp_path / "my car.fmu")]
    assert [path.name for path in tmp_path.iterdir()] == ["my car.fmu"]
    with zipfile.ZipFile(tmp_path / "my car.fmu") as held:
        assert 'modelName="my_car"' in held.read("modelDescription.xml").decode()
    assert greybox(*call).code == 0  # the same bytes
    another = (*call, "--with", "steering_delay=30ms")
    assert "--overwrite" in refused(*another)
    assert greybox(*another, "--overwrite").code == 0


@pytest.mark.parametrize(
    ("more", "said"),
    [
        (("--target", "mjcf", "--out", "car"), "no slip curve"),
        (("--target", "tir", "--out", "car.tir"), "a target writes a folder"),
        (("--target", "fmi", "--out", "car"), "Did you mean"),
    ],
)
def test_what_is_no_target_is_a_sentence(tmp_path, monkeypatch, more, said):
    monkeypatch.chdir(tmp_path)
    assert said in refused("export", "--vehicle", "full_size_car", *more)
    assert not list(tmp_path.iterdir())
