"""A diagnosis as a vehicle file simulates as the closed model does."""

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from driven import commands, driven, without
from made_gaps import DELAY, clear, long_names
from memory_cases import made
from toys import tiny

from greybox_id.api.closed_vehicle import closed_vehicle, fitted_vehicle
from greybox_id.base.errors import BadInput
from greybox_id.fitting.how import FitOptions
from greybox_id.fitting.scores.metrics import simulate
from greybox_id.fitting.verb import fit
from greybox_id.gap.diagnosis import diagnose
from greybox_id.gap.gap import Ranked
from greybox_id.models.effects import EFFECTS
from greybox_id.models.parameter import Stated
from greybox_id.models.registry import build, model_of, vehicle_parameters
from greybox_id.models.vehicle import ChosenModel, write_vehicle
from greybox_id.models.vehicle import vehicle as read_vehicle

pytestmark = pytest.mark.usefixtures("_uncompiled")


@pytest.fixture
def car():
    return read_vehicle("full_size_car")


def through_a_file(vehicle, folder: Path):
    """The vehicle, written and read back as commands read it."""
    return read_vehicle(write_vehicle(vehicle, folder / "closed.toml"), vehicle_parameters(), EFFECTS)


def same_simulation(one, other):
    given = without(commands(4.0), "v_x") if one.name == "single_track" else commands(4.0)
    start = {"v_x": 18.0} if one.name == "single_track" else {}
    a, b = (simulate(model, given, start).predicted for model in (one, other))
    assert np.all(np.isfinite(a))
    np.testing.assert_array_equal(a, b)


@pytest.mark.parametrize("name", ["single_track", "lateral"])
def test_the_closed_vehicle_simulates_as_the_model_with_its_effects(car, tmp_path, name):
    effects = {"steering_delay": 0.0312, "grip_scale": 0.83}
    closed = build(name, None, effects, car)
    closed = closed.with_parameters(closed["B_f"].with_value(9.71))  # what else the diagnosis moved
    grip = Ranked("grip_scale", 0.9, 0.83, "1", (0.79, 0.87))
    gap = clear(model=name, closed=closed, ranking=(DELAY, grip), applied=tuple(effects))
    again = through_a_file(closed_vehicle(car, gap), tmp_path)
    assert model_of(again).effects == tuple(effects)
    same_simulation(closed, model_of(again))
    assert again.values["B_f"].value == 9.71
    assert again.values["B_f"].sd == car.values["B_f"].sd
    assert again.values["m"] == car.values["m"]


def test_magnitudes_carry_the_standard_deviation_of_their_interval(car):
    gap = clear(closed=build("single_track", None, {"steering_delay": 0.031}, car))
    stated = closed_vehicle(car, gap).model.effects["steering_delay"]
    assert stated.value == 0.031
    assert stated.sd == pytest.approx((0.0369 - 0.0251) / 3.92, rel=1e-3)


def test_an_interval_without_an_end_tells_no_standard_deviation(car):
    effects = {"longitudinal_load_transfer": 0.41, "steering_rate_limit": 0.62}
    gap = replace(long_names(), closed=build("single_track", None, effects, car))
    assert closed_vehicle(car, gap).model.effects["steering_rate_limit"].sd is None


def test_without_a_closed_model_the_ranking_tells_the_magnitudes(car, tmp_path):
    again = through_a_file(closed_vehicle(car, clear()), tmp_path)
    same_simulation(model_of(again), build("single_track", None, {"steering_delay": 0.031}, car))


def test_an_applied_effect_is_no_tolerance_any_more_and_others_stay(car):
    lag = Ranked("steering_lag", 0.9, 0.04, "s", (0.03, 0.05))
    closed = build("single_track", None, {"steering_lag": 0.04}, car)
    found = closed_vehicle(car, clear(closed=closed, ranking=(lag,), applied=("steering_lag",)))
    assert "steering_lag" not in found.effects
    assert found.effects["accel_bias_x"] == car.effects["accel_bias_x"]
    assert found.noise == car.noise


