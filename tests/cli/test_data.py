"""`greybox data check` says what `check` finds, and its exit code tells whether to trust the file."""

import json

import numpy as np
import pytest
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


def test_json_is_one_object_on_standard_output(lap):
    result = CliRunner().invoke(data, ["check", lap(-1), "--json"])
    (file,) = json.loads(result.stdout)["files"]
    assert file["trusted"] is False
    assert (file["rows"], file["runs"]) == (800, 1)
    assert {"kind", "severity", "channel", "run", "rows", "sentence", "value", "unit"} <= set(file["findings"][0])
    assert result.exit_code == 1
