"""What sensors read instead."""

import numpy as np
import pytest
from driving import read

from greybox_id.models.effects import EFFECTS
from greybox_id.models.single_track import G, single_track

TURNING = {"v_x": 20.0, "v_y": -0.4, "yaw_rate": 0.3}
NAMES = ("v_x", "v_y", "yaw_rate", "a_x", "a_y")


def readings(*effects):
    model = single_track()
    for name, magnitude in effects:
        model = model + EFFECTS[name].at(magnitude)
    return read(model, NAMES, TURNING, {"steer": 0.05, "drive": -1.0})


BARE = readings()


def test_an_accelerometer_turned_to_the_left_reads_lateral_acceleration_forward():
    turned = readings(("imu_mount_yaw", np.pi / 2))
    assert turned["a_x"] == pytest.approx(BARE["a_y"])
    assert turned["a_y"] == pytest.approx(-BARE["a_x"])


def test_gravity_is_read_by_an_accelerometer_that_is_tilted():
    tilted = readings(("imu_mount_pitch", 0.02), ("imu_mount_roll", 0.03))
    assert tilted["a_x"] == pytest.approx(BARE["a_x"] - G * np.sin(0.02))
    assert tilted["a_y"] == pytest.approx(BARE["a_y"] + G * np.sin(0.03))


def test_a_sensor_forward_of_the_centre_of_gravity_reads_the_motion_there():
    forward = readings(("imu_lever_arm", 0.5), ("velocity_lever_arm", 0.8))
    assert forward["a_x"] == pytest.approx(BARE["a_x"] - 0.3**2 * 0.5)
    assert forward["v_y"] == pytest.approx(BARE["v_y"] + 0.3 * 0.8)
    both = readings(("velocity_lever_arm", 0.8), ("velocity_mount_yaw", 0.1))  # the motion there, along turned axes
    assert both["v_y"] == pytest.approx(np.cos(0.1) * forward["v_y"] - np.sin(0.1) * BARE["v_x"])
    double = readings(("imu_lever_arm", 1.0))
    assert double["a_y"] - BARE["a_y"] == pytest.approx(2 * (forward["a_y"] - BARE["a_y"]))


@pytest.mark.parametrize(("first", "second", "expected"), [
    ("yaw_rate_scale", "yaw_rate_bias", 0.3 * 1.05 + 0.02), ("yaw_rate_bias", "yaw_rate_scale", (0.3 + 0.02) * 1.05),
])  # fmt: skip
def test_sensors_act_in_the_order_in_which_they_were_added(first, second, expected):
    magnitudes = {"yaw_rate_scale": 1.05, "yaw_rate_bias": 0.02}
    found = readings((first, magnitudes[first]), (second, magnitudes[second]))
    assert found["yaw_rate"] == pytest.approx(expected)


def test_a_sensor_changes_no_reading_but_its_own():
    for name, own in (("yaw_rate_bias", "yaw_rate"), ("wheel_speed_scale", "v_x"), ("accel_bias_y", "a_y")):
        found = readings((name, EFFECTS[name].typical))
        assert {output for output in NAMES if found[output] != BARE[output]} == {own}
