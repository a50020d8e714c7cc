"""Recordings: what is in them, that they can be had again, and that the vehicle stays on its wheels."""

from functools import cache

import numpy as np
import pytest

from greybox_id.base.errors import BadInput
from greybox_lab.virtual.virtual_vehicle import EFFECTS, MANOEUVRES, OUTSIDE, drive, random_vehicle
from greybox_lab.virtual.virtual_vehicle.car import DRIVE_CHANNELS

KINDS = ("racer", "car", "truck", "sports")


@cache
def mixed(seed, **settings):
    car = random_vehicle(seed)
    return car, *drive(car, "mixed", 60.0, seed=seed, **settings)


@pytest.mark.parametrize("seed", range(20))
def test_no_vehicle_spins_or_stops_whatever_it_lacks(seed):
    car, rng = random_vehicle(seed), np.random.default_rng(seed)
    name = str(rng.choice([*EFFECTS, *OUTSIDE]))
    forms = "other" if seed % 2 else "nominal"
    _, truth = drive(car, "mixed", 40.0, effects={name: car.magnitude(name, rng)}, forms=forms, seed=seed)
    v_x, v_y = truth.states["v_x"], truth.states["v_y"]
    assert np.max(np.abs(np.arctan2(v_y, v_x))) < 0.4
    assert np.min(v_x) > (1.5 if car.kind == "racer" else 5.0)


@pytest.mark.parametrize("seed", range(6))
def test_driving_is_rich(seed):
    car, recording, truth = mixed(seed)
    size, states = car.size, truth.states
    assert 0.6 < np.max(np.abs(states["a_y"])) / size.grip < 1.0
    assert np.std(states["v_x"]) > 0.1 * np.mean(states["v_x"])
    assert np.min(states["a_x"]) < -0.6 * size.brake
    assert np.max(states["a_x"]) > 0.5 * size.drive
    power = np.abs(np.fft.rfft(recording["steer"])) ** 2
    frequency = np.fft.rfftfreq(len(recording), recording.sample_time)
    lively = np.sum(power[(frequency > 1.0) & (frequency < 4.0)]) / np.sum(power[frequency > 0.05])
    assert lively > 0.03


@pytest.mark.parametrize("manoeuvre", MANOEUVRES)
@pytest.mark.parametrize("kind", KINDS)
def test_every_manoeuvre_can_be_driven(manoeuvre, kind):
    car = random_vehicle(40, kind)
    recording, truth = drive(car, manoeuvre, 12.0, 50.0)
    assert len(recording) == 600
    assert recording.sample_time == pytest.approx(0.02)
    assert len(recording.runs) == 1
    assert np.max(np.abs(truth.states["v_y"] / np.maximum(truth.states["v_x"], 0.5))) < 0.4
    assert np.max(np.abs(recording["steer"])) <= car.steer_max


@pytest.mark.parametrize("seed", range(8))
def test_a_recording_has_the_canonical_signals(seed):
    car = random_vehicle(seed)
    recording, truth = drive(car, duration=3.0, seed=seed)
    assert set(recording.signals) == {*car.noise, "steer", car.drive_channel}
    assert car.drive_channel in DRIVE_CHANNELS
    assert ("v_y" in recording) == car.measures_v_y
    assert all(len(values) == len(recording) for values in (*truth.states.values(), *truth.readings.values()))


def test_the_same_seeds_give_the_same_recording():
    first, second = (drive(random_vehicle(5), duration=5.0, seed=2, effects={"wind_gust": 3.0})[0] for _ in range(2))
    other, _ = drive(random_vehicle(5), duration=5.0, seed=3)
    assert all(np.array_equal(first[name], second[name]) for name in first.signals)
    assert not np.array_equal(first["steer"], other["steer"])
    assert random_vehicle(5) == random_vehicle(5)
    assert random_vehicle(5) != random_vehicle(6)


def test_noise_is_as_stated_and_as_asked_for():
    car, recording, truth = mixed(1)
    for name, sd in car.noise.items():
        off = recording[name] - truth.readings[name]
        assert np.std(off) == pytest.approx(sd, rel=0.05)
        assert abs(np.corrcoef(off[1:], off[:-1])[0, 1]) < 0.05
    car, coloured, truth = mixed(1, colour=0.5, outliers=0.003)
    off = (coloured["a_y"] - truth.readings["a_y"]) / car.noise["a_y"]
    usual = off[np.abs(off) < 4.0]
    assert np.std(usual) == pytest.approx(1.0, rel=0.08)
    assert 0.3 < np.corrcoef(off[1:], off[:-1])[0, 1] < 0.6
    assert 0.001 < np.mean(np.abs(off) > 4.5) < 0.006
    car, quantised, _ = mixed(1, quantisation=2.0)
    steps = quantised["yaw_rate"] / (2.0 * car.noise["yaw_rate"])
    assert np.allclose(steps, np.round(steps), atol=1e-6)


def test_accelerations_and_speeds_belong_together():
    """Specific forces are what speeds make of them, row by row."""
    car = random_vehicle(9, "car")
    _, truth = drive(car, "weave", 10.0, 200.0, noise=0.0)
    s, dt = truth.states, 0.005
    for gained, read in (
        (np.diff(s["v_x"]) / dt, s["a_x"] + s["yaw_rate"] * s["v_y"]),
        (np.diff(s["v_y"]) / dt, s["a_y"] - s["yaw_rate"] * s["v_x"]),
    ):
        assert np.sqrt(np.mean((gained - read[:-1]) ** 2)) < 0.05 * np.std(gained) + 0.02
    weight = sum(s[f"F_z_{wheel}"] for wheel in ("fl", "fr", "rl", "rr"))
    assert np.allclose(weight, car.size.weight)


def test_vehicles_are_of_their_class():
    for seed in range(40):
        car = random_vehicle(seed)
        p, size = car.parameters, car.size
        assert size.understeer > 0.0
        assert p["D_r"] > p["D_f"]
        low, high = {"racer": (2, 5), "car": (900, 2200), "truck": (2500, 18000), "sports": (500, 1300)}[car.kind]
        assert low < p["m"] < high
        assert car.kind != "racer" or car.top_speed <= 8.0


@pytest.mark.parametrize("kind", KINDS)
def test_magnitudes_lie_in_their_ranges(kind):
    car, rng = random_vehicle(3, kind), np.random.default_rng(1)
    for name, entry in {**EFFECTS, **OUTSIDE}.items():
        for _ in range(5):
            size = car.magnitude(name, rng)
            assert any(low - 1e-12 <= size <= high + 1e-12 for low, high in entry.ranges(car.size, kind))


def test_what_is_not_known_is_refused():
    car = random_vehicle(1)
    with pytest.raises(BadInput, match="no effect warp_drive"):
        drive(car, effects={"warp_drive": 1.0})
    with pytest.raises(BadInput, match="no effect warp_drive"):
        car.magnitude("warp_drive", np.random.default_rng(0))
    with pytest.raises(BadInput, match="no manoeuvre"):
        drive(car, "parking")
    with pytest.raises(BadInput, match="whole number"):
        drive(car, rate=30.0)
