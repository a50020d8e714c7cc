"""Every effect on equations of motion against a simulator that shares no code with them.

What an effect does to a reading is compared with what it does in the reference vehicle, relative to its size there.
Rows are 10 ms apart. The 1:10 car is stiff: segments of 10 ms would leave it a per mille from the truth without any
effect, so its are shorter.
"""

from functools import cache, partial

import numpy as np
import pytest
from driving import driven, on_vehicle
from reference_manoeuvres import manoeuvre
from reference_vehicle import FULL_SIZE_CAR, RACER
from reference_vehicle import simulate as finely_simulated
from reference_vehicle import simulate_lateral as finely_simulated_lateral

from greybox_id.models.effects import EFFECTS
from greybox_id.models.longitudinal import longitudinal
from greybox_id.models.single_track import lateral, single_track

FINE = 2e-4
"""Step of the reference, s: half of it changes what an effect does by less than 4e-4 of it."""
simulate, simulate_lateral = partial(finely_simulated, fine=FINE), partial(finely_simulated_lateral, fine=FINE)
VEHICLES = {"full-size": (FULL_SIZE_CAR, 0.01), "1:10": (RACER, 0.0025)}
CLOSE = 0.01
"""Root mean square of what is left, over that of the effect's influence."""
LESS_CLOSE = {
    "wind_gust": 0.025,  # the air speed leaves out the vehicle's own v_y
    "motor_saturation": 0.02,  # corners rounded by 1 %
    "steering_rate_limit": 0.02,  # corners rounded by 1 %
    "steering_jerk_limit": 0.02,  # corners rounded by 1 %
    "sensor_quantisation": 0.05,  # one command stands in a rounded corner
}
PLAIN = 2e-3
"""Influences smaller than this, relative to the reading, are not compared."""
MAGNITUDES = {
    "full-size": {},
    "1:10": {
        "aero_drag": 0.02, "rolling_resistance": 1.0, "downforce": 0.05, "tyre_relaxation": 0.1, "cog_shift": 0.015,
        "wind_gust": 2.0, "imu_lever_arm": 0.05, "velocity_lever_arm": 0.05, "motor_saturation": 1.0,
        "steering_rate_limit": 2.0, "steering_backlash": 0.02, "brake_bias": 0.3,
    },
}  # fmt: skip  # those that are not typical
SECOND = {
    "full-size": {
        "motor_saturation_v_b": 15.0,
        "wind_direction": 1.0,
        "tyre_temperature_E_0": 2e4,
        "grip_scale_slope": 0.3,
    },
    "1:10": {"motor_saturation_v_b": 2.5, "wind_direction": 1.0, "tyre_temperature_E_0": 30.0, "grip_scale_slope": 1.0},
}
STATISTICS = ("timestamp_jitter", "dropped_samples")
SETTLED = 150
"""Rows after which it no longer matters that a model's roll starts at its steady state for v_x yaw_rate."""
MOTION = [name for name in EFFECTS if name not in STATISTICS]
ON_SINGLE_TRACK = [name for name in MOTION if EFFECTS[name].concerns(single_track())]


@cache
def commands(vehicle, name="mixed"):
    return manoeuvre(name, VEHICLES[vehicle][0], duration=6.0, rate=100.0)


def without_drive(vehicle, name):
    """The speed is given, and no wheel driven."""
    return {key: values for key, values in commands(vehicle, name).items() if key != "drive"}


@cache
def nominal(vehicle, name="mixed", hold="zero"):
    given = commands(vehicle, name)
    return simulate(VEHICLES[vehicle][0], given, start=(given["v_x"][0], 0, 0), hold=hold)


@cache
def nominal_lateral():
    return simulate_lateral(FULL_SIZE_CAR, without_drive("full-size", "mixed"))


def with_effect(model, name, vehicle):
    """The model with an effect of plain magnitude, and the same for the reference."""
    effect = EFFECTS[name]
    magnitude = MAGNITUDES[vehicle].get(name, effect.typical)
    second = {own.name: SECOND[vehicle].get(own.name, float(own.array)) for own in effect.others}
    changed = model + effect.at(magnitude)
    changed = changed.with_parameters(*(changed[key].with_value(value) for key, value in second.items()))
    return changed, {name: magnitude, **second}


def far(found, truth, bare, close=CLOSE):
    """Readings on which an effect's influence is plain, but not what it is in the reference; and the plain ones."""
    wrong, plain = {}, []
    for name, values in found.items():
        influence = np.sqrt(np.mean((truth[name] - bare[name])[SETTLED:] ** 2))
        if influence > PLAIN * np.sqrt(np.mean(bare[name] ** 2)):
            plain.append(name)
            left = np.sqrt(np.mean((values - truth[name])[SETTLED:] ** 2)) / influence
            if left > close:
                wrong[name] = left
    return wrong, plain


@pytest.mark.parametrize("vehicle", VEHICLES)
@pytest.mark.parametrize("name", ON_SINGLE_TRACK)
def test_an_effect_on_the_single_track_does_what_it_does_in_the_reference(name, vehicle):
    numbers, longest = VEHICLES[vehicle]
    model, lacking = with_effect(on_vehicle(single_track(), numbers), name, vehicle)
    driving = "brake_in_turn" if name == "brake_bias" else "mixed"
    given, bare = commands(vehicle, driving), nominal(vehicle, driving)
    start = {"v_x": given["v_x"][0], "v_y": 0.0, "yaw_rate": 0.0}
    truth = simulate(numbers, given, lacking, start=tuple(start.values()))
    wrong, plain = far(driven(model, given, start, longest=longest), truth, bare, LESS_CLOSE.get(name, CLOSE))
    assert plain
    assert not wrong


