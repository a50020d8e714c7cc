"""Effects that are fitted by name alone, recovered from a simulator that shares no code with the models."""

import numpy as np
import pytest
from driving import on_vehicle
from reference_manoeuvres import manoeuvre
from reference_vehicle import FULL_SIZE_CAR, simulate_lateral

import greybox_id as gb
from greybox_id.datasets.recording import Recording
from greybox_id.models.effects import EFFECTS
from greybox_id.models.single_track import lateral

NOISE = {"v_y": 0.01, "yaw_rate": 0.002, "a_y": 0.05}


def driven_with(name, magnitude):
    given = manoeuvre("mixed", FULL_SIZE_CAR, duration=12.0, rate=100.0)
    given = {signal: np.asarray(values, float) for signal, values in given.items() if signal != "drive"}
    truth, rng = simulate_lateral(FULL_SIZE_CAR, given, {name: magnitude}), np.random.default_rng(1)
    read = {signal: truth[signal] + sd * rng.standard_normal(len(truth[signal])) for signal, sd in NOISE.items()}
    time = given.pop("time")
    return Recording("drive", time, given | read)


def fitted(name, magnitude):
    model = on_vehicle(lateral(), FULL_SIZE_CAR) + EFFECTS[name].at(EFFECTS[name].typical)
    known = [parameter.name for parameter in model.parameters if parameter.name not in {"D_f", "D_r", name}]
    return gb.fit(model, driven_with(name, magnitude), fix=known, free=[name])


@pytest.mark.parametrize(
    ("name", "magnitude", "close"), [("steering_compliance", 0.012, 0.001), ("steering_jerk_limit", 4.0, 0.02)]
)
def test_an_effect_is_recovered_beside_the_grip_of_both_axles(name, magnitude, close):
    fit = fitted(name, magnitude)
    low, high = fit.conf_int().loc[name]
    assert fit.params[name] == pytest.approx(magnitude, abs=close)
    assert low < magnitude < high


@pytest.mark.parametrize("size", [0.002, 0.0047, 0.0087, 0.017])
def test_of_the_many_optima_of_a_resolution_the_best_is_found(size):
    assert fitted("sensor_quantisation", size).params["sensor_quantisation"] == pytest.approx(size, rel=0.005)
