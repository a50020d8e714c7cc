"""One file per topic: clocks aligned by what two files have in common, within its uncertainty; else by stamps."""

import numpy as np
import pandas as pd
import pytest

from greybox_id.base.errors import BadInput
from greybox_id.datasets.column_map import parse_column_map
from greybox_id.datasets.joining import join_files

MAP = """
[time]
column = "{time}"
{more}
unit = "s"
[signals]
v_x = { column = "speed", unit = "m/s" }
yaw_rate = { column = ["odom_yaw_rate", "gyro_z"], unit = "rad/s" }
a_x = { column = "acc_x", unit = "m/s^2" }
steer = { column = "servo", unit = "rad", optional = true }
"""
EPOCH = 1_731_000_000


def mapping(time="t", more=""):
    return parse_column_map(MAP.replace("{time}", time).replace("{more}", more), "mine.toml")


def wave(t):
    return np.sin(0.8 * t) + np.sin(2.0 * t + 1) + np.sin(4.4 * t + 2)


@pytest.fixture
def topics(tmp_path):
    """Three files: imu at 100 Hz with a clock ahead, odometry at 50 Hz, commands at 10 Hz."""

    def topics(ahead=0.083, stamps=None, seed=0, gyro="gyro_z", **kinds):
        rng = np.random.default_rng(seed)

        def times(t):
            return {"t": t} if stamps is None else stamps(t)

        imu, odom, commands = (np.arange(start, 40, step) for start, step in ((0, 0.01), (0.004, 0.02), (0, 0.1)))
        tables = {
            "odom": {
                "speed": 5 + 0.3 * wave(odom),
                "odom_yaw_rate": wave(odom) + 0.02 * rng.standard_normal(len(odom)),
            },
            "imu": {gyro: wave(imu) + 0.02 * rng.standard_normal(len(imu)), "acc_x": 0.3 * np.gradient(wave(imu), imu)},
            "commands": {"servo": 0.1 * wave(commands)},
        }
        for (name, table), t in zip(tables.items(), (odom, imu + ahead, commands), strict=True):
            pd.DataFrame(times(t) | table).to_csv(tmp_path / f"{name}.csv", index=False, **kinds)
        return [tmp_path / f"{name}.csv" for name in tables]

    return topics


@pytest.mark.parametrize("seed", range(3))
def test_an_offset_is_found_within_its_uncertainty_and_taken_off(topics, seed):
    recording, (imu, commands) = join_files(topics(0.083, seed=seed), mapping())
    assert (imu.file, imu.against, imu.signal, imu.taken_off) == ("imu", "odom", "yaw_rate", True)
    assert abs(imu.seconds - 0.083) < 3 * imu.sd < 0.01
    assert not commands.signal
    middle = (recording.time > 1) & (recording.time < 39)
    np.testing.assert_allclose(recording["a_x"][middle], 0.3 * _slope(recording.time)[middle], atol=0.03)
    assert recording.sample_time == pytest.approx(0.01)


def _slope(t):
    return 0.8 * np.cos(0.8 * t) + 2.0 * np.cos(2.0 * t + 1) + 4.4 * np.cos(4.4 * t + 2)


@pytest.mark.parametrize(
    ("ahead", "rate"), [(0.35, 0.01), (-0.8, -0.004), (0.0, 0.001), (3.5, 0.01), (-9, 0.002), (1.7e9, 0.001)]
)
def test_a_clock_that_runs_fast_or_slow_is_put_right(topics, ahead, rate):
    files = topics(0.0)
    imu = pd.read_csv(files[1])
    imu["t"] = imu["t"] * (1 + rate) + ahead
    imu.to_csv(files[1], index=False)
    recording, (offset, _) = join_files(files, mapping())
    start = offset.alignment.start
    assert offset.alignment.rate == pytest.approx(rate, abs=3 * offset.alignment.rate_sd)
    assert offset.seconds == pytest.approx(ahead + rate * start, abs=4 * offset.sd)
    assert 0 < offset.alignment.left < 0.002
    inside = np.isfinite(recording["a_x"])
    due = 0.3 * np.gradient(wave(recording.time), recording.time)
    assert np.sqrt(np.mean((recording["a_x"] - due)[inside][5:-5] ** 2)) < 0.01


def test_files_whose_common_signal_differs_are_taken_at_their_stamps_and_it_is_said(topics):
    files = topics(0.0)
    imu = pd.read_csv(files[1])
    imu["gyro_z"] = np.random.default_rng(0).standard_normal(len(imu))
    imu.to_csv(files[1], index=False)
    _, (offset, _) = join_files(files, mapping())
    assert not offset.taken_off
    assert "yaw_rate differ too much" in offset.sentence