SPEED_READ = ("sensor_latency_vx", "wheel_speed_scale")
LATERAL = [name for name in MOTION if EFFECTS[name].concerns(lateral()) and name not in SPEED_READ]


@pytest.mark.parametrize("name", LATERAL)
def test_an_effect_on_the_lateral_model_does_what_it_does_in_the_reference(name):
    model, lacking = with_effect(on_vehicle(lateral(), FULL_SIZE_CAR), name, "full-size")
    given = without_drive("full-size", "mixed")
    truth = simulate_lateral(FULL_SIZE_CAR, given, lacking)
    found = driven(model, given, {"v_y": 0.0, "yaw_rate": 0.0})
    wrong, plain = far(found, truth, nominal_lateral(), LESS_CLOSE.get(name, CLOSE))
    assert plain
    assert not wrong


@pytest.mark.parametrize("name", SPEED_READ)
def test_a_speed_that_is_an_input_was_read_by_the_sensor_that_is_late_or_scaled(name):
    """The model sees what the sensor read, and drives as the reference does at its true speed."""
    model, lacking = with_effect(on_vehicle(lateral(), FULL_SIZE_CAR), name, "full-size")
    given = without_drive("full-size", "brake_in_turn")
    truth = simulate_lateral(FULL_SIZE_CAR, given, lacking)
    as_read = {**given, "v_x": truth["v_x"]}
    bare = driven(on_vehicle(lateral(), FULL_SIZE_CAR), as_read, {"v_y": 0.0, "yaw_rate": 0.0})
    found = driven(model, as_read, {"v_y": 0.0, "yaw_rate": 0.0})
    for output, values in found.items():
        influence = np.abs(truth[output] - bare[output])[SETTLED:-10]
        assert np.max(np.abs(values - truth[output])[SETTLED:-10]) < 0.05 * np.max(influence)


@cache
def straight():
    """Commands on a level, straight road, and how the reference drives by them."""
    turned = commands("full-size")
    given = {**turned, "steer": np.zeros(len(turned["time"])), "road_slope": np.zeros(len(turned["time"]))}
    return given, simulate(FULL_SIZE_CAR, given, start=(given["v_x"][0], 0.0, 0.0))


LONGITUDINAL = [name for name in MOTION if EFFECTS[name].concerns(longitudinal()) and name != "grip_scale"]
"""Grip acts along where brakes reach the road's friction, which the reference has none of: test_longitudinal.py."""


@pytest.mark.parametrize("name", LONGITUDINAL)
def test_an_effect_on_the_longitudinal_model_does_what_it_does_in_the_reference(name):
    numbers = FULL_SIZE_CAR | {"I_w": 0.0, "drive_lag": 0.0}
    model, lacking = with_effect(on_vehicle(longitudinal(), numbers), name, "full-size")
    given, bare = straight()
    truth = simulate(FULL_SIZE_CAR, given, lacking, start=(given["v_x"][0], 0.0, 0.0))
    found = driven(model, given, {"v_x": given["v_x"][0]})
    wrong, plain = far(found, truth, bare, LESS_CLOSE.get(name, CLOSE))
    assert plain
    assert not wrong


@pytest.mark.parametrize("name", ["steering_lag", "steering_rate_limit", "steering_backlash", "motor_lag"])
def test_commands_that_run_straight_between_rows_are_followed_as_well(name):
    model, lacking = with_effect(on_vehicle(single_track(), FULL_SIZE_CAR), name, "full-size")
    given = commands("full-size")
    start = {"v_x": given["v_x"][0], "v_y": 0.0, "yaw_rate": 0.0}
    truth = simulate(FULL_SIZE_CAR, given, lacking, start=tuple(start.values()), hold="linear")
    found = driven(model, given, start, hold="linear")
    wrong, plain = far(found, truth, nominal("full-size", "mixed", "linear"), LESS_CLOSE.get(name, CLOSE))
    assert plain
    assert not wrong


STIFF = [
    *(("tyre_relaxation", length, 0.05) for length in (0.02, 0.06)),  # 1 ms and 3 ms at 20 m/s
    *(("tyre_relaxation", length, 0.01) for length in (0.15, 0.4, 1.2)),
    *(("steering_lag", lag, 0.02) for lag in (0.001, 0.003)),
    *(("steering_lag", lag, 0.002) for lag in (0.01, 0.1)),
    *(("motor_lag", lag, 0.02) for lag in (0.001, 0.01, 0.3)),
]


@pytest.mark.parametrize(("name", "magnitude", "close"), STIFF)
def test_lags_much_shorter_than_a_row_are_followed_as_well(name, magnitude, close):
    """States only: accelerations are read just after the commands, 10 microseconds here, at once in the reference."""
    model = on_vehicle(single_track(), FULL_SIZE_CAR) + EFFECTS[name].at(magnitude)
    given = commands("full-size")
    start = {"v_x": given["v_x"][0], "v_y": 0.0, "yaw_rate": 0.0}
    truth = simulate(FULL_SIZE_CAR, given, {name: magnitude}, start=tuple(start.values()))
    found, bare = driven(model, given, start), nominal("full-size")
    for state in ("v_x",) if name == "motor_lag" else ("v_y", "yaw_rate"):
        influence = np.sqrt(np.mean((truth[state] - bare[state]) ** 2))
        assert np.sqrt(np.mean((found[state] - truth[state]) ** 2)) < close * influence
