"""Defaults from greybox.toml: taken, told, overruled by the command line, and refused in a sentence."""

import json
import shlex

import pytest
from calling import greybox, refused

from greybox_id.datasets.shipped import shipped

LAP = str(shipped("racer_valid"))


@pytest.fixture
def config(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.delenv("GREYBOX_CONFIG", raising=False)
    return lambda text: (tmp_path / "greybox.toml").write_text(text)


def test_defaults_are_taken_and_told(config):
    config('[data.check]\ncolumns = "roboracer"\njson = true\n[models]\nset = ["tyre=brush"]')
    called = greybox("data", "check", LAP)
    assert called.told["files"][0]["columns"] == "roboracer"
    assert called.err == "defaults from greybox.toml\n"
    called = greybox("models", "lateral", "--json")
    assert called.told["settings"] == {"tyre": "brush"}
    assert greybox("effects", "--json").err == ""


def test_jobs_and_seed_may_be_defaults(config, tmp_path):
    config('[fit]\njobs = 2\nseed = 5\nstarts = 2\ncolumns = "roboracer"\nsolver = "gauss-newton"')
    called = greybox("fit", "--model", "kinematic", "--vehicle", "roboracer", LAP, "--out", "run", "--json")
    assert called.code == 3  # a kinematic car is no racer near its limit
    assert called.told["seed"] == 5
    told = json.loads((tmp_path / "run" / "fit.json").read_text())["command"]
    assert "--starts 2 --jobs 2 --seed 5" in told


def test_the_command_line_counts(config):
    config('[models]\nset = "tyre=brush"')
    assert greybox("models", "lateral", "--set", "tyre=linear", "--json").told["settings"] == {"tyre": "linear"}


def test_another_file_is_named_by_the_environment(config, tmp_path, monkeypatch):
    (tmp_path / "mine.toml").write_text('[models]\nset = ["tyre=brush"]')
    monkeypatch.setenv("GREYBOX_CONFIG", "mine.toml")
    called = greybox("models", "lateral", "--json")
    assert called.told["settings"] == {"tyre": "brush"}
    assert called.err == "defaults from mine.toml\n"
    monkeypatch.setenv("GREYBOX_CONFIG", "mime.toml")
    assert "Did you mean mine.toml?" in refused("models")


def test_the_command_that_is_remembered_needs_no_file_of_defaults(config, tmp_path):
    config(
        '[export]\ntarget = "casadi"\nvehicle = "roboracer"\nmodel = "lateral"\nfix = ["m=3.5kg"]\nparameters = "all"'
    )
    greybox("export", "--out", "car one", "--name", "car")
    text = (tmp_path / "car one" / "manifest.json").read_text()
    (tmp_path / "greybox.toml").unlink()
    words = shlex.split(json.loads(text)["command"])
    assert words[-4:] == ["--out", "car one", "--name", "car"]
    assert greybox(*words[1:]).code == 0
    assert (tmp_path / "car one" / "manifest.json").read_text() == text


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("[modles]\n", "greybox.toml: there is no command 'modles'. Did you mean models?"),
        ("[models]\nste = 'a=1'", "greybox.toml: [models]: there is no option 'ste'. Did you mean set?"),
        ("[models]\nname = 'lateral'", "there is no option 'name'"),
        ("[data.chek]\n[models]", None),
        ("models = 3", "greybox.toml: [models] must be a table of options, not 3."),
        ("[models]\njson = 1", "greybox.toml: [models] json is true or false, not 1."),
        ("[models]\nvehicle = ['a', 'b']", "[models] vehicle takes one value, not the list"),
        ("[models]\nset = [true]", "[models] set is text or a number"),
        ("[models", "greybox.toml: not valid TOML"),
    ],
)
def test_a_slip_in_the_file_is_a_sentence(config, text, said):
    config(text)
    if said is None:  # of tables of other commands only the names are looked at
        assert greybox("models", "lateral").code == 0
    else:
        assert said in refused("models", "lateral")


def test_commands_in_groups_and_values_are_checked_too(config):
    config("[data.chek]\ncolumns = 'roboracer'")
    assert "[data]: there is no command 'chek'. Did you mean check?" in refused("data", "check", LAP)
    config("[gap]\nseed = -1")
    assert "greybox.toml: [gap] seed: -1 is not in the range x>=0." in refused("gap", LAP)


def test_code_to_run_is_not_taken_from_a_file(config, tmp_path):
    config('[exam.run]\ndiagnoser = "theirs:run"')
    assert "names code to run" in refused("exam", "run", tmp_path)
