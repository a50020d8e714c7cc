"""`greybox fit`, `predict`, `simulate`, `validate` and `report` with hybrid models, as a user calls them."""

import pandas as pd
import pytest
from calling import greybox, refused
from linear_bicycle import manoeuvres

from greybox_id.fitting.saved_fit import load
from greybox_id.models.registry import build

SMALL = ("--set", "hidden=[3]", "--set", "window=40", "--set", "warm_up=10")
FIX = ("--fix", "I_z=700", "--fix", "m=930", "--fix", "l_f=1.175", "--fix", "l_r=1.171")


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    folder = tmp_path_factory.mktemp("runs")
    paths = []
    for k, one in enumerate(manoeuvres(48e3, 66e3)[:3]):
        paths.append(folder / f"run_{k}.csv")
        pd.DataFrame({"time": one.time, **one.signals}).to_csv(paths[-1], index=False)
    return paths


@pytest.fixture(scope="module")
def fitted(files, tmp_path_factory):
    out = tmp_path_factory.mktemp("fit")
    done = greybox(
        "fit", "--model", "hybrid_force", *files[:2], "--columns", "canonical", "--validate", files[2],
        *SMALL, *FIX, "--out", out,
    )  # fmt: skip
    assert done.code == 0, done.err
    return out / "fit.json", done


def test_a_fit_says_what_stopped_it_and_how_far_off_it_is(fitted):
    path, done = fitted
    assert path.exists()
    said = " ".join(done.out.split())
    assert "stopped by run_" in said
    assert "held out; RMS error over windows" in said
    assert "free run of whole manoeuvres" in said


def test_it_is_told_as_json(files, tmp_path):
    told = greybox(
        "fit", "--model", "hybrid_stiffness", *files[:2], "--columns", "canonical", *SMALL, *FIX,
        "--out", tmp_path, "--json",
    ).told  # fmt: skip
    assert set(told["metrics"]["train"]["free run"]) == {"a_y", "yaw_rate", "sideslip"}
    assert told["mode"] == "early stopping"


def test_it_predicts_simulates_and_is_validated(fitted, files, tmp_path):
    path, _ = fitted
    for verb in ("predict", "simulate"):
        target = tmp_path / f"{verb}.csv"
        done = greybox(verb, path, files[2], "--columns", "canonical", "--out", target)
        assert done.code == 0, done.err
        assert len(pd.read_csv(target)) == 300
    assert "free run" in greybox("validate", path, files[2], "--columns", "canonical").out


def test_it_stands_beside_equations_of_motion(fitted, files, tmp_path):
    path, _ = fitted
    done = greybox("fit", "--model", "lateral", "--set", "tyre=linear", "--vehicle", "simrod", *files[:2],
                   "--validate", files[2], "--out", tmp_path)  # fmt: skip
    assert done.code == 0, done.err
    target = tmp_path / "both.html"
    both = greybox("report", tmp_path / "fit.json", path, "--out", target, "--json")
    assert both.code == 0, both.err
    (sentence,) = both.told["verdict"]
    assert "its errors in free run compare with those of" in sentence
    assert "indistinguishable in yaw rate" in sentence  # three seconds are too few blocks
    said = target.read_text("utf-8")
    assert "hybrid_force" in said
    assert "yaw acceleration" not in said  # only one of them predicts it


def test_what_does_not_go_with_it_is_refused_in_a_sentence(fitted, files, tmp_path):
    path, _ = fitted
    model = ("fit", "--model", "hybrid_force", files[0], "--columns", "canonical", *SMALL)
    assert "cannot be used with hybrid_force" in refused(*model, "--horizon", "1")
    assert "omit --solver" in refused(*model, "--solver", "ipopt", "--out", tmp_path)
    assert "acts on" in refused(*model, "--with", "steering_delay=0.02")
    assert "runs freely" in refused("predict", path, files[2], "--columns", "canonical", "--horizon", "1")
    assert greybox("report", path, "--out", tmp_path / "report.pdf").code == 0
    assert (tmp_path / "report.pdf").read_bytes().startswith(b"%PDF")
    assert "stopped the training" in refused("profile", path, "m")
    assert "has a recurrent network" in refused("gap", files[2], "--columns", "canonical", "--fit", path)
    assert "Give it no start" in refused(
        "simulate", path, files[2], "--columns", "canonical", "--start-state", "v_y=1", "--out", tmp_path / "s.csv"
    )


def test_training_is_carried_on_from_a_fit(fitted, files, tmp_path, monkeypatch):
    monkeypatch.setattr("greybox_id.fitting.training.STEPS", 3)
    path, _ = fitted
    again = ("fit", "--model", "hybrid_force", *files, "--columns", "canonical", "--out", tmp_path / "again")
    done = greybox(*again, "--pretrain", path, "--json")
    assert done.code in (0, 3), done.err
    saved = load(tmp_path / "again" / "fit.json", build)
    assert saved.how["pretrained_from"] == str(path)
    assert "every fifth of 12 pieces of 70 rows" in saved.how["stopped_by"]
    assert saved.model.settings == load(path, build).model.settings
    assert "--starts" in refused(*again, "--pretrain", path, "--starts", "2")
    other = ("fit", "--model", "hybrid_stiffness", *files, "--columns", "canonical", "--out", tmp_path / "other")
    assert "a fit of hybrid_stiffness is needed" in refused(*other, "--pretrain", path)
    assert "holds 3 s of motion" in refused("adapt", path, files[0], "--columns", "canonical")
