"""What a diagnosis starts from: excerpts of long recordings, zones about effects that nothing is said of."""

from dataclasses import replace

import numpy as np
import pytest
from driven import without
from gap_cases import CAR, NUMBERS, lap, nominal

from greybox_id.datasets.recording import Recording
from greybox_id.gap.estimation.axes import nuisances, shifting
from greybox_id.gap.estimation.preparing import excerpt, prepare, thinned, with_direction
from greybox_id.models.effects import EFFECTS, vocabulary
from greybox_id.models.parameter import Stated
from greybox_id.models.vehicle import ChosenModel, Vehicle


def recording(rows, step=0.01, name="long"):
    return Recording(name, step * np.arange(rows), {"v_x": np.arange(rows, dtype=float)})


def test_a_short_recording_is_examined_whole():
    own = [recording(900), recording(100)]
    assert excerpt(own, 1000) == own


@pytest.mark.parametrize("rows", [30_000, 360_000])
def test_of_a_long_recording_blocks_are_examined_that_are_spread_evenly(rows):
    found = excerpt([recording(rows)], 24_000)
    assert 0.8 * 24_000 <= sum(len(own) for own in found) <= 1.2 * 24_000
    begins = np.array([own["v_x"][0] for own in found])
    assert begins[0] == 0
    assert found[-1]["v_x"][-1] == rows - 1
    assert np.all(np.diff(begins) > 0)
    assert all(np.all(np.diff(own["v_x"]) == 1) for own in found)  # none of them has a join


def test_of_many_short_recordings_some_are_examined_whole():
    found = excerpt([recording(1000, name=f"lap{k}") for k in range(50)], 10_000)
    assert len(found) == 10
    assert {len(own) for own in found} == {1000}


def test_of_fast_recordings_rows_are_left_out_evenly_but_no_motion_and_no_run():
    own = recording(6000, 0.005)
    own = replace(own, hold="linear", runs=((0, 2500), (2500, 6000)))
    (found,) = thinned([own], 1500)
    assert len(found) == 1500
    assert [stop - start for start, stop in found.runs] == [625, 875]
    assert set(np.diff(found["v_x"][:625])) == {4.0}
    assert found["v_x"][625] == 2500
    (found,) = thinned([own], 100)
    assert found.sample_time == pytest.approx(0.05)
    held = replace(own, hold="zero")
    assert thinned([held], 100) == [held]
    assert thinned([own], 6000) == [own]


def test_exact_vehicles_have_no_zones_and_toleranced_ones_have_narrow_ones():
    tolerant = Vehicle("car", {**NUMBERS, "m": Stated(NUMBERS["m"].value, 4.0)})
    own = [lap(seconds=4.0)]
    exact, loose = (prepare(nominal(vehicle=v), own, EFFECTS, v) for v in (CAR, tolerant))
    assert nuisances(exact.everything, EFFECTS, shifting(exact.everything)) == ()
    zones = {axis.name: axis for axis in nuisances(loose.everything, EFFECTS, shifting(loose.everything))}
    for name in ("steering_ratio", "yaw_rate_scale", "grip_scale", "yaw_inertia"):
        typical = abs(EFFECTS[name].typical - float(EFFECTS[name].parameter.array))
        assert zones[name].mean == float(EFFECTS[name].parameter.array)
        assert zones[name].sd == pytest.approx(0.05 * typical)
    assert zones["imu_lever_arm"].sd < 0.01 * (NUMBERS["l_f"].value + NUMBERS["l_r"].value)


def test_what_is_believed_of_an_effect_of_the_model_is_a_tolerance():
    stated = {"steering_delay": Stated(0.03, 0.004), "motor_lag": Stated(0.1)}
    car = replace(CAR, model=ChosenModel("single_track", effects=stated))
    found = prepare(nominal(effects=stated, vehicle=car), [lap(seconds=4.0)], EFFECTS, car).everything
    free = {axis.name: axis for axis in nuisances(found, EFFECTS, shifting(found))}
    assert (free["steering_delay"].mean, free["steering_delay"].sd) == (0.03, 0.004)
    assert "motor_lag" not in free


def test_the_direction_of_a_sensor_of_v_y_has_a_tolerance_where_numbers_have():
    tolerant, recordings = Vehicle("car", {**NUMBERS, "m": Stated(NUMBERS["m"].value, 4.0)}), [lap(seconds=4.0)]
    stated, effects = with_direction(tolerant, vocabulary(), nominal(), recordings)
    assert stated.effects["velocity_mount_yaw"].sd == 0.005
    assert set(effects) == {*vocabulary(), "velocity_mount_yaw"}


@pytest.mark.parametrize(
    ("vehicle", "effects", "read"),
    [
        (None, vocabulary(), True),
        (CAR, vocabulary(), True),
        (Vehicle("car", {"m": Stated(1.0, 0.1)}, {"velocity_mount_yaw": Stated(sd=0.02)}), vocabulary(), True),
        (Vehicle("car", {"m": Stated(1.0, 0.1)}), {"steering_lag": EFFECTS["steering_lag"]}, True),
        (Vehicle("car", {"m": Stated(1.0, 0.1)}), vocabulary(), False),
    ],
    ids=["no file", "exact", "stated", "other effects are asked for", "v_y is not read"],
)
def test_else_it_is_as_it_was(vehicle, effects, read):
    one = lap(seconds=4.0) if read else without(lap(seconds=4.0), "v_y")
    assert with_direction(vehicle, effects, nominal(), [one]) == (vehicle, effects)
