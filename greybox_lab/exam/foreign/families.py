"""Families of foreign vehicles: their simulators, their use, and the effects that they can have.

Withheld effects have the names and magnitudes of the vocabulary. They change the numbers of a vehicle
(`double_track.FIELDS`), which each simulator converts to its own.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from greybox_id.base.errors import BadInput

from ...virtual.virtual_vehicle import EFFECTS as VOCABULARY
from ...virtual.virtual_vehicle import OUTSIDE as KNOWN_OUTSIDE
from ...virtual.virtual_vehicle import Entry, VirtualCar
from ...virtual.virtual_vehicle.drive import combined
from ...virtual.virtual_vehicle.effects import OF_THE_SENSORS
from ...virtual.virtual_vehicle.layout import Row
from ..answers import Tier
from ..plan import Counts, Planned, dealt
from .double_track import DoubleTrack
from .slipx_car import SlipxCar
from .suspended_car import NATURE, SuspendedCar
from .vehicles import Draw, Reality, drawn_double_track, drawn_slipx, drawn_suspended

_FACTORS = {
    "grip_scale": ("mu_f", "mu_r", "slope_f", "slope_r"),
    "front_stiffness": ("slope_f",),
    "rear_stiffness": ("slope_r",),
    "mass_change": ("m",),
    "yaw_inertia": ("I_z",),
    "steering_ratio": ("steer_ratio",),
    "motor_gain": ("drive_gain",),
}
"""Effect -> numbers that are multiplied by its magnitude."""
_SUMMANDS = {
    "tyre_relaxation": "relaxation",
    "combined_slip": "combined",
    "load_sensitivity": "load_exponent",
    "longitudinal_load_transfer": "height",
    "tyre_temperature": "temperature",
    "roll_dynamics": "roll_gradient",
    "steering_delay": "steer_delay",
    "steering_lag": "steer_lag",
    "steering_offset": "steer_offset",
    "steering_backlash": "steer_backlash",
    "motor_lag": "drive_lag",
    "brake_bias": "brake_bias",
    "aero_drag": "c_2",
    "rolling_resistance": "c_0",
    "road_slope": "slope",
    "road_bank": "bank",
    "wind_gust": "wind",
    "downforce": "downforce",
}
"""Effect -> number to which its magnitude is added."""
_LIMITS = {"steering_rate_limit": "steer_rate", "motor_saturation": "drive_most"}
_ONES = ("steer_ratio", "drive_gain")

_OUTSIDE = (
    Entry("brake_pull", "1", 0.0, "share by which the left brakes give more force", 0.25, 0.7, sides="both",
          resembles=("steering_offset",)),
    Entry("soft_side", "1", 0.0, "share of their stiffness that the tyres of the left side have lost to low pressure",
          0.2, 0.45, resembles=("front_stiffness", "steering_offset")),
    Entry("aligning_compliance", "rad", 0.0, "angle by which the steering yields under a front lateral force of half "
        "the weight",
          0.006, 0.02, resembles=("front_stiffness",)),
    Entry("roll_steer", "rad", 0.0, "steering angle of the rear wheels per g of lateral acceleration", 0.006, 0.02,
          sides="both", resembles=("rear_stiffness",)),
    Entry("assist_fade", "1", 0.0, "share of the steering that the assistance takes back at speed", 0.12, 0.3,
          resembles=("steering_ratio",)),
    Entry("locked_axle", "1", 0.0, "degree to which the rear wheels are locked together", 0.4, 1.0),
    Entry("camber_thrust", "1", 0.0, "lateral force of leaning wheels divided by their load, at one g of lateral "
                                     "acceleration", 0.1, 0.3, sides="both"),
    Entry("crosswind", "1", 0.0, "standard deviation of the lateral force of gusts, divided by the "
                                 "weight", 0.015, 0.04),
    Entry("sinking_voltage", "1/min", 0.0, "share of the driving force lost per minute", 0.12, 0.3,
          resembles=("motor_gain",)),
    Entry("floor_patches", "1", 0.0, "share of the friction lost where the floor is worn", 0.15, 0.35,
          resembles=("grip_scale",)),
)  # fmt: skip
_SENSORS_OUTSIDE = (
    *("gyro_g_sensitivity", "gyro_drift", "gyro_compression", "accel_drift", "accel_cross_axis", "wheel_imbalance"),
    *("wheel_pulses", "slip_speed_error", "dead_stretches"),
)
OUTSIDE = {entry.name: entry for entry in _OUTSIDE} | {name: KNOWN_OUTSIDE[name] for name in _SENSORS_OUTSIDE}
"""Effects outside the vocabulary."""
ENTRIES = VOCABULARY | OUTSIDE

OF_SENSORS = tuple(name for name in OF_THE_SENSORS if name in ENTRIES)
"""Effects of the sensors, which are available for all simulators."""
NOT_OF_SLIPX = ("load_sensitivity", "tyre_temperature", "downforce", "brake_bias")
"""Effects that SlipX lacks: its height shifts loads in both directions; no warm tyres, no lift, motor braking."""


def magnitude(name: str, car: VirtualCar, rng: np.random.Generator) -> float:
    """A plausible and detectable magnitude."""
    return float(ENTRIES[name].draw(car.size, car.kind, rng))


def withheld(numbers: Mapping[str, float], effects: Mapping[str, float], car: VirtualCar) -> dict[str, float]:
    """The numbers of a vehicle with effects; effects of sensors are ignored.

    Parameters
    ----------
    numbers : of the vehicle without them.
    effects : magnitudes, and further parameters of effects.
    car : determines size and speed.
    """
    size, result = car.size, dict(numbers)
    for name, value in effects.items():
        for number in _FACTORS.get(name, ()):
            result[number] = result.get(number, 1.0 if number in _ONES else 0.0) * value
        if name in _SUMMANDS:
            result[_SUMMANDS[name]] = result.get(_SUMMANDS[name], 0.0) + value
        if name in _LIMITS:
            result[_LIMITS[name]] = value
        if name == "cog_shift":
            result["l_f"], result["l_r"] = result["l_f"] - value, result["l_r"] + value
        if name in OUTSIDE and name not in OF_SENSORS:
            result[name] = value
    result["temperature_energy"] = effects.get("tyre_temperature_E_0", 1.4 * size.weight)
    result["drive_corner"] = effects.get("motor_saturation_v_b", 0.6 * size.top_speed)
    result["wind_direction"] = effects.get("wind_direction", 0.0)
    result["roll_frequency"] = effects.get("roll_frequency", 1.5)
    result["roll_damping"] = effects.get("roll_damping", 0.3)
    return result


def together(*several: Mapping[str, float]) -> dict[str, float]:
    """Effects acting together: factors are multiplied, offsets added, and of limits the smallest holds."""
    outside = {name: value for item in several for name, value in item.items() if name in OUTSIDE}
    return combined(*({k: v for k, v in item.items() if k not in OUTSIDE} for item in several)) | outside


Build = Callable[[Mapping[str, float], Row], Reality]


@dataclass(frozen=True)
class Family:
    """A family of foreign vehicles.

    Attributes
    ----------
    draw : draws a vehicle.
    build : numbers, and gusts of unit variance -> simulator with that vehicle.
    effects, outside : effects that its vehicles can have.
    nature : effects of the vocabulary that all its vehicles have.
    rough : whether the file that is handed out has larger errors than stated, see `roughened`.
    """

    draw: Draw
    build: Build
    effects: tuple[str, ...]
    outside: tuple[str, ...]
    nature: tuple[str, ...] = ()
    rough: bool = False


def _double_track(tyre: int, name: str) -> Family:
    return Family(drawn_double_track(tyre, name), DoubleTrack, tuple(VOCABULARY), tuple(OUTSIDE))


_SLIPX = Family(
    drawn_slipx,
    lambda numbers, _: SlipxCar(numbers),
    tuple(name for name in VOCABULARY if name not in NOT_OF_SLIPX),
    tuple(name for name in OUTSIDE if name in OF_SENSORS or name in ("locked_axle", "sinking_voltage")),
)

NOT_OF_SPRINGS = (*NATURE, "tyre_temperature", "motor_saturation", "wind_gust")
"""Effects that are inherent to a car with suspension, and those for which it has no parameter."""
_SUSPENDED = Family(
    drawn_suspended,
    lambda numbers, _: SuspendedCar(numbers),
    tuple(name for name in VOCABULARY if name not in NOT_OF_SPRINGS),
    (),
    NATURE,
    True,
)
PEAKS, WHEELBASE, INERTIA = (0.05, 0.10), (0.02, 0.04), (0.10, 0.20)
"""Relative errors of numbers in a rough file: tyres' peaks, and either the wheelbase or I_z."""


