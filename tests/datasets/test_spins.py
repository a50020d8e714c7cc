"""Where a vehicle spins: found by kinematics alone, with and without a sensor of sideways speed, and nowhere else."""

import numpy as np
import pytest
from simulated import clean

from greybox_id.datasets.checks import Severity, check
from greybox_id.datasets.recording import Recording
from greybox_id.datasets.spins import spins, without_spins

RATE = 100.0
NOISE = {"v_x": 0.03, "v_y": 0.03, "yaw_rate": 0.03, "a_x": 0.2, "a_y": 0.2}
CHANNELS = {
    "v_y": ("v_x", "v_y", "yaw_rate"),
    "accelerations": ("v_x", "yaw_rate", "a_x", "a_y"),
    "lateral acceleration": ("v_x", "yaw_rate", "a_y"),
}


def moved(path, sideslip, speed, names, seed=0):
    """A rigid body whose velocity has this direction `path`, rad, speed and sideslip angle, rad, at each instant."""
    rng = np.random.default_rng(seed)
    time = np.arange(len(path)) / RATE
    v_x, v_y = speed * np.cos(sideslip), speed * np.sin(sideslip)
    yaw_rate = np.gradient(path - sideslip, 1 / RATE)
    exact = {
        "v_x": v_x,
        "v_y": v_y,
        "yaw_rate": yaw_rate,
        "a_x": np.gradient(v_x, 1 / RATE) - v_y * yaw_rate,
        "a_y": np.gradient(v_y, 1 / RATE) + v_x * yaw_rate,
    }
    signals = {name: exact[name] + NOISE[name] * rng.standard_normal(len(time)) for name in names}
    return Recording("drive", time, signals)


def turned(seconds, starts, ends, angle, speed=5.0):
    """A path of gentle curves, and a sideslip angle that reaches `angle` between two instants, then is undone."""
    time = np.arange(0, seconds, 1 / RATE)
    path = 0.5 * np.sin(time)
    gentle = -0.03 * np.sin(time)
    share = np.interp(time, [starts, starts + 0.6, ends - 0.6, ends], [0.0, 1.0, 1.0, 0.0])
    return path, gentle + angle * share, np.where(share > 0, speed - 2.0 * share, speed)


@pytest.mark.parametrize("names", CHANNELS.values(), ids=CHANNELS)
@pytest.mark.parametrize("way", [1, -1])
def test_a_spin_lasts_from_its_first_sideslip_until_the_vehicle_drives_straight(names, way):
    path, sideslip, speed = turned(30.0, 12.0, 14.0, way * 1.5)
    path = np.where(np.arange(len(path)) / RATE > 16.0, path[1600], path)  # straight ahead from 16 s on
    r = moved(path, sideslip, speed, names)
    ((a, b),) = spins(r)
    assert 11.5 <= r.time[a] <= 12.5
    assert 13.5 <= r.time[b - 1] <= 19.0
    left = without_spins(r)
    assert left.runs == ((0, a), (a, a + len(r) - b))
    np.testing.assert_array_equal(left["yaw_rate"], np.delete(r["yaw_rate"], slice(a, b)))


@pytest.mark.parametrize("names", CHANNELS.values(), ids=CHANNELS)
def test_a_drift_that_is_caught_is_no_spin(names):
    r = moved(*turned(30.0, 12.0, 16.0, 0.5), names)
    assert spins(r) == []
    assert without_spins(r) is r


@pytest.mark.parametrize("names", CHANNELS.values(), ids=CHANNELS)
def test_a_vehicle_that_goes_on_spinning_is_left_out_until_the_end(names):
    path, sideslip, speed = turned(30.0, 12.0, 1000.0, 1.5)
    sideslip = sideslip + 2.0 * np.clip(np.arange(len(path)) / RATE - 13.0, 0.0, None)
    ((a, b),) = spins(moved(path, sideslip, speed, names))
    assert b == len(path)
    assert 11.5 <= a / RATE <= 12.5


@pytest.mark.parametrize("seed", range(6))
@pytest.mark.parametrize("speed", [1.8, 15.0])
def test_ordinary_drives_hold_none(seed, speed):
    assert spins(clean(seed, speed=speed, wheelbase=0.32 if speed < 5 else 2.7)) == []


def test_a_single_reading_that_is_off_is_none():
    r = moved(*turned(30.0, 40.0, 41.2, 1.5), CHANNELS["v_y"])
    off = r["v_y"].copy()
    off[1000:1002] = 9.0
    assert spins(r.with_signals(v_y=off)) == []


def test_check_names_them_unless_readings_are_wrong():
    path, sideslip, speed = turned(30.0, 12.0, 14.0, 1.5)
    r = moved(path, sideslip, speed, ("v_x", "v_y", "yaw_rate", "a_x", "a_y"))
    (one,) = [finding for finding in check(r) if finding.kind == "spins"]
    assert one.severity is Severity.WARNING
    assert "from t = 1" in one.sentence
    assert one.where.rows[0] == spins(r)[0][0]
    wrong = r.with_signals(a_y=-r["a_y"])
    assert not [finding for finding in check(wrong) if finding.kind == "spins"]


def test_without_sideways_motion_nothing_is_said():
    r = moved(*turned(30.0, 12.0, 14.0, 1.5), ("v_x", "yaw_rate"))
    assert spins(r) == []


def test_nothing_is_left_out_where_nothing_else_is_left():
    path, sideslip, speed = turned(10.0, -1.0, 1000.0, 1.5)
    r = moved(path, sideslip, speed, CHANNELS["v_y"])
    assert spins(r) == [(0, len(r))]
    assert without_spins(r) is r


@pytest.mark.parametrize("rows", [1, 3])
def test_rows_that_do_not_follow_each_other_hold_none(rows):
    r = moved(*turned(30.0, 12.0, 14.0, 1.5), CHANNELS["v_y"])
    alone = r.taken(np.arange(rows), [(k, k + 1) for k in range(rows)])
    assert spins(alone) == []


def test_steering_that_a_spin_does_not_follow_is_no_other_drives():
    path, sideslip, speed = turned(90.0, 40.0, 1000.0, 1.5)
    sideslip = sideslip + 2.0 * np.clip(np.arange(len(path)) / RATE - 41.0, 0.0, None)
    r = moved(path, sideslip, speed, ("v_x", "v_y", "yaw_rate", "a_x", "a_y"))
    follows = np.where(r.time < 40.0, np.gradient(path - sideslip, 1 / RATE) * 0.3 / speed, 0.3 * np.sin(3.0 * r.time))
    kinds = [finding.kind for finding in check(r.with_signals(steer=follows))]
    assert "spins" in kinds
    assert "unrelated" not in kinds
