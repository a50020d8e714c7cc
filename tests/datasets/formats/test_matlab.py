"""MAT files as people have them: lying vectors, structs, timeseries saved as structs, version 4 to 7.3."""

import h5py
import numpy as np
import pytest
from scipy.io import savemat

from greybox_id.base.errors import BadInput
from greybox_id.datasets.column_map import parse_column_map
from greybox_id.datasets.read import read

N = 200
T = np.arange(N) * 0.01
MAP = parse_column_map(
    '[time]\ncolumn="log.t"\nunit="s"\n[signals.v_x]\ncolumn="log.speed"\nunit="km/h"\n'
    '[signals.a_x]\ncolumn="log.imu.acc.1"\nunit="m/s^2"\n[signals.a_y]\ncolumn="log.imu.acc.2"\nunit="m/s^2"',
    "own.toml",
)


@pytest.mark.parametrize("version", ["5", "4"])
@pytest.mark.parametrize("lying", [True, False])
def test_vectors_stand_or_lie(tmp_path, version, lying):
    shape = (1, -1) if lying else (-1, 1)
    held = {"time": T.reshape(shape), "v_x": (2 * T).reshape(shape)}
    savemat(tmp_path / "lap.mat", held, format=version)
    recording = read(tmp_path / "lap.mat")
    np.testing.assert_array_equal(recording.time, T)
    np.testing.assert_array_equal(recording["v_x"], 2 * T)


@pytest.mark.parametrize("lying", [True, False])
def test_structs_and_matrices_are_dotted_names(tmp_path, lying):
    acc = np.column_stack([3 * T, 4 * T])
    log = {"t": T, "speed": 36 * T, "imu": {"acc": acc.T if lying else acc}, "driver": "me", "gain": 3.0}
    savemat(tmp_path / "lap.mat", {"log": log})
    recording = read(tmp_path / "lap.mat", MAP)
    np.testing.assert_allclose(recording["v_x"], 10 * T)
    np.testing.assert_array_equal(recording["a_x"], 3 * T)
    np.testing.assert_array_equal(recording["a_y"], 4 * T)
    assert not recording.resampled


def test_version_7_3_is_read_the_right_way_round(tmp_path):
    with h5py.File(tmp_path / "lap.mat", "w", userblock_size=512) as file:
        file["log/t"] = T.reshape(1, -1)  # MATLAB's (n, 1)
        file["log/speed"] = (36 * T).reshape(-1, 1)
        file["log/imu/acc"] = np.vstack([3 * T, 4 * T])  # MATLAB's (n, 2)
        text = file.create_dataset("log/driver", data=np.array([[109], [101]], dtype=np.uint16))
        text.attrs["MATLAB_class"] = np.bytes_(b"char")
    with (tmp_path / "lap.mat").open("r+b") as file:
        file.write(b"MATLAB 7.3 MAT-file".ljust(124) + b"\x00\x02IM")
    recording = read(tmp_path / "lap.mat", MAP)
    np.testing.assert_allclose(recording["v_x"], 10 * T)
    np.testing.assert_array_equal(recording["a_y"], 4 * T)


def test_timeseries_saved_as_structs_each_have_their_own_time(tmp_path):
    slow = T[::10]
    savemat(
        tmp_path / "lap.mat",
        {"speed": {"Time": T, "Data": 1 + T}, "yaw": {"Time": slow, "Data": 0.1 * slow, "Name": "yaw"}},
    )
    mapping = parse_column_map(
        '[time]\nunit="s"\n[signals.v_x]\ncolumn="speed.Data"\nunit="m/s"\n'
        '[signals.yaw_rate]\ncolumn="yaw.Data"\nunit="rad/s"',
        "own.toml",
    )
    recording = read(tmp_path / "lap.mat", mapping)
    np.testing.assert_array_equal(recording["v_x"], 1 + recording.time)
    np.testing.assert_allclose(recording["yaw_rate"], 0.1 * recording.time, atol=1e-12)
    assert recording.resampled["yaw_rate"].clock == "yaw"
    assert recording.resampled["yaw_rate"].error == pytest.approx(0, abs=1e-12)  # it is straight


def test_a_column_without_a_time_beside_it_is_told(tmp_path):
    savemat(tmp_path / "lap.mat", {"t": T, "speed": T, "yaw": T[:50]})
    mapping = parse_column_map(
        '[time]\ncolumn="t"\nunit="s"\n[signals.v_x]\ncolumn="speed"\nunit="m/s"\n'
        '[signals.yaw_rate]\ncolumn="yaw"\nunit="rad/s"',
        "own.toml",
    )
    with pytest.raises(BadInput, match="yaw have no time column"):
        read(tmp_path / "lap.mat", mapping)
