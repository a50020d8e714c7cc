"""`greybox data check` says what `check` finds, and its exit code tells whether to trust the file."""

import json
import shlex
from pathlib import Path

import h5py
import numpy as np
import pytest
from calling import greybox, refused
from click.testing import CliRunner

from greybox_id.cli.data import data


@pytest.fixture
def lap(tmp_path):
    def lap(yaw_rate_sign=1):
        time = np.arange(0, 40, 0.05)
        steer = 0.05 * np.sin(time) + 0.03 * np.sin(2.3 * time)
        yaw_rate = yaw_rate_sign * 10 * np.interp(time - 0.1, time, steer) / 2.6
        noise = np.random.default_rng(0).standard_normal((2, len(time)))
        rows = np.column_stack([time, 10 + 0.01 * noise[0], steer, yaw_rate + 0.001 * noise[1]])
        path = tmp_path / "lap[1].csv"
        np.savetxt(path, rows, delimiter=",", header="time,v_x,steer,yaw_rate", comments="", fmt="%.6f")
        return str(path)

    return lap


def test_a_sound_file_exits_with_0(lap):
    result = CliRunner().invoke(data, ["check", lap()])
    assert result.exit_code == 0
    assert "800 rows, 1 run, 40.0 s at 20 Hz" in result.output.replace("\n", "")


def test_a_distrusted_file_exits_with_1_and_says_why(lap):
    result = CliRunner().invoke(data, ["check", lap(-1)])
    assert result.exit_code == 1
    assert "distrust" in result.output
    assert "not to be trusted" in result.output


def test_the_command_that_leaves_rows_out_is_printed_and_does(lap):
    path = Path(lap())
    lines = path.read_text().splitlines()
    for row in range(200, 400):  # the gyro keeps a reading for 10 s
        lines[row] = f"{lines[row].rpartition(',')[0]},0.123456"
    path.write_text("\n".join(lines))
    shown = greybox("data", "check", path).out
    (command,) = (line for line in shown.split("\n") if line.startswith("rows left out: greybox "))
    again = greybox(*shlex.split(command.removeprefix("rows left out: greybox ")), "--json").told["files"][0]
    assert again["rows"] == 600
    assert "stuck" not in {finding["kind"] for finding in again["findings"]}


