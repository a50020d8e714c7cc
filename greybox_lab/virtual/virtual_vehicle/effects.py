"""Effects that the virtual vehicle may have and a nominal single-track model lacks, with magnitudes per class.

`EFFECTS` is the vocabulary of the diagnosis: the same names and meanings of magnitude. `OUTSIDE` are other effects, for
which the right answer is that the effect is unknown. They are implemented in `chassis`, `actuators`, `loop` and
`sensors`. Magnitudes raise the error of a nominal model's predictions over one second by between 0.2 and 5 sd of a
sensor's noise or slightly more, with typical noise.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from math import exp, inf, log
from typing import Literal

import numpy as np

from greybox_id.base.errors import BadInput

from .scale import G, Scale

Kind = Literal["racer", "car", "truck", "sports"]
"""Classes of vehicles by size."""

Sides = Literal["up", "down", "both"]
"""Side of its null on which an effect may lie."""

PER: Mapping[str, Callable[[Scale], float]] = {
    "one": lambda size: 1.0,
    "length": lambda size: size.length,
    "time": lambda size: size.time,
    "rate": lambda size: 1.0 / size.time,
    "weight": lambda size: size.weight,
    "speed": lambda size: size.top_speed,
    "weight over speed squared": lambda size: size.weight / size.top_speed**2,
    "drive": lambda size: size.drive,
    "gyro noise": lambda size: size.yaw_noise,
    "accelerometer noise": lambda size: size.accel_noise,
    "accelerometer tilt": lambda size: size.accel_noise / G,
    "turns": lambda size: size.top_speed / size.grip,
}
"""Quantities with which magnitudes scale."""


@dataclass(frozen=True)
class Entry:
    """An effect of the virtual vehicle.

    Attributes
    ----------
    name : of the effect.
    unit : of its magnitude.
    null : magnitude of the absent effect: 0, 1 for factors, infinity for limits.
    about : meaning of the magnitude.
    low, high : range of plausible and detectable distances from null, in units of `per`; for factors, 0.1 is 1.1 or
        1 / 1.1; for limits, the magnitude itself.
    per : a name of `PER`.
    sides : of its null.
    special : low and high of single classes.
    resembles : for effects outside the vocabulary, those within it that some recordings cannot distinguish from it.
    """

    name: str
    unit: str
    null: float
    about: str
    low: float
    high: float
    per: str = "one"
    sides: Sides = "up"
    special: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    resembles: tuple[str, ...] = ()

    def sizes(self, size: Scale, kind: str) -> tuple[float, float]:
        """Least and largest distance from null for a vehicle of a size and class."""
        low, high = self.special.get(kind, (self.low, self.high))
        per = PER[self.per](size)
        return low * per, high * per

    def at(self, deviation: float) -> float:
        """The magnitude at a deviation from null; negative deviations are below it."""
        if self.null == 0.0:
            return deviation
        if self.null == inf:
            return abs(deviation)
        return 1.0 + deviation if deviation >= 0.0 else 1.0 / (1.0 - deviation)

    def scaled(self, magnitude: float, factor: float, size: Scale, kind: str) -> float:
        """A magnitude with `factor` times the distance from null, limited to the plausible range; a limit is divided by
        `factor`.
        """
        low, high = self.sizes(size, kind)
        if self.null == inf:
            return min(max(magnitude / factor, low), high)
        away = magnitude if self.null == 0.0 else magnitude - 1.0 if magnitude >= 1.0 else 1.0 - 1.0 / magnitude
        return float(self.at(float(np.copysign(min(abs(away) * factor, high), away))))

    def ranges(self, size: Scale, kind: str) -> tuple[tuple[float, float], ...]:
        """Magnitudes for an examination, as one or two intervals (least, most)."""
        low, high = self.sizes(size, kind)
        up, down = (self.at(low), self.at(high)), (self.at(-high), self.at(-low))
        return {"up": (up,), "down": (down,), "both": (down, up)}[self.sides]

    def draw(self, size: Scale, kind: str, rng: np.random.Generator) -> float:
        """A random magnitude, whose distance from null is log-uniform."""
        low, high = self.sizes(size, kind)
        side = {"up": 1.0, "down": -1.0, "both": 1.0 if rng.random() < 0.5 else -1.0}[self.sides]
        return float(self.at(side * exp(rng.uniform(log(low), log(high)))))


_VEHICLE = (
    Entry("grip_scale", "1", 1.0, "factor on the friction of both axles", 0.07, 0.25, "one", "both"),
    Entry("front_stiffness", "1", 1.0, "factor on the slope of the front tyres", 0.1, 0.3, "one", "both"),
    Entry("rear_stiffness", "1", 1.0, "factor on the slope of the rear tyres", 0.1, 0.25, "one", "both"),
    Entry("tyre_relaxation", "m", 0.0, "relaxation length of the slip angle", 0.05, 0.22, "length"),
    Entry("combined_slip", "1", 0.0, "strength of the friction ellipse", 0.5, 1.2),
    Entry("load_sensitivity", "1", 0.0, "relative loss of a wheel's friction per relative growth of its "
                                        "load", 0.1, 0.35,
          special={"racer": (0.25, 0.6), "truck": (0.06, 0.25)}),
    Entry("longitudinal_load_transfer", "1", 0.0, "height of the centre of gravity (1: nominal height)", 0.3, 0.8),
    Entry("tyre_temperature", "1", 0.0, "share of the friction that warm tyres lose", 0.08, 0.3),
    Entry("mass_change", "1", 1.0, "factor on the mass and on the wheel loads", 0.03, 0.15, "one", "both"),
    Entry("cog_shift", "m", 0.0, "forward shift of the centre of gravity", 0.015, 0.05, "length", "both",
          special={"racer": (0.03, 0.09)}),
    Entry("yaw_inertia", "1", 1.0, "factor on the yaw inertia", 0.15, 0.6, "one", "both"),
    Entry("roll_dynamics", "rad s^2/m", 0.0, "roll angle per lateral acceleration", 0.0012, 0.006,
          special={"racer": (0.0015, 0.009)}),
    Entry("steering_delay", "s", 0.0, "pure delay of the command", 0.01, 0.04),
    Entry("steering_lag", "s", 0.0, "first-order time constant", 0.015, 0.06),
    Entry("steering_rate_limit", "rad/s", inf, "largest rate at the road wheels", 0.45, 1.3, "rate",
          special={"truck": (0.5, 1.6), "sports": (0.25, 0.8), "racer": (0.4, 1.2)}),
    Entry("steering_offset", "rad", 0.0, "added to the command", 0.005, 0.012, "one", "both",
          special={"racer": (0.005, 0.015)}),
    Entry("steering_ratio", "1", 1.0, "gain on the command", 0.04, 0.15, "one", "both"),
    Entry("steering_backlash", "rad", 0.0, "half width of the play", 0.0012, 0.006,
          special={"racer": (0.003, 0.015)}),
    Entry("motor_lag", "s", 0.0, "first-order time constant of drive and brake force", 0.03, 0.15,
          special={"racer": (0.03, 0.15)}),
    Entry("motor_saturation", "m/s^2", inf, "largest acceleration of the drive at low speed", 0.65, 1.1, "drive"),
    Entry("motor_gain", "1", 1.0, "gain on the drive command", 0.06, 0.2, "one", "both"),
    Entry("brake_bias", "1", 0.0, "added to the front axle's share of the braking force", 0.15, 0.35, "one", "both"),
    Entry("aero_drag", "N s^2/m^2", 0.0, "added to c_2", 0.006, 0.03, "weight over speed squared"),
    Entry("rolling_resistance", "N", 0.0, "added to c_0", 0.004, 0.02, "weight"),
    Entry("road_slope", "rad", 0.0, "slope of the road, uphill positive", 0.006, 0.03, "one", "both"),
    Entry("road_bank", "rad", 0.0, "bank of the road, left side up positive", 0.006, 0.03, "one", "both",
          special={"racer": (0.01, 0.04)}),
    Entry("wind_gust", "m/s", 0.0, "mean wind in the world frame", 0.2, 0.5, "speed"),
    Entry("downforce", "N s^2/m^2", 0.0, "aerodynamic load over speed squared", 0.1, 0.5, "weight over speed squared"),
)  # fmt: skip

_SENSORS = (
    Entry("yaw_rate_bias", "rad/s", 0.0, "added to the yaw rate", 0.5, 3.0, "gyro noise", "both"),
    Entry("yaw_rate_scale", "1", 1.0, "gain on the yaw rate", 0.02, 0.08, "one", "both"),
    Entry("accel_bias_x", "m/s^2", 0.0, "added to the longitudinal acceleration", 0.5, 2.5, "accelerometer noise",
          "both"),
    Entry("accel_bias_y", "m/s^2", 0.0, "added to the lateral acceleration", 0.5, 2.5, "accelerometer noise", "both"),
    Entry("imu_mount_pitch", "rad", 0.0, "pitch of the accelerometer", 0.5, 2.5, "accelerometer tilt", "both"),
    Entry("imu_mount_roll", "rad", 0.0, "roll of the accelerometer", 0.5, 2.5, "accelerometer tilt", "both"),
    Entry("imu_mount_yaw", "rad", 0.0, "yaw angle of the accelerometer, to the left", 0.02, 0.1, "one", "both"),
    Entry("imu_lever_arm", "m", 0.0, "accelerometer forward of the centre of gravity", 0.05, 0.25, "length", "both",
          special={"racer": (0.1, 0.4)}),
    Entry("velocity_lever_arm", "m", 0.0, "speed sensor forward of the centre of gravity", 0.04, 0.35, "length",
          "both"),
    Entry("wheel_speed_scale", "1", 1.0, "gain on the speed", 0.004, 0.02, "one", "both",
          special={"racer": (0.008, 0.04), "truck": (0.006, 0.03)}),
    Entry("sensor_latency_yaw", "s", 0.0, "latency of the yaw rate reading", 0.008, 0.04),
    Entry("sensor_latency_vx", "s", 0.0, "latency of the speed reading", 0.02, 0.1),
    Entry("sensor_latency_imu", "s", 0.0, "latency of yaw rate and accelerations", 0.008, 0.04),
    Entry("timestamp_jitter", "s", 0.0, "sd of the difference between a reading's time and its stamp", 0.0015, 0.006),
    Entry("dropped_samples", "1", 0.0, "share of rows at which sensors repeat their last reading", 0.03, 0.25),
)  # fmt: skip

_OUTSIDE_VEHICLE = (
    Entry("dragging_brake", "1", 0.0, "drag of the front left brake divided by the weight", 0.008, 0.025,
          resembles=("rolling_resistance", "steering_offset")),
    Entry("puncture", "1", 0.0, "share of its stiffness, grip and radius that the front right tyre has lost",
          0.12, 0.35, resembles=("front_stiffness",)),
    Entry("limited_slip", "1", 0.0, "share of an axle's driving force that goes to its slower wheel", 0.35, 0.9),
    Entry("torque_vectoring", "1", 0.0, "gain of a yaw moment towards the yaw rate that the steering asks for",
          0.4, 1.5),
    Entry("rear_steer", "1", 0.0, "ratio of rear to front road-wheel angle; above a third of top speed both turn to "
    "the same side",
          0.05, 0.15),
    Entry("steering_compliance", "rad", 0.0, "angle by which the front wheels yield under a lateral force as large as "
        "their load",
          0.004, 0.016, resembles=("front_stiffness",)),
    Entry("rear_compliance", "rad", 0.0, "angle by which the rear wheels yield under a lateral force as large as "
        "their load", 0.005, 0.014,
          resembles=("rear_stiffness",)),
    Entry("tyre_asymmetry", "1", 0.0, "share of grip and stiffness gained in left turns and lost in right ones",
          0.06, 0.2, sides="both"),
    Entry("variable_ratio", "1", 0.0, "extra steering gain at large angles", 0.15, 0.4,
          resembles=("steering_ratio",)),
    Entry("steering_asymmetry", "1", 0.0, "gain on the steering to the left, and loss on that to the right", 0.04, 0.15,
          sides="both", resembles=("steering_offset",)),
    Entry("ply_steer", "rad", 0.0, "steering offset at top speed; it grows with squared speed", 0.003, 0.012,
          sides="both", resembles=("steering_offset",)),
    Entry("steering_resonance", "1", 0.0,
          "share of the steering that passes through a linkage oscillating at 2.5 Hz (scaled to the car)",
          0.2, 0.7, resembles=("steering_lag",),
          special={"racer": (0.5, 1.0)}),
    Entry("drive_dead_zone", "1", 0.0, "dead zone of drive and brake forces, divided by the weight",
          0.015, 0.05),
    Entry("driveline_oscillation", "1", 0.0,
          "share of the force that passes through a shaft oscillating at 2 Hz (scaled to the car)",
          0.2, 0.7, resembles=("motor_lag",),
          special={"racer": (0.5, 1.0)}),
    Entry("battery_sag", "1/min", 0.0, "share of the driving force lost per minute", 0.1, 0.3,
          resembles=("motor_gain",)),
    Entry("brake_fade", "1", 0.0, "share of the braking force that hot brakes lose", 0.4, 0.8,
          resembles=("motor_gain",)),
    Entry("brake_cycling", "1", 0.0, "share of hard braking that is released 6 times a second (scaled to the car)",
          0.2, 0.6),
    Entry("stability_control", "1", 0.0,
          "gain of a control that brakes single wheels if the yaw rate deviates from the steering",
          0.4, 1.5),
    Entry("fuel_burn", "1/min", 0.0, "share of the mass lost per minute", 0.08, 0.2, resembles=("mass_change",)),
    Entry("sloshing_load", "1", 0.0, "share of the mass that sloshes sideways at 0.8 Hz (scaled to the car)",
          0.08, 0.25),
    Entry("road_undulation", "rad", 0.0, "largest slope of hills and dips, twenty wheelbases apart", 0.015, 0.05),
    Entry("slippery_patches", "1", 0.0, "share of the friction lost on patches of the road", 0.15, 0.35,
          resembles=("grip_scale",)),
    Entry("side_gusts", "m/s", 0.0, "sd of gusts that push and turn the vehicle", 0.35, 0.9, "speed"),
    Entry("aero_yaw", "1", 0.0, "yaw moment of the air per unit of sideslip at top speed, divided by weight times "
    "wheelbase",
          0.6, 1.8),
)  # fmt: skip

_OUTSIDE_SENSORS = (
    Entry("gyro_g_sensitivity", "rad s/m", 0.0, "error of the yaw rate reading per longitudinal acceleration",
          0.3, 1.5, "gyro noise", "both"),
    Entry("gyro_drift", "rad/s", 0.0, "sd of the drift of the yaw rate's bias after one minute", 2.0, 6.0, "gyro noise",
          resembles=("yaw_rate_bias",)),
    Entry("gyro_compression", "s/rad", 0.0, "compression k of the gyro: it reads tanh(k r) / k", 0.3, 0.7,
          "turns", resembles=("yaw_rate_scale",)),
    Entry("accel_drift", "m/s^2", 0.0, "sd of the drift of both accelerometers after one minute", 1.0, 3.5,
          "accelerometer noise", resembles=("accel_bias_x", "accel_bias_y")),
    Entry("accel_cross_axis", "1", 0.0, "share of a_y in the reading of a_x", 0.04, 0.12, "one", "both",
          resembles=("imu_mount_yaw",)),
    Entry("wheel_imbalance", "m/s^2", 0.0, "amplitude at top speed of a vibration once per wheel turn", 1.5, 5.0,
          "accelerometer noise"),
    Entry("wheel_pulses", "m/s", 0.0, "resolution of the speed reading, which is zero below ten steps", 0.01, 0.025,
          "speed"),
    Entry("slip_speed_error", "1", 0.0, "relative error of the speed reading per g of acceleration", 0.03, 0.1,
          resembles=("wheel_speed_scale",)),
    Entry("dead_stretches", "1", 0.0,
          "share of the time in which gyro and accelerometer freeze, half a second at once",
          0.03, 0.12, resembles=("dropped_samples",)),
)  # fmt: skip

EFFECTS = {entry.name: entry for entry in (*_VEHICLE, *_SENSORS)}
"""The effects of the vocabulary."""
OUTSIDE = {entry.name: entry for entry in (*_OUTSIDE_VEHICLE, *_OUTSIDE_SENSORS)}
"""Effects outside the vocabulary."""
ALL = {**EFFECTS, **OUTSIDE}
OF_THE_VEHICLE = tuple(entry.name for entry in (*_VEHICLE, *_OUTSIDE_VEHICLE))
OF_THE_SENSORS = tuple(entry.name for entry in (*_SENSORS, *_OUTSIDE_SENSORS))

SECOND = (
    "tyre_temperature_E_0",  # J
    "roll_frequency",  # Hz
    "roll_damping",  # 1
    "motor_saturation_v_b",  # m/s
    "wind_direction",  # rad, towards which it blows: 0 is along the vehicle at the first row
)
"""Further parameters of some effects, which can be given, too."""


def complete(effects: Mapping[str, float], size: Scale) -> dict[str, float]:
    """All effects at the given magnitudes or their nulls, and their further parameters.

    Raises
    ------
    BadInput : if a name is unknown.
    """
    if unknown := [name for name in effects if name not in ALL and name not in SECOND]:
        raise BadInput(f"The virtual vehicle has no effect {', '.join(unknown)}; it has {', '.join(ALL)}.")
    second = {
        "tyre_temperature_E_0": 1.4 * size.weight,  # 2e4 J for a full-size car
        "roll_frequency": 1.5,
        "roll_damping": 0.3,
        "motor_saturation_v_b": 0.6 * size.top_speed,
        "wind_direction": 0.0,
    }
    return {name: entry.null for name, entry in ALL.items()} | second | dict(effects)
