"""`greybox track`: files in, estimates, pictures and vehicle files out."""

import io
import json

import numpy as np
import pandas as pd
import pytest
from calling import greybox, refused
from linear_bicycle import recorded

from greybox_id.models.vehicle import vehicle

C_F, C_R, RATE = 60e3, 75e3, 50.0
VEHICLE = """name = "SimRod"
[parameters]
m = 930.0
I_z = { value = 700.0, sd = 70.0 }
l_f = 1.175
l_r = 1.171
C_alpha_f = 50e3
C_alpha_r = { value = 80e3, sd = 8e3 }
[model]
name = "lateral"
tyre = "linear"
"""
STATED = ["--noise", "noise_yaw_rate=0.01", "--noise", "noise_a_y=0.2", "--noise", "walk_v_y=0.05",
          "--noise", "walk_yaw_rate=0.02"]  # fmt: skip


@pytest.fixture(scope="module", autouse=True)
def _own_cache(tmp_path_factory):
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("GREYBOX_CACHE", str(tmp_path_factory.mktemp("libraries")))
        patch.delenv("GREYBOX_COMPILE", raising=False)
        yield


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    """A vehicle file and a lap."""
    folder = tmp_path_factory.mktemp("lap")
    time = np.arange(500) / RATE
    lap = recorded(0.03 * np.sin(2.5 * time) + 0.01 * np.sin(6 * time), 14.0, C_F, C_R, rate=RATE, seed=0)
    pd.DataFrame({"time": lap.time, **lap.signals}).to_csv(folder / "lap.csv", index=False)
    (folder / "car.toml").write_text(VEHICLE)
    return folder


def track(files, *more, out="estimates.csv"):
    called = greybox(
        "track", "--vehicle", files / "car.toml", files / "lap.csv", "--out", files / out, *STATED, "--tune", "0s",
        "--json", *more,
    )  # fmt: skip
    assert called.code == 0, called.err
    return called.told


def test_estimates_are_written_with_the_columns_that_are_documented(files):
    told = track(files)
    table = pd.read_csv(files / "estimates.csv")
    assert list(table)[:4] == ["time", "run", "sideslip", "sideslip_sd"]
    for name in ("sideslip", "yaw_rate", "C_alpha_f", "C_alpha_r", "F_yf", "F_yr", "alpha_f", "alpha_r"):
        assert {name, f"{name}_sd"} < set(table)
    assert len(table) == told["rows"] == 500
    assert np.all(np.isfinite(table.to_numpy()))
    assert np.abs(table["C_alpha_r"].iloc[-100:].median() / C_R - 1) < 0.1


def test_parquet_holds_the_same_as_csv(files):
    track(files)
    track(files, out="estimates.parquet")
    csv, parquet = pd.read_csv(files / "estimates.csv"), pd.read_parquet(files / "estimates.parquet")
    assert list(csv) == list(parquet)
    np.testing.assert_allclose(csv, parquet, rtol=1e-12)


def test_json_is_one_object_with_what_was_found(files):
    told = track(files, "--filter", "ukf", "--smooth")
    assert set(told) >= {
        "filter", "smoothed", "rows", "runs", "estimates", "noise", "innovations", "widened", "log_likelihood",
        "findings", "filter_seconds", "written",
    }  # fmt: skip
    assert (told["filter"], told["smoothed"], told["runs"]) == ("ukf", True, 1)
    assert told["noise"]["noise_a_y"] == 0.2
    assert set(told["innovations"]) == {"yaw_rate", "a_y"}
    assert set(told["innovations"]["a_y"]) == {
        "count", "nis", "inside", "correlation", "correlation_bound", "gated", "rms",
    }  # fmt: skip
    assert told["estimates"]["C_alpha_f"]["unit"] == "N/rad"
    assert 0 < told["estimates"]["C_alpha_f"]["identifiable_in"] <= 1
    assert told["written"] == [str(files / "estimates.csv"), str(files / "estimates.json")]


def test_people_read_tables_and_what_to_mind(files):
    called = greybox("track", "--vehicle", files / "car.toml", files / "lap.csv", "--out", files / "e.csv", *STATED,
                     "--tune", "0s")  # fmt: skip
    assert called.code == 0, called.err
    said = called.out
    assert "EKF: 500 rows in 1 run" in said
    assert "NIS" in said
    assert "No sideslip was measured" not in said, "the lap holds v_y"
    assert "checked sideslip has an RMSE" in " ".join(said.split())
    assert "of them are within two sd of the estimate; 95 % are expected" in " ".join(said.split())
    lap = pd.read_csv(files / "lap.csv").drop(columns="v_y")
    lap.to_csv(files / "without.csv", index=False)
    without = greybox("track", "--vehicle", files / "car.toml", files / "without.csv", "--out", files / "e.csv",
                      *STATED, "--tune", "0s")  # fmt: skip
    assert "No sideslip was measured" in " ".join(without.out.split())


def test_forces_take_the_place_of_tyres_where_they_are_named(files):
    told = track(files, "--parameters", "F_yf,F_yr")
    assert "identifiable_in" in told["estimates"]["F_yf"]
    assert "walk_F_yf" in told["noise"]


def test_pictures_are_written(files):
    told = track(files, "--figures", files / "pictures")
    names = {path.name for path in (files / "pictures").iterdir()}
    assert len([name for name in names if name.endswith(".svg")]) == 4
    assert {str(files / "pictures" / name) for name in names if name.endswith(".svg")} <= set(told["written"])