def test_clocks_that_agree_are_left_alone(topics):
    _, (imu, _) = join_files(topics(0.0), mapping())
    assert abs(imu.seconds) < 3 * imu.sd
    assert not imu.taken_off


def test_files_with_nothing_in_common_are_taken_at_their_stamps(topics):
    odom, imu, commands = topics(0.05, gyro="unknown")
    recording, offsets = join_files([odom, imu, commands], mapping())
    assert all(not offset.taken_off and np.isnan(offset.seconds) for offset in offsets)
    assert any("imu: time stamps are kept" in note for note in recording.notes)
    assert any(note.startswith("the signals have 3 clocks; all were resampled to the ") for note in recording.notes)


def split(t):
    ns = EPOCH * 10**9 + np.round(t * 1e9).astype(np.int64)
    return {"sec": ns // 10**9, "nsec": ns % 10**9}


@pytest.mark.parametrize("kind", ["split", "ISO", "ns"])
def test_stamps_may_be_split_or_dates_or_counts(topics, kind):
    def dates(t):
        return {"t": pd.to_datetime(EPOCH * 10**9 + np.round(t * 1e9).astype(np.int64), unit="ns", utc=True)}

    def counts(t):
        return {"t": EPOCH * 10**9 + np.round(t * 1e9).astype(np.int64)}

    how = {"split": split, "ISO": dates, "ns": counts}[kind]
    own = mapping("sec", 'nanoseconds = "nsec"') if kind == "split" else mapping()
    if kind == "ns":
        own = parse_column_map(MAP.replace("{time}", "t").replace("{more}", "").replace('"s"', '"ns"', 1), "mine.toml")
    recording, (imu, _) = join_files(topics(0.02, stamps=how), own)
    assert imu.seconds == pytest.approx(0.02, abs=3 * imu.sd)
    assert recording.time[0] < 0.1
    np.testing.assert_allclose(np.diff(recording.time), 0.01, atol=1e-6)


def test_files_as_spreadsheets_write_them_are_read(topics):
    mapping = parse_column_map(
        'separator = ";"\ndecimal = ","\n' + MAP.replace("{time}", "t").replace("{more}", ""), "m.toml"
    )
    files = topics(0.05, sep=";", decimal=",", encoding="utf-16", quoting=1)
    recording, (imu, _) = join_files(files, mapping)
    assert imu.taken_off
    assert np.mean(recording["v_x"]) == pytest.approx(5.0, abs=0.1)


def test_what_cannot_be_joined_is_refused(topics, tmp_path):
    odom, imu, _ = topics()
    with pytest.raises(BadInput, match="name two files or more"):
        join_files([odom], mapping())
    (tmp_path / "more").mkdir()
    twin = tmp_path / "more" / "imu.csv"
    twin.write_bytes(imu.read_bytes())
    with pytest.raises(BadInput, match="Two files are called imu"):
        join_files([odom, imu, twin], mapping())
    late = pd.read_csv(imu).assign(t=lambda table: table["t"] + 1e4, gyro_z=lambda table: table["t"] % 1.0)
    late.to_csv(imu, index=False)
    with pytest.raises(BadInput, match="no time in common"):
        join_files([odom, imu], mapping())


def test_poses_keep_their_own_clock(tmp_path):
    time = np.arange(0, 10, 0.05)
    yaw = 0.8 * time + 1e-3 * np.random.default_rng(0).standard_normal(len(time))
    pd.DataFrame({"time": time, "x": np.sin(yaw), "y": -np.cos(yaw), "yaw": yaw}).to_csv(
        tmp_path / "poses.csv", index=False
    )
    fast = np.arange(0, 10, 0.01)
    pd.DataFrame({"time": fast, "steer": 0.1 + 0 * fast}).to_csv(tmp_path / "commands.csv", index=False)
    signals = {"x": "m", "y": "m", "yaw": "rad", "steer": "rad"}
    text = "".join(f'[signals.{name}]\nunit="{unit}"\n' for name, unit in signals.items())
    mapping = parse_column_map(f'[poses]\nforward=0.0\n[time]\nunit="s"\n{text}', "own.toml")
    recording, _ = join_files([tmp_path / "poses.csv", tmp_path / "commands.csv"], mapping)
    assert recording.sample_time == pytest.approx(0.05)
    assert np.median(recording["yaw_rate"]) == pytest.approx(0.8, abs=0.02)
    np.testing.assert_allclose(recording["steer"], 0.1)
