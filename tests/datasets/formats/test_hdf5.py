"""HDF5: groups with their own time, compound types, whole-number clocks, and files that claim too much."""

import h5py
import numpy as np
import pytest

from greybox_id.base.errors import BadInput
from greybox_id.datasets.column_map import parse_column_map
from greybox_id.datasets.read import read

T = np.arange(100) * 0.02


def columns(time='column="time"', unit="s", **signals):
    lines = [f'[time]\n{time}\nunit="{unit}"']
    units = {"v_x": "m/s", "yaw_rate": "rad/s", "steer": "rad"}
    lines += [f'[signals.{name}]\ncolumn="{column}"\nunit="{units[name]}"' for name, column in signals.items()]
    return parse_column_map("\n".join(lines), "own.toml")


def test_datasets_are_columns_by_path(tmp_path):
    with h5py.File(tmp_path / "lap.h5", "w") as file:
        file["car/odometry/speed"] = T
        file["car/time"] = T
        kind = [("rate", "f4"), ("temperature", "i2"), ("label", "S3")]
        file["car/gyro"] = np.array([(k, 20, b"abc") for k in range(100)], dtype=kind)
        file.attrs["driver"] = "me"
    recording = read(tmp_path / "lap.h5", columns(v_x="car/odometry/speed", yaw_rate="car/gyro/rate"))
    np.testing.assert_array_equal(recording["v_x"], T)
    np.testing.assert_array_equal(recording["yaw_rate"], np.arange(100))
    assert not recording.resampled


def test_groups_with_their_own_time_meet_on_the_fastest_clock_or_on_the_named(tmp_path):
    slow = np.arange(21) * 0.1
    with h5py.File(tmp_path / "lap.h5", "w") as file:
        file["imu/time"], file["imu/rate"] = T, np.sin(T)
        file["wheel/time"], file["wheel/speed"] = slow, 5 + slow**2
    both = {"v_x": "wheel/speed", "yaw_rate": "imu/rate"}
    fast = read(tmp_path / "lap.h5", columns(**both))
    np.testing.assert_array_equal(fast.time, T)
    worst = np.max(np.abs(fast["v_x"] - (5 + T**2)))
    assert worst == pytest.approx(fast.resampled["v_x"].largest, rel=0.1)  # h^2 / 8 of the second derivative
    assert worst == pytest.approx(0.1**2 / 8 * 2, rel=0.1)
    named = read(tmp_path / "lap.h5", columns(time='column="wheel/time"', **both))
    np.testing.assert_array_equal(named.time, slow[:-1])
    assert set(named.resampled) == {"yaw_rate"}


def test_nanoseconds_since_1970_keep_their_microseconds(tmp_path):
    start = 1_731_000_000_123_456_789
    steps = np.cumsum(np.full(1000, 10_000_001, dtype=np.int64))
    with h5py.File(tmp_path / "lap.h5", "w") as file:
        file["t"], file["v"] = start + steps, np.zeros(1000)
    recording = read(tmp_path / "lap.h5", columns(time='column="t"', unit="ns", v_x="v"))
    np.testing.assert_allclose(recording.time, (steps - steps[0]) * 1e-9, atol=1e-9, rtol=0)
    assert "2024-11-07" in recording.notes[0]


def test_a_dataset_larger_than_its_file_can_hold_is_refused(tmp_path):
    with h5py.File(tmp_path / "lap.h5", "w") as file:
        file.create_dataset("time", shape=(10**10,), dtype="f8", chunks=(1000,))
    with pytest.raises(BadInput, match="claims to hold 80 GB"):
        read(tmp_path / "lap.h5")
