"""Names of measured signals, their SI units and whether they change sign when left and right are swapped.

ISO 8855 axes: x forward, y left, z up; yaw and steer positive to the left. `a_x` and `a_y` are what an
accelerometer at the centre of gravity reads (specific force); on a flat road a_y = dv_y/dt + yaw_rate v_x.
"""

from dataclasses import dataclass


@dataclass(frozen=True)
class Signal:
    """One kind of measured quantity.

    Attributes
    ----------
    name : of the signal in recordings and models.
    unit : SI unit in pint's spelling; recordings hold nothing else.
    about : meaning, for people.
    mirrors : whether the sign changes under reflection in the vehicle's x-z plane.
    """

    name: str
    unit: str
    about: str
    mirrors: bool = False


_WHEELS = {"fl": "front left", "fr": "front right", "rl": "rear left", "rr": "rear right"}

SIGNALS: dict[str, Signal] = {
    signal.name: signal
    for signal in (
        Signal("v_x", "m/s", "longitudinal velocity"),
        Signal("v_y", "m/s", "lateral velocity", mirrors=True),
        Signal("yaw_rate", "rad/s", "yaw rate", mirrors=True),
        Signal("yaw_acceleration", "rad/s^2", "yaw acceleration", mirrors=True),
        Signal("roll_rate", "rad/s", "roll rate", mirrors=True),
        Signal("curvature", "1/m", "curvature of the path, left positive", mirrors=True),
        Signal("a_x", "m/s^2", "longitudinal specific force"),
        Signal("a_y", "m/s^2", "lateral specific force", mirrors=True),
        Signal("sideslip", "rad", "sideslip angle atan2(v_y, v_x)", mirrors=True),
        Signal("steer", "rad", "road-wheel steering angle", mirrors=True),
        Signal("steer_measured", "rad", "measured road-wheel steering angle, if steer holds the command", mirrors=True),
        Signal("motor_current", "A", "motor current; a negative one brakes"),
        Signal("drive_force", "N", "drive force command; negative values brake"),
        Signal("ax_cmd", "m/s^2", "commanded longitudinal acceleration"),
        Signal("throttle", "1", "throttle command, 1 is full; negative values brake if there is no brake signal"),
        Signal("brake", "1", "brake command, 1 full"),
        Signal("road_slope", "rad", "road slope, uphill positive"),
        Signal("roll", "rad", "roll angle", mirrors=True),
        Signal("pitch", "rad", "pitch angle"),
        Signal("yaw", "rad", "yaw angle", mirrors=True),
        Signal("x", "m", "position along the map's x axis"),
        Signal("y", "m", "position along the map's y axis", mirrors=True),
        Signal("latitude", "deg", "geographic latitude (WGS 84)"),
        Signal("longitude", "deg", "geographic longitude (WGS 84)"),
        *(Signal(f"wheel_speed_{c}", "rad/s", f"wheel speed {w}") for c, w in _WHEELS.items()),
        *(Signal(f"wheel_speed_{w}", "rad/s", f"wheel speed {w}") for w in ("left", "right")),
    )
}

COMMANDS = ("steer", "motor_current", "drive_force", "ax_cmd", "throttle", "brake")
"""Commands of a driver or controller: they may be constant, zero, saturated or held without a fault."""
DRIVE_SIGNALS = ("drive_force", "ax_cmd", "motor_current", "throttle")
"""Signals that may describe the drive; the first one recorded is used."""
SD = "sd_"
"""Prefix of the column with a signal's standard deviation row by row."""
ANGLES_AROUND = ("yaw",)
"""Angles that wrap after a full turn."""


def unit_of(name: str, otherwise: str = "1") -> str:
    """SI unit of a signal; `otherwise` if the name is not in `SIGNALS`."""
    return SIGNALS[name].unit if name in SIGNALS else otherwise


QUANTITIES = {
    "F": "N", "M": "N m", "a": "m/s^2", "gravity": "m/s^2", "alpha": "rad", "peak": "N", "drive": "N",
    "inertial": "kg", "yaw": "rad/s",
}  # fmt: skip
"""First part of a quantity's symbol -> SI unit: F_yf is a force, alpha_r an angle; others are dimensionless."""


def unit_of_quantity(name: str) -> str:
    """SI unit of an intermediate quantity of the equations, by its symbol."""
    return SIGNALS[name].unit if name in SIGNALS else QUANTITIES.get(name.partition("_")[0], "1")
