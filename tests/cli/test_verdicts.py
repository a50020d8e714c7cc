"""The verdict as a user meets it: first on the screen, in the JSON, as exit code; and no word of a library."""

import json

import numpy as np
import pytest
from calling import greybox, refused
from driven import driven, written

import greybox_id as gb

FIT = ("--model", "lateral", "--vehicle", "full_size_car", "--fix", "m", "--fix", "C_f", "--fix", "C_r",
       "--horizon", "1", "--start-from", "measured")  # fmt: skip


pytestmark = pytest.mark.usefixtures("_uncompiled")


@pytest.fixture(scope="module")
def laps(tmp_path_factory):
    folder = tmp_path_factory.mktemp("laps")
    return [written(driven("lateral", runs=1, seed=s, noise=0.3), folder / f"lap{s}.csv") for s in (0, 3)]


@pytest.fixture(scope="module")
def nonsense(tmp_path_factory):
    """A gyro that is dead."""
    wrong = driven("lateral", runs=1, seconds=12.0)
    wrong = wrong.with_signals(yaw_rate=np.full(len(wrong), 0.3))
    return written(wrong, tmp_path_factory.mktemp("wrong") / "dead.csv")


def test_a_usable_fit_says_so_first_and_ends_with_0(laps, tmp_path):
    called = greybox("fit", laps[0], *FIT, "--validate", laps[1], "--out", tmp_path)
    assert called.code == 0, called.err
    assert called.out.split("\n")[0].split() == ["verdict", "usable"]
    again = greybox("validate", tmp_path / "fit.json", laps[1], "--json")
    assert again.code == 0
    assert again.told["verdict"] == "usable"
    assert set(again.told["comparison"][str(laps[1])]["1 s ahead"]["yaw_rate"]) == {
        *("rmse", "fit_percent", "fvu", "persistence", "unfitted")
    }


def test_data_that_it_was_fitted_to_are_not_held_out(laps, tmp_path):
    copied = tmp_path / "another_name.csv"
    copied.write_bytes(laps[0].read_bytes())
    said = "another_name is the data that the fit was made with (lap0): nothing was held out."
    called = greybox("fit", laps[0], *FIT, "--validate", copied, "--out", tmp_path, "--json")
    assert said in called.told["reasons"]
    assert called.told["verdict"] == "usable with care"
    part = greybox("validate", tmp_path / "fit.json", copied, "--between", "1:5", "--json")
    assert part.told["verdict"] == "usable with care"


@pytest.mark.slow
def test_what_is_not_usable_is_written_and_ends_with_3(nonsense, tmp_path):
    called = greybox("fit", nonsense, *FIT, "--out", tmp_path, "--json")
    assert called.code == 3
    assert called.told["verdict"] == "not usable"
    assert called.told["reasons"][0].startswith("Data check: yaw_rate is 0.3 rad/s in every row")
    assert json.loads((tmp_path / "fit.json").read_text())["verdict"] == "not usable"
    assert "CasADi" not in called.err
    assert "Warning" not in called.err
    assert greybox("validate", tmp_path / "fit.json", nonsense).code == 3
    exported = greybox("export", tmp_path / "fit.json", "--target", "casadi", "--out", tmp_path / "car")
    assert exported.code == 3
    warned = "are not usable either. Reason: Data check: yaw_rate is 0.3 rad/s in every row"
    assert warned in exported.err
    assert (tmp_path / "car" / "manifest.json").exists()
    for call in (
        ("predict", tmp_path / "fit.json", nonsense, "--out", tmp_path / "predicted.csv"),
        ("sample", tmp_path / "fit.json", "--method", "laplace", "--draws", "10", "--out", tmp_path / "p.parquet"),
        ("profile", tmp_path / "fit.json", "--parameter", "I_z"),
    ):
        assert warned in greybox(*call).err


def test_numbers_have_seven_digits_at_most(nonsense, tmp_path):
    shown = greybox("fit", nonsense, *FIT, "--out", tmp_path).out
    numbers = [word.strip("[],()").replace("−", "").replace(".", "") for word in shown.split()]
    assert max(len(number.lstrip("0")) for number in numbers if number.isdigit()) <= 7


def test_a_recording_in_which_time_does_not_run_is_a_sentence(laps, tmp_path):
    import pandas as pd

    pd.read_csv(laps[0])[:1].to_csv(tmp_path / "broken.csv", index=False)
    assert "Its time may be reversed" in refused("fit", tmp_path / "broken.csv", *FIT, "--out", tmp_path / "out")


def test_rows_whose_newest_comes_first_give_the_same_fit(laps, tmp_path):
    import pandas as pd

    pd.read_csv(laps[0])[::-1].to_csv(tmp_path / "reversed.csv", index=False)
    values = []
    for lap in (laps[0], tmp_path / "reversed.csv"):
        greybox("fit", lap, *FIT, "--out", tmp_path / lap.stem)
        fit = gb.load(tmp_path / lap.stem / "fit.json")
        values.append(dict(fit.params))
    assert values[1] == pytest.approx(values[0], rel=1e-6)


def test_a_fit_that_was_interrupted_or_is_not_confirmed_has_no_intervals(laps, tmp_path, monkeypatch):
    import greybox_id.fitting.motion as motion

    certified = motion.certified
    monkeypatch.setattr(motion, "certified", lambda *given: _doubted(*certified(*given)))
    called = greybox("fit", laps[0], *FIT, "--out", tmp_path, "--json")
    told = called.told
    assert told["verdict"] == "usable with care"
    assert any("not confirmed" in reason for reason in told["reasons"])
    assert told["covariance"] is None
    assert told["combinations"] == []
    for name in told["free"]:
        assert told["parameters"][name]["sd"] is None
        assert told["parameters"][name]["interval"] == [None, None]
        assert told["notes"][name] == "no interval: the optimum is not confirmed"
    assert told["stages"][0]["fallbacks"][0].startswith("other starting point 1: ")
    shown = greybox("fit", laps[0], *FIT, "--out", tmp_path)
    assert "95 % interval" in shown.out
    assert "tried    other starting point 1" in shown.out
    assert "±" not in shown.out.split("RMSE")[0].split("prior")[0]


def _doubted(solution, certificate):
    from dataclasses import replace

    return solution, replace(certificate, confirmed=False)
