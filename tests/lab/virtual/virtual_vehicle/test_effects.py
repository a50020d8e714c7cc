"""Every effect of the vocabulary against an independent simulator, which models are held against as well.

What is left between them is compared with what the effect does: with its own influence on the reading.
"""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from reference_vehicle import simulate

from greybox_lab.virtual.virtual_vehicle import EFFECTS, drive, random_vehicle, replay

READ = ("v_x", "v_y", "yaw_rate", "a_x", "a_y")
STATISTICS = ("timestamp_jitter", "dropped_samples")
MOVING = [name for name in EFFECTS if name not in STATISTICS]
SETTLED = 100
"""Rows after which it no longer matters that a model's roll starts at its steady state."""
PLAIN = 1e-3
"""Influences smaller than this, relative to the reading, are not compared."""


MANOEUVRE = {"brake_bias": "brake_in_turn"}


@cache
def driving(kind, manoeuvre="mixed"):
    """Vehicle, what was driven, its start, and second parameters of effects."""
    car = random_vehicle(7, kind)
    recording, truth = drive(car, manoeuvre, 7.0, seed=5, noise=0.0)
    start = {name: float(truth.states[name][0]) for name in ("v_x", "v_y", "yaw_rate")}
    second = {
        "tyre_temperature_E_0": 0.2 * car.size.weight, "roll_frequency": 1.5, "roll_damping": 0.3,
        "motor_saturation_v_b": 0.5 * car.top_speed, "wind_direction": 0.7,
    }  # fmt: skip
    return car, recording, start, second


def as_commands(car, recording):
    return {"time": recording.time, "steer": recording["steer"], "drive": recording[car.drive_channel]}


@cache
def bare(kind, manoeuvre="mixed"):
    car, recording, start, _ = driving(kind, manoeuvre)
    return replay(car, recording, start)[1].readings


def magnitude(car, name):
    return car.magnitude(name, np.random.default_rng(11))


def left_over(found, truth, without):
    """Over the influence of the effect, on readings where that is plain."""
    left = {}
    for name in READ:
        influence = np.sqrt(np.mean((truth[name] - without[name])[SETTLED:] ** 2))
        if influence > PLAIN * np.sqrt(np.mean(without[name] ** 2)):
            left[name] = np.sqrt(np.mean((found[name] - truth[name])[SETTLED:] ** 2)) / influence
    assert left
    return left


@pytest.mark.parametrize("name", MOVING)
@pytest.mark.parametrize("kind", ["racer", "car", "truck"])
def test_an_effect_does_what_it_does_in_an_independent_simulator(name, kind):
    car, recording, start, second = driving(kind, MANOEUVRE.get(name, "mixed"))
    effects = {name: magnitude(car, name), **second}
    _, truth = replay(car, recording, start, effects)
    found = simulate(dict(car.parameters), as_commands(car, recording), effects, start=tuple(start.values()), fine=1e-3)
    assert max(left_over(found, truth.readings, bare(kind, MANOEUVRE.get(name, "mixed"))).values()) < 0.005


@pytest.mark.parametrize("name", EFFECTS)
def test_at_its_null_an_effect_is_not_there(name):
    car, recording, start, _ = driving("car")
    read, _ = replay(car, recording, start, {name: EFFECTS[name].null}, noise=1.0)
    plain, _ = replay(car, recording, start, noise=1.0)
    assert all(np.array_equal(read[signal], plain[signal]) for signal in plain.signals)


def test_jitter_scatters_readings_by_their_rate_of_change():
    car, recording, start, _ = driving("car")
    _, truth = replay(car, recording, start, {"timestamp_jitter": 0.004}, seed=2)
    r, read = bare("car")["yaw_rate"], truth.readings["yaw_rate"]
    rate = np.gradient(r, recording.time)
    calm = np.abs(np.gradient(rate, recording.time)) < np.percentile(np.abs(np.gradient(rate, recording.time)), 80)
    assert np.std((read - r)[calm]) == pytest.approx(0.004 * np.sqrt(np.mean(rate[calm] ** 2)), rel=0.2)


def test_dropped_rows_repeat_the_reading_before_them_exactly():
    car, recording, start, _ = driving("car")
    read, _ = replay(car, recording, start, {"dropped_samples": 0.2}, noise=1.0, seed=1)
    whole, _ = replay(car, recording, start, noise=1.0, seed=1)
    held = np.diff(read["yaw_rate"]) == 0.0
    assert np.mean(held) == pytest.approx(0.2, abs=0.05)
    assert all(np.array_equal(np.diff(read[name]) == 0.0, held) for name in ("v_x", "a_x", "a_y"))
    kept = np.flatnonzero(~held) + 1
    assert np.array_equal(read["a_y"][kept], whole["a_y"][kept])
    assert not np.any(np.diff(read["steer"])[held & (np.diff(whole["steer"]) != 0.0)] == 0.0)


def test_small_effects_and_wanted_ones_act_together():
    car, recording, start, _ = driving("car")
    small = replace(car, small={"steering_ratio": 1.01, "yaw_rate_bias": 0.002, "steering_rate_limit": 0.8})
    wanted = {"steering_ratio": 1.1, "yaw_rate_bias": 0.01, "steering_rate_limit": 0.4}
    together = {"steering_ratio": 1.111, "yaw_rate_bias": 0.012, "steering_rate_limit": 0.4}
    _, found = replay(small, recording, start, wanted)
    _, expected = replay(car, recording, start, together)
    assert found.effects == pytest.approx(together)
    assert all(np.allclose(found.readings[name], expected.readings[name], atol=1e-9) for name in READ)
