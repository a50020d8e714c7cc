"""Effects that are not in the vocabulary: they show, and do what is said of them."""

from functools import cache

import numpy as np
import pytest

from greybox_id.datasets.recording import Recording
from greybox_lab.virtual.virtual_vehicle import EFFECTS, OUTSIDE, drive, random_vehicle, replay

READ = ("v_x", "v_y", "yaw_rate", "a_x", "a_y")
G = 9.81


@cache
def driving():
    car = random_vehicle(7, "car")
    recording, truth = drive(car, "mixed", 30.0, seed=5, noise=0.0)
    return car, recording, {name: float(truth.states[name][0]) for name in ("v_x", "v_y", "yaw_rate")}


def again(**effects):
    car, recording, start = driving()
    return replay(car, recording, start, effects)[1]


def straight(car, seconds=4.0, steer=0.0, drive=0.0):
    time = np.arange(int(seconds * 100)) / 100.0
    return Recording(
        "straight", time, {"steer": np.full(len(time), steer), car.drive_channel: np.full(len(time), drive)}
    )


@pytest.mark.parametrize("name", OUTSIDE)
def test_it_shows(name):
    car, _, _ = driving()
    middling = np.sqrt(np.prod(OUTSIDE[name].sizes(car.size, car.kind)))
    read, plain = (
        drive(car, "mixed", 15.0, seed=5, noise=0.0, effects=effects)[0] for effects in ({name: middling}, {})
    )
    off = {c: np.sqrt(np.mean((read[c] - plain[c]) ** 2)) / car.noise.get(c, car.noise["v_x"]) for c in plain.signals
           if c in READ}  # fmt: skip
    assert max(off.values()) > 0.2
    assert set(OUTSIDE[name].resembles) <= set(EFFECTS)


def test_there_are_many_and_none_is_in_the_vocabulary():
    assert len(OUTSIDE) >= 10
    assert not set(OUTSIDE) & set(EFFECTS)


def test_steering_that_differs_between_left_and_right():
    car = random_vehicle(7, "car")
    left, also = (
        replay(car, straight(car, steer=0.02), {"v_x": 20.0}, effects)[1]
        for effects in ({"steering_asymmetry": 0.1}, {"steering_ratio": 1.1})
    )
    right, mirrored = (
        replay(car, straight(car, steer=-0.02), {"v_x": 20.0}, effects)[1]
        for effects in ({"steering_asymmetry": 0.1}, {"steering_ratio": 0.9})
    )
    assert np.allclose(left.readings["a_y"], also.readings["a_y"])
    assert np.allclose(right.readings["a_y"], mirrored.readings["a_y"])


def test_a_dragging_brake_slows_and_turns():
    car = random_vehicle(7, "car")
    _, truth = replay(car, straight(car), {"v_x": 20.0}, {"dragging_brake": 0.02})
    _, plain = replay(car, straight(car), {"v_x": 20.0})
    assert truth.readings["a_x"][0] - plain.readings["a_x"][0] == pytest.approx(-0.02 * G, rel=1e-6)
    p = car.parameters
    expected = 0.02 * p["m"] * G * 0.5 * p["track_f"] / p["I_z"]
    assert truth.states["yaw_acceleration"][0] == pytest.approx(expected, rel=1e-6)


def test_a_sagging_battery_and_burnt_fuel_by_the_minute():
    car = random_vehicle(7, "car")
    pull = straight(car, 30.0, drive=500.0 / car.parameters["force_per_unit"])
    _, plain = replay(car, pull, {"v_x": 15.0})
    _, sagged = replay(car, pull, {"v_x": 15.0}, {"battery_sag": 0.4})
    assert sagged.states["F_x_rl"][-1] == pytest.approx((1.0 - 0.4 * 29.99 / 60) * plain.states["F_x_rl"][-1], rel=1e-3)
    _, lighter = replay(car, pull, {"v_x": 15.0}, {"fuel_burn": 0.2})
    assert lighter.states["mass"][-1] == pytest.approx(0.9, abs=1e-3)


def test_sensors_that_bend_mix_count_or_hang():
    plain, car = again().readings, driving()[0]
    k = 0.5 * OUTSIDE["gyro_compression"].sizes(car.size, car.kind)[1]
    assert np.allclose(again(gyro_compression=k).readings["yaw_rate"], np.tanh(k * plain["yaw_rate"]) / k)
    assert np.allclose(again(accel_cross_axis=0.1).readings["a_x"], plain["a_x"] + 0.1 * plain["a_y"])
    counted = again(wheel_pulses=0.5).readings["v_x"]
    assert np.allclose(counted % 0.5, 0.0)
    assert np.max(np.abs(counted - plain["v_x"])) <= 0.25 + 1e-9
    slipping = again(slip_speed_error=0.1).readings["v_x"]
    assert np.allclose(slipping, plain["v_x"] * (1.0 + 0.1 * plain["a_x"] / G))
    car, recording, start = driving()
    hung, _ = replay(car, recording, start, {"dead_stretches": 0.1}, noise=1.0)
    still = np.diff(hung["a_y"]) == 0.0
    assert 0.03 < np.mean(still) < 0.25
    assert not np.any(np.diff(hung["v_x"]) == 0.0)


def test_steering_that_swings_settles_where_it_is_asked_to():
    car = random_vehicle(7, "car")
    time = np.arange(400) / 100.0
    asked = straight(car).with_signals(steer=np.where(time < 0.5, 0.0, 0.02))
    wheel = replay(car, asked, {"v_x": 20.0}, {"steering_resonance": 1.0})[1].states["steer"]
    assert np.max(wheel) > 0.025
    assert wheel[-1] == pytest.approx(0.02, rel=0.03)