def roughened(car: VirtualCar, rng: np.random.Generator) -> tuple[VirtualCar, tuple[str, ...]]:
    """A vehicle as a rough file states it, and effects of the vocabulary that are equivalent to its errors."""
    p, off = dict(car.parameters), list[str]()
    sides = rng.choice([-1.0, 1.0], 3)
    for axle, side in zip("fr", sides, strict=False):
        factor = 1.0 + side * float(rng.uniform(*PEAKS))
        p[f"D_{axle}"], p[f"B_{axle}"] = p[f"D_{axle}"] * factor, p[f"B_{axle}"] / factor  # slopes are easily measured
    if sides[0] == sides[1]:
        off.append("grip_scale")
    if rng.random() < 0.5:
        factor = 1.0 + sides[2] * float(rng.uniform(*WHEELBASE))
        p |= {name: p[name] * factor for name in ("l_f", "l_r")}
    else:
        p["I_z"] *= 1.0 + sides[2] * float(rng.uniform(*INERTIA))
        off.append("yaw_inertia")
    return replace(car, parameters={name: float(f"{item:.6g}") for name, item in p.items()}), tuple(off)


VIRTUAL = "workshop"
"""Name used as a family for the virtual vehicle with tolerances and other forms."""

FAMILIES: Mapping[str, Family] = {
    "fiala": _double_track(0, "fiala"),
    "exponential": _double_track(1, "exponential"),
    "tmeasy": _double_track(2, "tmeasy"),
    "rational": _double_track(3, "rational"),
    "dugoff": _double_track(4, "dugoff"),
    "slipx": _SLIPX,
    "suspended": _SUSPENDED,
}
"""All families; the double tracks are named by the shape of their tyres."""
DEVELOPMENT = ("fiala", "exponential")
"""Families for the calibration of thresholds."""
EXAMINATION = ("tmeasy", "rational", "dugoff", "slipx")
"""Families for examinations only."""
ROUGH = ("suspended",)
"""Families with rough files, for examinations only."""
SETS: Mapping[str, tuple[str, ...]] = {"development": DEVELOPMENT, "examination": EXAMINATION, "rough": ROUGH}


