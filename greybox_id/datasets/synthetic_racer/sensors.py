"""What the synthetic racer's electronics make of its motion: filtered, late, biased and noisy samples at 20 Hz."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from scipy import constants
from scipy.signal import butter, lfilter

from .car import GRAVITY, STEP
from .track import Array

SAMPLE_TIME = 0.05
"""Of the file, s."""

RPM_PER_SPEED = 4244.0
"""Electrical revolutions per minute for 1 m/s."""

COLUMNS = ("t", "Speed", "accx", "accy", "yaw_rate", "steering_angle", "current", "pose_x", "pose_y", "yaw")
"""Columns of the files: s, electrical rpm, g, g, deg/s, rad, A, m, m, rad."""


@dataclass(frozen=True)
class Sensors:
    """Faults of the sensors in one run.

    Attributes
    ----------
    x_imu : distance of the IMU ahead of the centre of gravity, m.
    gyro_bias, offset_x, offset_y : rad/s; m/s^2.
    gyro_noise, accelerometer_noise : standard deviation at rest, rad/s and m/s^2.
    gyro_vibration, vibration_x, vibration_y : standard deviation that driving adds, rad/s and m/s^2.
    imu_cutoff, imu_delay : low-pass, Hz, and dead time, s.
    speed_cutoff, current_cutoff : low-pass, Hz.
    speed_noise : m/s, while the motor turns.
    current_noise, current_ripple : A, and per ampere, while current flows.
    pose_noise, yaw_noise, pose_delay : m, rad and s.
    """

    x_imu: float = -0.07
    gyro_bias: float = 0.027
    offset_x: float = -0.24
    offset_y: float = -0.15
    gyro_noise: float = 0.0015
    accelerometer_noise: float = 0.012
    gyro_vibration: float = 0.012
    vibration_x: float = 0.22
    vibration_y: float = 0.26
    imu_cutoff: float = 5.5
    imu_delay: float = 0.01
    speed_cutoff: float = 6.0
    current_cutoff: float = 25.0
    current_noise: float = 0.01
    current_ripple: float = 0.06
    speed_noise: float = 0.006
    pose_noise: float = 0.002
    yaw_noise: float = 0.003
    pose_delay: float = 0.03


def measure(truth: Mapping[str, Array], sensors: Sensors | None, rng: np.random.Generator) -> dict[str, Array]:
    """Sample a simulated drive as the car's electronics would.

    Parameters
    ----------
    truth : signals at every `STEP` as `simulate` returns them, SI units.
    sensors : faults; None samples the truth itself, at the centre of gravity.
    rng : source of the noise.

    Returns
    -------
    The columns of `COLUMNS` in the file's units, each (n,), time from 0 in steps of `SAMPLE_TIME`.
    """
    time = truth["time"]
    n = int(np.floor(time[-1] / SAMPLE_TIME + 1e-6)) + 1
    t = np.arange(n) * SAMPLE_TIME

    def sampled(name: str, delay: float = 0.0) -> Array:
        return np.asarray(np.interp(t - delay, time, truth[name]), dtype=float)

    if sensors is None:
        v, a_x, a_y, r = (sampled(k) for k in ("wheel_speed", "a_x", "a_y", "yaw_rate"))
        current, x, y, yaw = (sampled(k) for k in ("current", "x", "y", "yaw"))
    else:
        moving = np.tanh(np.abs(truth["v_x"]) / 0.4)
        roll, pitch, yaw_rate = truth["roll"], truth["pitch"], truth["yaw_rate"]
        # An accelerometer rolls and pitches with the body and feels gravity's share along its axes.
        f_x = (truth["a_x"] - sensors.x_imu * yaw_rate**2) * np.cos(pitch) - GRAVITY * np.sin(pitch)
        f_y = (truth["a_y"] + sensors.x_imu * truth["yaw_acceleration"]) * np.cos(roll) + GRAVITY * np.sin(roll)

        def imu(value: Array, offset: float, noise: float, vibration: float) -> Array:
            shaken = value + vibration * moving * _coloured(rng, len(value), 3.0)
            late = _low_pass(shaken, sensors.imu_cutoff, 2)
            read = np.interp(t - sensors.imu_delay, time, late, left=late[0])
            return np.asarray(read + offset + rng.normal(0.0, noise, n), dtype=float)

        a_x = imu(f_x, sensors.offset_x, sensors.accelerometer_noise, sensors.vibration_x)
        a_y = imu(f_y, sensors.offset_y, sensors.accelerometer_noise, sensors.vibration_y)
        r = imu(yaw_rate, sensors.gyro_bias, sensors.gyro_noise, sensors.gyro_vibration)
        v = np.interp(t, time, _low_pass(truth["wheel_speed"], sensors.speed_cutoff, 1))
        v = v + np.where(np.abs(v) > 0.02, rng.normal(0.0, sensors.speed_noise, n), 0.0)
        # Below this the speed estimator of a sensorless motor reports zero.
        v = np.where(np.abs(v) < 0.01, 0.0, v)
        current = np.interp(t, time, _low_pass(truth["current"], sensors.current_cutoff, 1))
        flows, ripple = np.abs(current) > 0.02, sensors.current_noise + sensors.current_ripple * np.abs(current)
        current = np.where(flows, current + rng.normal(0.0, 1.0, n) * ripple, 0.0)
        x = sampled("x", sensors.pose_delay) + rng.normal(0.0, sensors.pose_noise, n)
        y = sampled("y", sensors.pose_delay) + rng.normal(0.0, sensors.pose_noise, n)
        yaw = sampled("yaw", sensors.pose_delay) + rng.normal(0.0, sensors.yaw_noise, n)
    values = (
        t,
        v * RPM_PER_SPEED,
        a_x / constants.g,
        a_y / constants.g,
        np.rad2deg(r),
        sampled("steer_command"),
        current,
        x,
        y,
        np.arctan2(np.sin(yaw), np.cos(yaw)),
    )
    return dict(zip(COLUMNS, values, strict=True))


def _low_pass(values: Array, cutoff: float, order: int) -> Array:
    """Causal Butterworth filter at the simulation's rate, started at rest on the first value; cutoff in Hz."""
    b, a = butter(order, 2.0 * cutoff * STEP)
    return np.asarray(lfilter(b, a, values - values[0]) + values[0], dtype=float)


def _coloured(rng: np.random.Generator, n: int, cutoff: float) -> Array:
    """Noise of unit standard deviation below a cutoff, Hz: what road and driveline shake into the body."""
    b, a = butter(2, 2.0 * cutoff * STEP)
    # Noise bandwidth of a second-order Butterworth filter, in units of its cutoff.
    gain = np.sqrt(np.pi / (2.0 * np.sqrt(2.0)) * 2.0 * cutoff * STEP)
    return np.asarray(lfilter(b, a, rng.normal(0.0, 1.0, n)) / gain, dtype=float)