def test_a_limit_that_the_closed_model_has_taken_away_is_no_effect_of_the_closed_vehicle(car, tmp_path):
    """Its fit to free runs had moved the limit to infinity, which no file states."""
    closed = build("single_track", None, {"steering_delay": 0.031, "motor_saturation": float("inf")}, car)
    limit = Ranked("motor_saturation", 0.9, 3.3, "m/s^2", (2.0, 8.9))
    gap = clear(closed=closed, ranking=(DELAY, limit), applied=("steering_delay", "motor_saturation"))
    again = through_a_file(closed_vehicle(car, gap), tmp_path)
    assert tuple(again.model.effects) == ("steering_delay",)
    same_simulation(closed, model_of(again))


def test_effects_the_vehicle_had_stay_and_its_name_does_not_grow(car):
    had = replace(car, model=ChosenModel("lateral", {"tyre": "brush"}, {"yaw_rate_bias": Stated(0.01, 0.002)}))
    closed = model_of(had) + EFFECTS["steering_delay"].at(0.031)
    found = closed_vehicle(had, clear(model="lateral", closed=closed))
    assert found.model.settings["tyre"] == "brush"
    assert found.model.effects["yaw_rate_bias"].sd == 0.002
    assert tuple(found.model.effects) == ("yaw_rate_bias", "steering_delay")
    twice = closed_vehicle(found, clear(model="lateral", closed=model_of(found)))
    assert twice.name == found.name == "full-size car, gap closed"


def test_second_parameters_of_effects_are_numbers_of_the_closed_vehicle(car, tmp_path):
    closed = build("single_track", None, {"wind_gust": 5.0, "grip_scale": 0.8}, car)
    closed = closed.with_parameters(
        closed["wind_direction"].with_value(1.0), closed["grip_scale_slope"].with_value(0.0)
    )
    wind, grip = Ranked("wind_gust", 0.9, 5.0, "m/s", (4.0, 6.0)), Ranked("grip_scale", 0.9, 0.8, "1", (0.7, 0.9))
    gap = clear(closed=closed, ranking=(wind, grip), applied=("wind_gust", "grip_scale"))
    again = through_a_file(closed_vehicle(car, gap), tmp_path)
    assert {name: again.values[name].value for name in ("wind_direction", "grip_scale_slope")} == {
        "wind_direction": 1.0, "grip_scale_slope": 0.0,
    }  # fmt: skip
    same_simulation(closed, model_of(again))


def test_a_fit_is_a_vehicle_that_simulates_alike(car, tmp_path):
    model = build("lateral", None, {"steering_delay": None}, car)
    held = [replace(model[name], fixed=True) for name in ("m", "I_z", "C_f", "C_r", "B_f", "B_r", "D_f")]
    drive = driven("lateral", runs=1, seconds=4.0, effects={"steering_delay": 0.05})
    found = fit([model.with_parameters(*held)], [drive], how=FitOptions(horizon=1.0, solver="gauss-newton"))
    stated = fitted_vehicle(found, "lap")
    assert stated.values["D_r"].sd > 0
    assert stated.values["m"].plain
    assert stated.model.effects["steering_delay"].value == float(found.model["steering_delay"].array)
    same_simulation(found.model, model_of(through_a_file(stated, tmp_path)))


def test_a_closed_model_with_memory_is_no_vehicle(car):
    gap = SimpleNamespace(closed=build("msnn_lat"), model="msnn_lat")
    with pytest.raises(BadInput, match="no place for the weights of msnn_lat"):
        closed_vehicle(car, gap)


def test_a_fit_s_training_errors_are_its_noise():
    drives = made(tiny("msnn_full"), rows=800)  # enough that its weights are near those that made it
    found = fit(tiny("msnn_full"), [drives], how=FitOptions(strengths=1.0, solver="gauss-newton"))
    stated = fitted_vehicle(found, "lap")
    for output in found.model.outputs:
        assert stated.noise[output] == found.metrics["train"]["closed_loop"][output]["rmse"]
    assert not stated.values
    assert stated.model.name == "msnn_full"
    assert fitted_vehicle(replace(found, metrics={}), "lap").noise == {}
    said = diagnose(found.model, [made(tiny("msnn_full"), seed=4)], EFFECTS, vehicle=stated)
    assert not said.gap_detected
    with pytest.raises(BadInput, match="no place for the weights of msnn_full"):
        closed_vehicle(stated, said)