def families(target: Sequence[str]) -> tuple[str, ...]:
    """Names of families, with sets expanded.

    Raises
    ------
    BadInput : if a family is unknown.
    """
    result: dict[str, None] = {}
    for name in target or ("examination",):
        if name not in FAMILIES and name not in SETS:
            raise BadInput(f'There is no family "{name}"; choose one of {", ".join((*SETS, *FAMILIES))}.')
        result |= dict.fromkeys(SETS.get(name, (name,)))
    return tuple(result)


def able(names: Sequence[str], effects: Sequence[str]) -> tuple[str, ...]:
    """The families that can have all of these effects."""
    return tuple(name for name in names if set(effects) <= {*FAMILIES[name].effects, *FAMILIES[name].outside})


def gusts(rows: int, seed: int) -> Row:
    """Gusts of unit variance, one per 20 ms, with a correlation time of 0.8 s; (rows,)."""
    rng, keeps = np.random.default_rng((seed, 7, 4099)), np.exp(-0.02 / 0.8)
    shocks, values = rng.standard_normal(rows), np.zeros(rows)
    for k in range(1, rows):
        values[k] = keeps * values[k - 1] + np.sqrt(1.0 - keeps**2) * shocks[k]
    return values


def dealt_out(counts: Counts, tier: Tier, seed: int, target: Sequence[str]) -> tuple[Planned, ...]:
    """Cases of an examination with foreign vehicles, each of a family that can have its effects.

    Parameters
    ----------
    counts : number of each kind.
    tier : of all of them.
    seed : of the plan.
    target : families or sets of them; by default those of the examination, and `VIRTUAL` for many effects.
    """
    virtual = tier == "many" and (not target or VIRTUAL in target)
    requested = [name for name in target if name != VIRTUAL]
    names = families(requested) if requested or not virtual or not target else ()
    known = [set(VOCABULARY)] * virtual + [set(FAMILIES[name].effects) for name in names]
    other = [set(OUTSIDE) & set(KNOWN_OUTSIDE)] * virtual + [set(FAMILIES[name].outside) for name in names]
    whole = any(item == set.union(*known) for item in known)
    effects = set.union(*known) if whole else set.intersection(*known)
    beyond = set.union(*other)
    cases = dealt(counts, tier, seed, [n for n in VOCABULARY if n in effects], [n for n in OUTSIDE if n in beyond])
    rng = np.random.default_rng((seed, 51151))
    result = []
    for item in cases:
        fit = able(names, item.effects)
        turn = virtual and (not fit or item.number % 2 == 0)  # half of them use the virtual vehicle
        result.append(replace(item, family="" if turn else str(rng.choice(fit))))
    return tuple(result)