def test_the_command_that_repairs_the_map_is_printed_where_a_finding_has_a_repair(lap, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    path = Path(lap())
    table = np.loadtxt(path, delimiter=",", skiprows=1)
    header = "time,v_x,steer,yaw_rate,a_y"
    a_y = table[:, 1] * table[:, 3]
    turned = np.column_stack([table[:, :3], np.degrees(table[:, 3]), a_y])
    np.savetxt(path, turned, delimiter=",", header=header, comments="", fmt="%.6f")
    shown = greybox("data", "check", path).out
    (command,) = (line for line in shown.split("\n") if line.startswith("repair the map: greybox "))
    again = greybox(*shlex.split(command.removeprefix("repair the map: greybox "))).out
    assert "written  mended.toml: " in again
    assert "repair the map" not in again
    np.savetxt(path, np.column_stack([table, a_y]), delimiter=",", header=header, comments="", fmt="%.6f")
    assert "repair the map" not in greybox("data", "check", path).out


def test_json_is_one_object_on_standard_output(lap):
    result = CliRunner().invoke(data, ["check", lap(-1), "--json"])
    (file,) = json.loads(result.stdout)["files"]
    assert file["trusted"] is False
    assert (file["rows"], file["runs"]) == (800, 1)
    assert {"kind", "severity", "channel", "run", "rows", "sentence", "value", "unit"} <= set(file["findings"][0])
    assert result.exit_code == 1


def test_a_file_is_converted_to_a_kind_that_reads_back_the_same(lap, tmp_path):
    out = tmp_path / "lap.mat"
    told = greybox("data", "convert", lap(), "--out", out, "--json").told
    assert (told["rows"], told["signals"]) == (800, ["v_x", "yaw_rate", "steer"])
    before, after = (greybox("data", "check", file, "--json").told["files"][0] for file in (lap(), out))
    assert [f["kind"] for f in before["findings"]] == [f["kind"] for f in after["findings"]]
    assert (before["rows"], before["runs"]) == (after["rows"], after["runs"])


def test_a_file_is_never_converted_onto_itself(lap):
    assert "is read by this command" in refused("data", "convert", lap(), "--out", lap())


def test_what_resampling_costs_is_told(tmp_path):
    with h5py.File(tmp_path / "lap.h5", "w") as file:
        fast, slow = np.arange(1000) * 0.01, np.arange(51) * 0.2
        file["imu/time"], file["imu/rate"] = fast, 0.3 * np.sin(2 * fast)
        file["gps/time"], file["gps/speed"] = slow, 10 + np.sin(2 * slow)
    (tmp_path / "own.toml").write_text(
        '[time]\nunit="s"\n[signals.v_x]\ncolumn="gps/speed"\nunit="m/s"\n'
        '[signals.yaw_rate]\ncolumn="imu/rate"\nunit="rad/s"\n'
    )
    called = greybox("data", "check", tmp_path / "lap.h5", "--columns", tmp_path / "own.toml", "--json")
    (found,) = [f for f in called.told["files"][0]["findings"] if f["kind"] == "resampled"]
    assert (found["channel"], found["unit"]) == ("v_x", "m/s")
    assert found["value"] == pytest.approx(
        0.2**2 * 4 / np.sqrt(2) / np.sqrt(120), rel=0.1
    )  # rms of s (1 - s) / 2 h^2 f''
    assert "recorded at 5 Hz on the clock of gps and resampled" in found["sentence"]


def test_a_map_is_proposed_written_and_never_overwritten_unasked(lap, tmp_path):
    file, out = lap(), tmp_path / "car.toml"
    told = greybox("data", "map", file, "--out", out, "--json").told
    assert told["written"] == str(out)
    known = {"signal", "column", "unit", "units", "sign", "divide_by", "sign_column", "negative", "decided", "reasons",
             "missing"}  # fmt: skip
    assert set(told["signals"][0]) == known
    written = out.read_text()
    assert "already exists" in refused("data", "map", file, "--out", out)
    assert out.read_text() == written
    assert greybox("data", "map", file, "--out", out, "--overwrite").code == 0
    assert "?" in greybox("data", "map", file).out


def test_a_map_is_a_toml_file(lap, tmp_path):
    assert ".toml" in refused("data", "map", lap(), "--out", tmp_path / "car.json")


def test_a_part_is_checked_and_converted(lap, tmp_path):
    told = greybox(
        "data", "check", lap(), "--between", "10:30", "--where", "v_x > 0 and abs(steer) < 0.05", "--json"
    ).told
    (file,) = told["files"]
    assert 100 < file["rows"] < 401
    assert file["trusted"]
    out = tmp_path / "part.csv"
    assert greybox("data", "convert", lap(), "--between", ":9.99", "--out", out, "--json").told["rows"] == 200
    assert "names w, which is not recorded" in refused("data", "check", lap(), "--where", "w > 1")
    assert "is not START:STOP in seconds" in refused("data", "check", lap(), "--between", "nan:1")
    assert "ends before it starts" in refused("data", "check", lap(), "--between", "3:1")


def test_files_are_joined_and_never_onto_one_of_them(lap, tmp_path):
    first = lap()
    other = tmp_path / "imu.csv"
    time = np.arange(0, 40, 0.01)
    np.savetxt(other, np.column_stack([time, np.sin(time)]), delimiter=",", header="time,a_y", comments="")
    out = tmp_path / "joined.parquet"
    told = greybox("data", "join", first, other, "--out", out, "--json").told
    assert set(told["signals"]) == {"v_x", "yaw_rate", "steer", "a_y"}
    assert told["offsets"][0] == {
        "file": "imu", "against": "lap[1]", "signal": None, "offset_s": None, "sd_s": None, "rate": None,
        "left_s": None, "taken_off": False,
    }  # fmt: skip
    before = other.read_bytes()
    assert "would be overwritten" in refused("data", "join", first, other, "--out", other)
    assert other.read_bytes() == before
    assert "two files or more" in refused("data", "join", first, "--out", out)
