"""Slopes and wind."""

from dataclasses import replace

import numpy as np
import pytest
from driving import driven, read

from greybox_id.models.effects import EFFECTS
from greybox_id.models.longitudinal import longitudinal
from greybox_id.models.single_track import G, single_track

STRAIGHT = {"steer": 0.0, "drive": 0.0}


def test_a_wind_as_fast_as_the_vehicle_leaves_no_drag_and_a_head_wind_four_times_as_much():
    for wind, times in ((20.0, 0.0), (0.0, 1.0), (-20.0, 4.0)):
        model = single_track() + EFFECTS["wind_gust"].at(wind)
        found = read(model, ("F_drag",), {"v_x": 20.0}, STRAIGHT, c_0=0.0)["F_drag"]
        assert found == pytest.approx(times * 0.45 * 20.0**2, abs=1e-3)


def test_a_wind_keeps_its_direction_while_the_vehicle_turns():
    model = single_track() + EFFECTS["wind_gust"].at(10.0)
    for yaw, direction, a_y in ((np.pi / 2, 0.0, -1), (0.0, np.pi / 2, 1), (np.pi, np.pi / 2, -1), (0.3, 0.3, 0)):
        found = read(model, ("a_y",), {"v_x": 20.0, "yaw": yaw}, STRAIGHT, wind_direction=direction)["a_y"]
        assert found == pytest.approx(a_y * 0.45 * np.hypot(20.0, 10.0) * 10.0 / 1450.0, abs=1e-6)


def test_the_heading_is_where_the_vehicle_has_turned():
    time = np.arange(200) / 100
    model = single_track() + EFFECTS["wind_gust"].at(0.0)
    turning = {"time": time, "steer": np.full(200, 0.02), "drive": np.zeros(200)}
    start = {"v_x": 20.0, "v_y": 0.0, "yaw_rate": 0.0}
    found = driven(replace(model, outputs=("yaw",)), turning, start)
    rate = driven(single_track(), turning, start)["yaw_rate"]
    steps = (rate[1:] + rate[:-1]) / 2 / 100
    np.testing.assert_allclose(found["yaw"], np.concatenate([[0.0], np.cumsum(steps)]), atol=1e-4)


@pytest.mark.parametrize("model", [single_track(), longitudinal()], ids=["single_track", "longitudinal"])
def test_an_accelerometer_does_not_see_gravity_along_a_slope(model):
    uphill = model + EFFECTS["road_slope"].at(0.05)
    given = {"steer": 0.0, "drive": 1.0, "road_slope": 0.0}
    flat, slope = (read(m, ("a_x", "gravity_x"), {"v_x": 20.0}, given) for m in (model, uphill))
    assert slope["gravity_x"] == pytest.approx(G * np.sin(0.05))
    if model.name == "single_track":
        assert slope["a_x"] == pytest.approx(flat["a_x"])


def test_a_bank_pulls_down_to_its_lower_side():
    time = np.arange(100) / 100
    straight = {"time": time, "steer": np.zeros(100), "drive": np.zeros(100)}
    start = {"v_x": 20.0, "v_y": 0.0, "yaw_rate": 0.0}
    found = driven(single_track() + EFFECTS["road_bank"].at(0.03), straight, start)
    assert np.all(found["v_y"][1:] < 0)
    assert found["a_y"][0] == pytest.approx(0.0)
    assert found["a_y"][-1] == pytest.approx(G * np.sin(0.03), rel=0.2)
