"""`greybox design` writes a plan that `greybox simulate` drives; what it prints names both."""

import json

import pandas as pd
import pytest
from calling import greybox, refused

from greybox_lab.virtual.virtual_vehicle import drive, random_vehicle, vehicle_file_text


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A car and a fit of it."""
    folder = tmp_path_factory.mktemp("designed")
    car = random_vehicle(8001, "car")
    (folder / "car.toml").write_text(vehicle_file_text(car))
    lap, _ = drive(car, "mixed", 10.0, 50.0, seed=3)
    pd.DataFrame({"time": lap.time, **lap.signals}).to_csv(folder / "lap.csv", index=False)
    call = ["fit", "--model", "single_track", "--vehicle", folder / "car.toml", folder / "lap.csv", "--fix", "C_f"]
    called = greybox(*call, "--fix", "C_r", "--solver", "gauss-newton", "--out", folder / "run")
    assert called.code in (0, 3), called.err
    return folder


QUICK = ("--duration", "6", "--rate", "25", "--effort", "0.03", "--speed-max", "18")


@pytest.mark.slow
def test_a_plan_is_written_driven_and_written_again(folder):
    call = (
        "design",
        folder / "run" / "fit.json",
        "--goal",
        "precision",
        "--parameters",
        "I_z,B_f",
        "--arena",
        "disc:60",
    )
    called = greybox(*call, *QUICK, "--out", folder / "next", "--json")
    assert called.code == 0, called.err
    told = called.told
    before, after = told["predicted_sd"]["I_z"]
    assert after < before
    assert sorted(path.name for path in (folder / "next").iterdir()) == ["design.json", "plan.csv", "plan.svg"]
    saved = json.loads((folder / "next" / "design.json").read_text())
    assert saved["sentence"] == told["sentence"]
    assert (folder / "next" / "plan.svg").read_text().startswith("<svg")
    plan = pd.read_csv(folder / "next" / "plan.csv")
    assert {"time", "phase", "steer", "v_x", "x", "y", "yaw_rate", "x_low", "x_high", "v_x_low"} <= set(plan)
    assert not plan.isna().any(axis=None)

    out = folder / "driven.csv"
    model = ("--vehicle", folder / "car.toml", "--model", "single_track")
    driven = greybox("simulate", *model, folder / "next" / "plan.csv", "--out", out, "--json")
    assert driven.code == 0, driven.err
    assert driven.told["not_finite"] == 0
    assert driven.told["errors"]["yaw_rate"]["rmse"] < 0.1 * plan["yaw_rate"].abs().max() + 0.02
    of_fit = greybox("simulate", folder / "run" / "fit.json", folder / "next" / "plan.csv", "--out", out, "--json")
    assert of_fit.told["errors"]["yaw_rate"]["rmse"] < 0.01

    again = greybox(*call, *QUICK, "--out", folder / "next")
    assert again.code == 0, again.err
    words = " ".join(again.out.split())
    assert "straight ahead" in words
    assert "sd now" in words


def test_bad_input_is_a_sentence(folder, tmp_path):
    fit, lap = folder / "run" / "fit.json", folder / "lap.csv"
    assert "too small" in refused("design", fit, "--arena", "disc:2", "--out", tmp_path)
    assert "--arena" in refused("design", fit, "--arena", "moon", "--out", tmp_path)
    assert "lap.csv" in refused("design", lap, "--arena", "disc:40", "--out", tmp_path)
    assert "nothing.json" in refused("design", folder / "nothing.json", "--arena", "disc:40", "--out", tmp_path)
    assert "needs a gap" in refused("design", fit, "--goal", "detect", "--arena", "disc:40", "--out", tmp_path)
    assert "I_zz" in refused("design", fit, "--parameters", "I_zz", "--arena", "disc:40", "--out", tmp_path)
    assert "--grip" in refused("design", fit, "--grip", "nan", "--arena", "disc:40", "--out", tmp_path)
    file = tmp_path / "limits.toml"
    file.write_text("speed_min = 20\nspeed_max = 5\n")
    assert "contradict" in refused("design", fit, "--limits", file, "--arena", "disc:40", "--out", tmp_path)
    file.write_text("speed = ]")
    assert "TOML" in refused("design", fit, "--limits", file, "--arena", "disc:40", "--out", tmp_path)
    assert "already exists" in refused("design", fit, "--arena", "disc:40", "--out", _with_recording(tmp_path, lap))


def _with_recording(folder, lap):
    (folder / "plan.csv").write_bytes(lap.read_bytes())
    return folder
