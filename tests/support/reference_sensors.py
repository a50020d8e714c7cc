"""What the sensors of the reference vehicle read: when, where they sit, what they add."""

import numpy as np

G = 9.81

SENSOR_EFFECTS = {
    "yaw_rate_bias": 0.0, "yaw_rate_scale": 1.0, "accel_bias_x": 0.0, "accel_bias_y": 0.0, "imu_mount_pitch": 0.0,
    "imu_mount_roll": 0.0, "imu_mount_yaw": 0.0, "imu_lever_arm": 0.0, "velocity_lever_arm": 0.0,
    "velocity_mount_yaw": 0.0, "wheel_speed_scale": 1.0, "sensor_latency_yaw": 0.0, "sensor_latency_vx": 0.0,
    "sensor_latency_imu": 0.0, "timestamp_jitter": 0.0, "dropped_samples": 0.0,
}  # fmt: skip


def instants(time, effects, rng):
    """True instant of every reading, by sensor; nothing is read before the first row."""
    moment = time + effects["timestamp_jitter"] * rng.standard_normal(len(time))
    late = {
        "v_x": effects["sensor_latency_vx"],
        "v_y": 0.0,
        "yaw_rate": effects["sensor_latency_yaw"] + effects["sensor_latency_imu"],
        "accelerations": effects["sensor_latency_imu"],
    }
    return {sensor: np.maximum(moment - latency, time[0]) for sensor, latency in late.items()}


def readings(true, when, effects, h_cg, rng):
    """Five channels as read, from true(name, instants) of the centre of gravity."""
    at, x = when["accelerations"], effects["imu_lever_arm"]
    a_x = true("a_x", at) - x * true("yaw_rate", at) ** 2
    a_y = true("a_y", at) + x * true("yaw_acceleration", at)
    a_y = a_y + G * true("roll", at) - h_cg * true("roll_acceleration", at)
    c, s = np.cos(effects["imu_mount_yaw"]), np.sin(effects["imu_mount_yaw"])  # the sensor is turned to the left
    late, turned = when["v_y"], effects["velocity_mount_yaw"]
    read = {
        "v_x": effects["wheel_speed_scale"] * true("v_x", when["v_x"]),
        "v_y": np.cos(turned) * (true("v_y", late) + effects["velocity_lever_arm"] * true("yaw_rate", late))
        - np.sin(turned) * true("v_x", late),
        "yaw_rate": effects["yaw_rate_scale"] * true("yaw_rate", when["yaw_rate"]) + effects["yaw_rate_bias"],
        "a_x": c * a_x + s * a_y - G * np.sin(effects["imu_mount_pitch"]) + effects["accel_bias_x"],
        "a_y": c * a_y - s * a_x + G * np.sin(effects["imu_mount_roll"]) + effects["accel_bias_y"],
    }
    dropped = rng.random(len(at)) < effects["dropped_samples"]
    dropped[0] = False
    last = np.maximum.accumulate(np.where(dropped, 0, np.arange(len(at))))
    return {name: values[last] for name, values in read.items()}
