"""Size, time scale and weight of a vehicle, in which manoeuvres, drivers and magnitudes are expressed."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from math import sqrt

G = 9.81
"""Gravity, m/s^2."""

PARAMETERS = (
    *("m", "I_z", "l_f", "l_r", "h_cg", "track_f", "track_r", "wheel_radius"),
    *("B_f", "C_f", "D_f", "E_f", "B_r", "C_r", "D_r", "E_r", "c_0", "c_1", "c_2"),
    *("drive_split_front", "brake_split_front", "force_per_unit"),
)
"""Parameters that a vehicle must state to be simulated."""

_CAR = 2.76
"""Wheelbase of the full-size car to which times are scaled, m."""


@dataclass(frozen=True)
class Scale:
    """Size and time scale of a vehicle.

    Attributes
    ----------
    length : wheelbase, m.
    time : duration of what takes a full-size car one second, s (Froude: root of the length).
    weight : N.
    top_speed : a brisk speed on a test track, m/s.
    least_speed : least speed while driving, m/s.
    grip : largest steady lateral acceleration, m/s^2.
    drive, brake : largest accelerations that leave the wheels some of their grip, m/s^2.
    understeer : steering angle per lateral acceleration, beyond wheelbase over radius, rad s^2/m.
    peak_slip : slip angle of the front tyres beyond which the force hardly grows, rad.
    steer_max : rad.
    yaw_noise, accel_noise : sd of the gyro, rad/s, and of the accelerometer, m/s^2.
    """

    length: float
    time: float
    weight: float
    top_speed: float
    least_speed: float
    grip: float
    drive: float
    brake: float
    understeer: float
    peak_slip: float
    steer_max: float
    yaw_noise: float
    accel_noise: float


def scale(p: Mapping[str, float], top_speed: float, steer_max: float, noise: Mapping[str, float]) -> Scale:
    """Size and time scale of a vehicle.

    Parameters
    ----------
    p : `PARAMETERS`, SI units.
    top_speed : m/s.
    steer_max : rad.
    noise : sd of sensors by signal, of which yaw_rate and a_y are used.
    """
    length = p["l_f"] + p["l_r"]
    grip = G * min(p["D_f"], p["D_r"])
    slope_f, slope_r = (p[f"B_{axle}"] * p[f"C_{axle}"] * p[f"D_{axle}"] for axle in "fr")

    def traction(front: float) -> float:
        """Acceleration at which the first axle slides, for this split of the force."""
        shares = ((p["l_r"] / length, front), (p["l_f"] / length, 1.0 - front))
        return grip * min(load / share for load, share in shares if share > 0)

    return Scale(
        length=length,
        time=sqrt(length / _CAR),
        weight=p["m"] * G,
        top_speed=top_speed,
        least_speed=0.28 * top_speed,
        grip=grip,
        drive=min(0.5 * traction(p["drive_split_front"]), 0.35 * G),
        brake=min(0.7 * traction(p["brake_split_front"]), 0.7 * G),
        understeer=(1.0 / slope_f - 1.0 / slope_r) / G,
        peak_slip=2.6 * p["D_f"] / slope_f,
        steer_max=steer_max,
        yaw_noise=noise.get("yaw_rate", 0.01),
        accel_noise=noise.get("a_y", 0.15),
    )
