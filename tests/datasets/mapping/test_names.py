"""Names of columns, in the habits people have."""

import pytest

from greybox_id.datasets.mapping.names import guess


@pytest.mark.parametrize(
    ("name", "signal", "unit"),
    [
        ("vx", "v_x", ""),
        ("Vx_mps", "v_x", "m/s"),
        ("VehicleSpeed_kmh", "v_x", "km/h"),
        ("speed_km_h", "v_x", "km/h"),
        ("velocity_x", "v_x", ""),
        ("gyro_z", "yaw_rate", ""),
        ("yaw_rate_deg_s", "yaw_rate", "deg/s"),
        ("YawRate [°/s]", "yaw_rate", "deg/s"),
        ("psi_dot", "yaw_rate", ""),
        ("lat_acc", "a_y", ""),
        ("ay(g)", "a_y", "g"),
        ("SWA", "hand wheel", ""),
        ("Throttle Pos", "throttle", ""),
        ("BRAKEPRESSURE", "brake", ""),
        ("G Force Lat", "a_y", ""),
        ("GPS LonAcc", "a_x", ""),
        ("Lateral acceleration (G)", "a_y", "g"),
        ("Gyro Yaw Velocity", "yaw_rate", ""),
        ("curv", "curvature", ""),
        ("roll_rate", "roll_rate", ""),
        ("wheel_speed_left", "wheel_speed_left", ""),
        ("SteeringWheelAngle[deg]", "hand wheel", "deg"),
        ("delta", "steer", ""),
        ("time_ms", "time", "ms"),
        ("timestamp_ns", "time", "ns"),
        ("/vesc/odom.twist.twist.linear.x", "v_x", ""),
        ("/imu.angular_velocity.z", "yaw_rate", ""),
        ("ESP/LatAcc", "a_y", ""),
        ("WheelSpeed_FL", "wheel_speed_fl", ""),
        ("heading_deg", "yaw", "deg"),
        ("trajectory", "run", ""),
        ("acc x (IMU)", "a_x", ""),
        ("servo_position", "steer", ""),
        ("rpm_fl", "wheel_speed_fl", ""),
        ("wheel_rr_kmh", "wheel_speed_rr", "km/h"),
    ],
)
def test_what_a_name_says(name, signal, unit):
    found = guess(name)
    assert (found.signal, found.unit) == (signal, unit)


@pytest.mark.parametrize("name", ["battery", "temperature_max", "alpha1", "status", "from_yaw", "", "["])
def test_names_that_say_nothing(name):
    assert guess(name) is None


def test_a_wish_is_no_measurement():
    assert guess("/drive.drive.speed").wish
    assert guess("speed_cmd") is None or guess("speed_cmd").wish
