"""Vehicle files and the true vehicles behind them."""

import numpy as np
import pytest

from greybox_id.models.effects import EFFECTS as OF_MODELS
from greybox_id.models.vehicle import parse_vehicle
from greybox_lab.virtual.virtual_vehicle import (
    EFFECTS,
    drive,
    random_vehicle,
    toleranced,
    tolerances,
    vehicle_file_text,
)


@pytest.mark.parametrize("seed", range(8))
def test_a_vehicle_file_says_what_the_vehicle_is(seed, tmp_path):
    car = random_vehicle(seed)
    spread = tolerances(car)
    read = parse_vehicle(vehicle_file_text(car, spread), tmp_path / "car.toml", tuple(car.parameters), tuple(OF_MODELS))
    assert {name: stated.value for name, stated in read.values.items()} == dict(car.parameters)
    assert {name: stated.sd for name, stated in read.values.items() if stated.sd is not None} == spread.parameters
    assert {name: stated.sd for name, stated in read.effects.items()} == spread.effects
    assert read.noise == dict(car.noise)
    assert read.steer_max == car.steer_max
    assert all(stated.source for stated in read.values.values() if stated.sd is not None)


def test_where_all_is_known_no_tolerance_is_stated(tmp_path):
    read = parse_vehicle(vehicle_file_text(random_vehicle(2)), tmp_path / "car.toml")
    assert all(stated.plain for stated in read.values.values())
    assert not read.effects


def test_true_vehicles_scatter_as_stated():
    car, rng = random_vehicle(3), np.random.default_rng(0)
    spread = tolerances(car)
    drawn = [toleranced(car, rng) for _ in range(600)]
    for name, sd in spread.parameters.items():
        values = np.array([true.parameters[name] for true in drawn])
        assert np.mean(values) == pytest.approx(car.parameters[name], abs=0.15 * sd)
        assert np.std(values) == pytest.approx(sd, rel=0.12)
    for name, sd in spread.effects.items():
        off = np.array([true.small[name] for true in drawn]) - EFFECTS[name].null
        assert np.sqrt(np.mean(off**2)) == pytest.approx(sd, rel=0.12)
    assert all(true.small["steering_delay"] >= 0.0 for true in drawn)


@pytest.mark.parametrize("kind", ["racer", "car", "truck", "sports"])
def test_effects_of_an_examination_are_larger_than_tolerances(kind):
    for seed in range(5):
        car = random_vehicle(seed, kind)
        for name, sd in tolerances(car).effects.items():
            low, _ = EFFECTS[name].sizes(car.size, kind)
            assert low > 2.9 * sd


def test_a_true_vehicle_drives_with_its_small_effects():
    true = toleranced(random_vehicle(3), np.random.default_rng(1))
    _, truth = drive(true, duration=3.0, effects={"steering_offset": 0.01})
    assert truth.effects["steering_offset"] == pytest.approx(0.01 + true.small["steering_offset"])
    assert truth.effects["motor_lag"] == true.small["motor_lag"]