def test_what_is_left_beside_the_table_has_a_report(files):
    track(files, out="lap8.csv")
    called = greybox("report", files / "lap8.json", "--out", files / "lap8.html", "--json")
    assert called.code == 0, called.err
    assert (
        "Recording lap has 500 rows in 1 run. The median standard deviation of the estimates of an EKF with the model "
        "lateral" in called.told["verdict"][0]
    )
    assert "holds no measurement of an estimated quantity" not in called.told["verdict"][2]
    assert "track --vehicle" in (files / "lap8.html").read_text("utf-8")
    track(files, out="lap8.csv")


def test_another_file_beside_the_table_is_not_written_over(files):
    (files / "mine.json").write_text('{"mine": 1}')
    said = refused("track", "--vehicle", files / "car.toml", files / "lap.csv", "--out", files / "mine.csv")
    assert "mine.json already exists" in said
    assert (files / "mine.json").read_text() == '{"mine": 1}'
    said = refused("track", "--vehicle", files / "car.toml", files / "lap.csv", "--out", files / "new.csv",
                   "--apply", files / "new.json")  # fmt: skip
    assert "new.json is named by" in said


def test_a_vehicle_file_with_what_was_tuned_gives_the_same_estimates_again(files):
    made = files / "tuned.toml"
    first = greybox("track", "--vehicle", files / "car.toml", files / "lap.csv", "--out", files / "one.csv",
                    "--tune", "10s", "--calibrate", "10s", "--apply", made, "--json")  # fmt: skip
    assert first.code == 0, first.err
    plan = vehicle(made).tracking
    assert plan.parameters == ("C_alpha_f", "C_alpha_r")
    assert plan.noise == pytest.approx({n: s for n, s in first.told["noise"].items() if n != "noise_v_y"}, rel=5e-3)
    again = greybox("track", "--vehicle", made, files / "lap.csv", "--out", files / "two.csv", "--json")
    assert again.code == 0, again.err
    one, two = pd.read_csv(files / "one.csv"), pd.read_csv(files / "two.csv")
    for name in ("sideslip", "yaw_rate", "C_alpha_f", "C_alpha_r"):
        assert np.all(np.abs(one[name] - two[name]) < 0.1 * one[f"{name}_sd"])


def test_another_model_than_the_vehicle_s_own_is_the_one_that_is_written(files):
    """Its numbers were tuned, and its noise."""
    made = files / "other.toml"
    called = greybox("track", "--vehicle", files / "car.toml", "--model", "single_track", "--set", "tyre=linear",
                     files / "lap.csv", "--out", files / "other.csv", "--tune", "0s", "--apply", made)  # fmt: skip
    assert called.code == 0, called.err
    assert vehicle(made).model.name == "single_track"


def test_lines_are_followed_through_standard_input(files, monkeypatch):
    monkeypatch.setattr("sys.stdin", io.StringIO((files / "lap.csv").read_text()))
    called = greybox("track", "--vehicle", files / "car.toml", "--follow", *STATED)
    assert called.code == 0, called.err
    assert called.err.startswith("usable")
    live = pd.read_csv(io.StringIO(called.out))
    track(files)
    table = pd.read_csv(files / "estimates.csv")
    assert list(live)[-1] == "held_back"
    np.testing.assert_allclose(live["sideslip"], table["sideslip"], atol=1e-8)


@pytest.mark.parametrize(
    ("more", "said"),
    [
        (["--parameters", "C_alpha_g"], "Did you mean C_alpha_"),
        (["--readings", "yawrate,a_y"], "Did you mean yaw_rate"),
        (["--coloured", "ay"], "ay"),
        (["--noise", "walk_vy=1"], "There is no noise walk_vy. Did you mean walk_v_y"),
        (["--noise", "walk_v_y"], "NAME=SIZE"),
        (["--tune", "-3s"], "a duration is a number of seconds, zero or more"),
        (["--out", "estimates.txt"], ".mf4 or .mcap"),
        (["--filter", "pf"], "ekf"),
        (["--gate", "0"], "gate"),
        (["--model", "msnn_lat"], "a model with memory; filters track equations of motion"),
        (["--follow"], "--follow reads standard input"),
        (["--fit", "fit.json"], "omit one or the other"),
    ],
)
def test_what_cannot_be_done_is_a_sentence(files, more, said):
    target = files / "refused.csv"
    assert said in refused("track", "--vehicle", files / "car.toml", files / "lap.csv", "--out", target, *more)


@pytest.mark.parametrize("rows", [3, 99])
def test_a_recording_too_short_to_judge_a_filter_by_is_refused(files, rows):
    pd.read_csv(files / "lap.csv")[:rows].to_csv(files / "short.csv", index=False)
    said = refused("track", "--vehicle", files / "car.toml", files / "short.csv", "--out", files / "s.csv")
    assert f"short: the filter has {rows} rows ({rows / RATE:g} s) and needs 2 s" in said
    assert "longer recording" in said
    assert not (files / "s.csv").exists()


def test_a_recording_must_be_named(files):
    assert "RECORDING" in refused("track", "--vehicle", files / "car.toml")


def test_apply_needs_a_vehicle_file(files):
    called = greybox("track", "--model", "lateral", files / "lap.csv", "--out", files / "n.csv", "--tune", "0s",
                     "--apply", files / "n.toml")  # fmt: skip
    assert called.code == 2
    assert "--apply needs --vehicle" in " ".join(called.err.split())


def test_json_of_numbers_that_are_not_there_is_json_all_the_same(files):
    """A reading that is hardly taken has no NIS."""
    table = pd.read_csv(files / "lap.csv")
    table.loc[1:, "a_y"] = np.nan
    table.to_csv(files / "bare.csv", index=False)
    called = greybox("track", "--vehicle", files / "car.toml", files / "bare.csv", "--out", files / "b.csv", *STATED,
                     "--tune", "0s", "--json")  # fmt: skip
    assert called.code == 0, called.err

    def no(constant):
        raise AssertionError(f"{constant} is no JSON")

    json.loads(called.out, parse_constant=no)
