"""Effects that are fitted by name alone, recovered from a simulator that shares no code with the models."""

from dataclasses import replace

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


def driven_with(name, magnitude, seed=1):
    given = manoeuvre("mixed", FULL_SIZE_CAR, duration=12.0, rate=100.0)
    given = {signal: np.asarray(values, float) for signal, values in given.items() if signal != "drive"}
    truth, rng = simulate_lateral(FULL_SIZE_CAR, given, {name: magnitude}), np.random.default_rng(seed)
    read = {signal: truth[signal] + sd * rng.standard_normal(len(truth[signal])) for signal, sd in NOISE.items()}
    time = given.pop("time")
    return Recording("drive", time, given | read)


def fitted(name, magnitude, seed=1, effect=None, **more):
    model = on_vehicle(lateral(), FULL_SIZE_CAR) + (effect or EFFECTS[name]).at(EFFECTS[name].typical)
    known = [parameter.name for parameter in model.parameters if parameter.name not in {"D_f", "D_r", name}]
    return gb.fit(model, driven_with(name, magnitude, seed), fix=known, free=[name], **more)


@pytest.mark.parametrize(
    ("name", "magnitude", "close"), [("steering_compliance", 0.012, 0.001), ("steering_jerk_limit", 4.0, 0.02)]
)
def test_an_effect_is_recovered_beside_the_grip_of_both_axles(name, magnitude, close):
    fit = fitted(name, magnitude)
    low, high = fit.conf_int().loc[name]
    assert fit.params[name] == pytest.approx(magnitude, abs=close)
    assert low < magnitude < high


@pytest.mark.parametrize("size", [0.002, 0.0047, 0.017])  # 0.0087: below
def test_of_the_many_optima_of_a_resolution_the_best_is_found(size):
    assert fitted("sensor_quantisation", size).params["sensor_quantisation"] == pytest.approx(size, rel=0.005)


@pytest.mark.slow
def test_intervals_of_a_resolution_hold_it():
    drawn, rng = 30, np.random.default_rng(20261202)
    held = 0
    for size in np.exp(rng.uniform(np.log(0.002), np.log(0.02), drawn)):
        low, high = fitted("sensor_quantisation", size, int(rng.integers(10**8))).conf_int().loc["sensor_quantisation"]
        held += low < size < high < 1.02 * low
    assert held >= 0.9 * drawn


def test_sizes_of_an_effect_of_ones_own_that_rounds_are_searched_and_told():
    own, said = replace(EFFECTS["sensor_quantisation"], name="own"), []
    fit = fitted("sensor_quantisation", 0.0087, effect=own, progress=lambda line, **how: said.append(line))
    assert fit.params["sensor_quantisation"] == pytest.approx(0.0087, rel=0.005)
    assert any("size 100 of 796" in line for line in said)
    assert any("interval of the size" in line for line in said)


def test_a_resolution_too_fine_to_show_is_not_determined():
    fit = fitted("sensor_quantisation", 1e-5)
    low, high = fit.conf_int().loc["sensor_quantisation"]
    assert low <= 1e-5 < high
    assert any("does not determine sensor_quantisation" in reason for reason in fit.verdict.reasons)
