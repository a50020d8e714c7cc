"""Without effects, and in the forms of models, the virtual vehicle is the nominal single track."""

import numpy as np
import pytest
from reference_vehicle import simulate as simulate_reference

from greybox_id.fitting.scores.metrics import simulate
from greybox_id.models.registry import build
from greybox_id.models.vehicle import parse_vehicle
from greybox_lab.virtual.virtual_vehicle import drive, random_vehicle, replay, vehicle_file_text

READ = ("v_x", "v_y", "yaw_rate", "a_x", "a_y")
VEHICLES = ((3, "racer"), (4, "car"), (5, "truck"), (6, "sports"))


def started(truth):
    return {name: float(truth.states[name][0]) for name in ("v_x", "v_y", "yaw_rate")}


@pytest.mark.parametrize(("seed", "kind"), VEHICLES)
def test_a_free_run_of_the_single_track_model_is_the_same(seed, kind, tmp_path):
    car = random_vehicle(seed, kind)
    recording, truth = drive(car, "mixed", 20.0, seed=seed, noise=0.0)
    model = build("single_track", None, {}, parse_vehicle(vehicle_file_text(car), tmp_path / "car.toml"))
    found = simulate(model, recording, started(truth))
    for k, name in enumerate(model.outputs):
        off = found.predicted[:, k] - truth.readings[name]
        assert np.sqrt(np.mean(off**2)) < 1e-3 * np.std(truth.readings[name])


@pytest.mark.parametrize(("seed", "kind"), VEHICLES)
@pytest.mark.parametrize("rate", [50.0, 100.0])
def test_it_moves_as_an_independent_simulator_does(seed, kind, rate):
    car = random_vehicle(seed, kind)
    recording, truth = drive(car, "mixed", 15.0, rate, seed=seed, noise=0.0)
    commands = {"time": recording.time, "steer": recording["steer"], "drive": recording[car.drive_channel]}
    other = simulate_reference(dict(car.parameters), commands, start=tuple(started(truth).values()), fine=1e-3)
    for name in READ:
        assert np.allclose(truth.readings[name], other[name], atol=1e-6 * np.std(other[name]))


def test_a_row_is_read_just_after_its_commands_are_applied():
    car = random_vehicle(4, "car")
    recording, _ = drive(car, "coast_down", 2.0, noise=0.0)
    steer = np.where(np.arange(len(recording)) < 50, 0.0, 0.02)
    commands = recording.with_signals(**{"steer": steer, car.drive_channel: np.zeros(len(recording))})
    _, truth = replay(car, commands, {"v_x": 20.0})
    assert np.all(truth.readings["a_y"][:50] == 0.0)
    assert truth.readings["a_y"][50] > 0.3
    assert truth.readings["yaw_rate"][50] == 0.0
    assert truth.readings["yaw_rate"][51] > 0.0


def test_a_replay_of_what_was_driven_is_what_was_driven():
    car = random_vehicle(8)
    recording, truth = drive(car, "weave", 10.0, noise=0.0, effects={"combined_slip": 0.8})
    again, also = replay(car, recording, started(truth), {"combined_slip": 0.8})
    for name in READ:
        assert np.allclose(truth.readings[name], also.readings[name], rtol=1e-9, atol=1e-9)
    assert np.array_equal(recording["steer"], again["steer"])
