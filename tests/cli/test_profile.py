"""`greybox profile` follows the likelihood along parameters of a fit, on the recordings it was made with."""

import json

import numpy as np
import pandas as pd
import pytest
from calling import greybox, refused
from driven import driven, written

from greybox_id.api import profiles as command

pytestmark = pytest.mark.usefixtures("_uncompiled")


@pytest.fixture(scope="module")
def fitted(tmp_path_factory):
    """A fit of a small model to a recording beside it, which it also validates on another one."""
    folder = tmp_path_factory.mktemp("profiled")
    laps = [written(driven("lateral", seed=seed), folder / f"lap{seed}.csv") for seed in (0, 10)]
    called = greybox(
        "fit", "--model", "lateral", laps[0], "--vehicle", "full_size_car", "--set", "tyre=linear", "--fix", "m",
        "--per-run", "yaw_rate_bias", "--with", "yaw_rate_bias", "--horizon", "2", "--start-from", "measured",
        "--validate", laps[1], "--solver", "gauss-newton", "--out", folder,
    )  # fmt: skip
    assert called.code == 0, called.err
    return folder / "fit.json"


def test_a_profile_agrees_with_the_covariance_where_the_model_is_nearly_linear(fitted, tmp_path):
    out = tmp_path / "curve.csv"
    called = greybox("profile", fitted, "--parameter", "C_alpha_f", "--out", out, "--json")
    assert called.code == 0, called.err
    own = called.told["profiles"]["C_alpha_f"]
    assert own["unit"] == "N/rad"
    assert own["identifiable"]
    assert own["by_profile"] == pytest.approx(own["by_covariance"], rel=0.02)
    alone = own["noise_alone"]
    assert alone["by_profile"] == pytest.approx(alone["by_covariance"], rel=0.02)
    assert own["allowed_rise"] / alone["allowed_rise"] == pytest.approx((own["sd"] / alone["sd"]) ** 2)
    fit = json.loads(fitted.read_text())["parameters"]["C_alpha_f"]
    assert own["estimate"] == fit["value"]
    low, high = fit["interval"]  # half a row between commands, and what the form lacks, widen it
    assert own["by_covariance"] == pytest.approx([low, high], rel=1e-3)
    assert low < alone["by_covariance"][0] < alone["by_covariance"][1] < high
    curve = pd.read_csv(out)
    assert list(curve) == ["parameter", "value", "rise", "allowed", "allowed_noise_alone"]
    assert np.array_equal(curve["value"], own["values"])
    assert curve["rise"].min() == pytest.approx(0.0, abs=1e-6)


def test_a_person_sees_both_intervals_of_all_parameters(fitted):
    called = greybox("profile", fitted, "--all")
    assert called.code == 0, called.err
    words = " ".join(called.out.split())
    assert "parameter estimate 95 % by covariance 95 % by profile 95 % by profile, noise alone unit" in words
    assert all(name in words for name in ("I_z", "C_alpha_f", "C_alpha_r"))
    assert "yaw_rate_bias" not in words


def test_recordings_that_have_moved_are_named(fitted, tmp_path):
    moved = tmp_path / "elsewhere.csv"
    moved.write_bytes((fitted.parent / "lap0.csv").read_bytes())
    called = greybox("profile", fitted, moved, "--parameter", "I_z", "--json")
    assert called.code == 0, called.err
    another = fitted.parent / "lap10.csv"
    assert "none of the recordings given" in refused("profile", fitted, another, "--parameter", "I_z")


def test_an_interruption_keeps_the_profiles_that_are_done(fitted, monkeypatch):
    done = []
    original = command.profile_one

    def interrupted(*arguments, **more):
        if done:
            raise KeyboardInterrupt
        done.append(1)
        return original(*arguments, **more)

    monkeypatch.setattr(command, "profile_one", interrupted)
    called = greybox("profile", fitted, "--all", "--json")
    assert called.code == 0
    assert called.told["interrupted"]
    assert list(called.told["profiles"]) == ["I_z"]
    assert greybox("profile", fitted, "--all").code == 130


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        ([], "Name it with --parameter, or --all of them: I_z, C_alpha_f, C_alpha_r"),
        (["--parameter", "C_alfa_f"], "Did you mean C_alpha_f?"),
        (["--parameter", "m"], "m is fixed in this fit"),
        (["--parameter", "yaw_rate_bias"], "has a value for each run"),
        (["--parameter", "I_z", "--out", "curve.xlsx"], ".csv or .parquet"),
        (["missing.csv", "--parameter", "I_z"], "missing.csv"),
        (["a.csv", "b.csv", "--parameter", "I_z"], "was made with 1 recording to train"),
    ],
)
def test_wrong_use_is_a_sentence(arguments, says, fitted):
    assert says in refused("profile", fitted, *arguments)
