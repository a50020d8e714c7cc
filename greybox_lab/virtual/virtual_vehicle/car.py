"""The stated virtual vehicle, random ones of four classes, and true ones within the tolerances of a file."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from types import MappingProxyType
from typing import get_args

import numpy as np

from greybox_id.base.errors import BadInput

from .effects import ALL, OUTSIDE, Kind
from .scale import PARAMETERS, G, Scale, scale

DRIVE_CHANNELS = ("ax_cmd", "motor_current", "drive_force")
"""Possible drive commands: m/s^2, A or N."""


@dataclass(frozen=True)
class VirtualCar:
    """A vehicle to simulate.

    Attributes
    ----------
    name : for people.
    kind : class of vehicle: racer (1:10), car, truck (and delivery van), sports (and formula cars).
    parameters : `scale.PARAMETERS` and, for rotating wheels, I_w [kg m^2]; SI units.
    drive_channel : signal of the drive command, to whose unit force_per_unit refers.
    noise : sd of each sensor by signal; v_y is missing if it has no sensor.
    steer_max : rad.
    top_speed : brisk speed on a test track, m/s.
    small : magnitudes of small effects, as drawn by `toleranced`.

    Raises
    ------
    BadInput : if a parameter is missing or the drive channel is unknown.
    """

    name: str
    kind: Kind
    parameters: Mapping[str, float]
    drive_channel: str
    noise: Mapping[str, float]
    steer_max: float
    top_speed: float
    small: Mapping[str, float] = field(default_factory=dict)

    def __post_init__(self) -> None:
        if lacking := [name for name in PARAMETERS if name not in self.parameters]:
            raise BadInput(f"{self.name} does not state {', '.join(lacking)}, which its simulation needs.")
        if self.drive_channel not in DRIVE_CHANNELS:
            raise BadInput(f"The drive channel is one of {', '.join(DRIVE_CHANNELS)}, not {self.drive_channel}.")
        for name in ("parameters", "noise", "small"):
            object.__setattr__(self, name, MappingProxyType(dict(getattr(self, name))))

    @property
    def size(self) -> Scale:
        """Size and time scale."""
        return scale(self.parameters, self.top_speed, self.steer_max, self.noise)

    @property
    def measures_v_y(self) -> bool:
        """Whether the vehicle has a sensor of v_y."""
        return "v_y" in self.noise

    @property
    def outside(self) -> tuple[str, ...]:
        """Names of effects outside the vocabulary that this vehicle may have."""
        return tuple(OUTSIDE)

    def magnitude(self, effect: str, rng: np.random.Generator) -> float:
        """A plausible and detectable magnitude of an effect, in or outside the vocabulary.

        Raises
        ------
        BadInput : if the effect is unknown.
        """
        if effect not in ALL:
            raise BadInput(f"The virtual vehicle has no effect {effect}; it has {', '.join(ALL)}.")
        return ALL[effect].draw(self.size, self.kind, rng)


_Range = tuple[float, float]

_CLASSES: Mapping[Kind, Mapping[str, _Range]] = {
    "racer": {
        "m": (2.9, 4.4), "L": (0.30, 0.36), "front_load": (0.46, 0.54), "gyration": (0.42, 0.55),
        "h_cg": (0.045, 0.075), "track": (0.7, 0.8), "wheel": (0.15, 0.17), "B_f": (4.5, 8.0), "C": (1.35, 1.6),
        "D": (0.8, 1.0), "E": (0.0, 0.3), "c_0": (0.015, 0.05), "c_1": (0.0, 0.2), "drag": (0.01, 0.04),
        "brake": (0.48, 0.56), "steer": (0.38, 0.45),
        "top": (6.5, 8.0), "v": (0.02, 0.05), "yaw": (0.015, 0.04), "a": (0.15, 0.35), "amps": (0.6, 2.8),
    },
    "car": {
        "m": (950.0, 2100.0), "L": (2.45, 3.0), "front_load": (0.47, 0.60), "gyration": (0.46, 0.52),
        "h_cg": (0.5, 0.68), "track": (0.54, 0.59), "wheel": (0.11, 0.12), "B_f": (8.0, 12.0), "C": (1.3, 1.55),
        "D": (0.88, 1.05), "E": (0.0, 0.3), "c_0": (0.010, 0.017), "c_1": (0.0, 0.0), "drag": (0.018, 0.035),
        "brake": (0.58, 0.70), "steer": (0.5, 0.6), "top": (26.0, 33.0), "v": (0.015, 0.05), "yaw": (0.003, 0.01),
        "a": (0.06, 0.18), "amps": (10.0, 30.0),
    },
    "truck": {
        "m": (2600.0, 17000.0), "L": (3.3, 5.2), "front_load": (0.38, 0.52), "gyration": (0.45, 0.55),
        "h_cg": (0.8, 1.4), "track": (0.42, 0.50), "wheel": (0.095, 0.11), "B_f": (6.0, 9.0), "C": (1.25, 1.45),
        "D": (0.72, 0.88), "E": (0.0, 0.3), "c_0": (0.006, 0.012), "c_1": (0.0, 0.0), "drag": (0.006, 0.02),
        "brake": (0.5, 0.62), "steer": (0.55, 0.65), "top": (20.0, 24.0), "v": (0.03, 0.08), "yaw": (0.002, 0.006),
        "a": (0.05, 0.15), "amps": (20.0, 60.0),
    },
    "sports": {
        "m": (550.0, 1250.0), "L": (2.3, 2.8), "front_load": (0.42, 0.50), "gyration": (0.42, 0.48),
        "h_cg": (0.3, 0.46),
        "track": (0.55, 0.62), "wheel": (0.11, 0.13), "B_f": (9.0, 13.0), "C": (1.35, 1.6), "D": (1.15, 1.5),
        "E": (0.0, 0.3), "c_0": (0.011, 0.018), "c_1": (0.0, 0.0), "drag": (0.03, 0.07), "brake": (0.54, 0.64),
        "steer": (0.35, 0.5), "top": (32.0, 40.0), "v": (0.02, 0.06), "yaw": (0.004, 0.012), "a": (0.12, 0.3),
        "amps": (15.0, 40.0),
    },
}  # fmt: skip
"""Ranges. front_load: share of the weight; gyration: radius over sqrt(l_f l_r) is twice this; track and wheel radius
over the wheelbase; c_0 over weight; drag: force over weight at top speed; v, yaw, a: sds of sensors."""

_ODDS = {"racer": 0.3, "car": 0.35, "truck": 0.15, "sports": 0.2}
_TITLES = {"racer": "1:10 racer", "car": "car", "truck": "truck", "sports": "sports car"}


def random_vehicle(seed: int, kind: Kind | None = None) -> VirtualCar:
    """A vehicle with random typical parameters of its class; it understeers at least slightly.

    Parameters
    ----------
    seed : of the vehicle.
    kind : class; random if None.
    """
    rng = np.random.default_rng((seed, 7201))
    kinds: tuple[Kind, ...] = get_args(Kind)
    drawn: Kind = kinds[int(rng.choice(len(kinds), p=[_ODDS[k] for k in kinds]))]
    kind = drawn if kind is None else kind
    draw = {name: float(rng.uniform(*limits)) for name, limits in _CLASSES[kind].items()}
    m, L = draw["m"], draw["L"]
    l_r = draw["front_load"] * L
    l_f = L - l_r
    D_f, B_f, C_f = draw["D"], draw["B_f"], draw["C"]
    D_r = D_f * float(rng.uniform(1.01, 1.06))
    C_r = C_f * float(rng.uniform(0.98, 1.02))
    B_r = B_f * C_f * D_f / (C_r * D_r) * float(rng.uniform(1.06, 1.3))  # stiffer rear, for understeer
    channel = str(rng.choice(["motor_current", "ax_cmd", "drive_force"], p=[0.5, 0.3, 0.2]))
    if kind != "racer":
        channel = str(rng.choice(["ax_cmd", "drive_force", "motor_current"], p=[0.6, 0.3, 0.1]))
    per_unit = {"ax_cmd": m, "drive_force": 1.0, "motor_current": draw["amps"]}[channel]
    noise = {"v_x": draw["v"], "v_y": draw["v"], "yaw_rate": draw["yaw"], "a_x": draw["a"], "a_y": draw["a"]}
    if rng.random() < 0.5:
        del noise["v_y"]
    driven = {"racer": [0.5, 0.0], "car": [0.0, 0.4], "truck": [0.0, 0.0], "sports": [0.0, 0.0]}[kind]
    parameters = {
        "m": m, "I_z": (2.0 * draw["gyration"]) ** 2 * m * l_f * l_r, "l_f": l_f, "l_r": l_r, "h_cg": draw["h_cg"],
        "track_f": draw["track"] * L, "track_r": draw["track"] * L, "wheel_radius": draw["wheel"] * L,
        "B_f": B_f, "C_f": C_f, "D_f": D_f, "E_f": draw["E"], "B_r": B_r, "C_r": C_r, "D_r": D_r, "E_r": draw["E"],
        "c_0": draw["c_0"] * m * G, "c_1": draw["c_1"], "c_2": draw["drag"] * m * G / draw["top"] ** 2,
        "drive_split_front": float(rng.choice(driven)), "brake_split_front": draw["brake"], "force_per_unit": per_unit,
    }  # fmt: skip
    return VirtualCar(
        name=f"{_TITLES[kind]} {seed}",
        kind=kind,
        parameters={name: _rounded(value) for name, value in parameters.items()},
        drive_channel=channel,
        noise={name: _rounded(sd, 2) for name, sd in noise.items()},
        steer_max=_rounded(draw["steer"], 2),
        top_speed=_rounded(draw["top"], 3),
    )


def _rounded(value: float, digits: int = 5) -> float:
    """Rounded as on a data sheet."""
    return float(f"{value:.{digits}g}")


_RELATIVE = {
    "m": 0.003, "I_z": 0.02, "l_f": 0.003, "l_r": 0.003,
    "B_f": 0.015, "C_f": 0.005, "D_f": 0.01, "B_r": 0.015, "C_r": 0.005, "D_r": 0.01,
    "c_0": 0.04, "c_2": 0.04, "force_per_unit": 0.007,
}  # fmt: skip
_ABSOLUTE = {"E_f": 0.05, "E_r": 0.05, "brake_split_front": 0.01}
_SOURCES = {
    "m": "scale", "I_z": "estimate from mass and wheelbase", "l_f": "axle loads", "l_r": "axle loads",
    "c_0": "coast-down", "c_2": "coast-down", "force_per_unit": "acceleration runs",
    "brake_split_front": "data sheet",
    "B_f": "tyre bench", "C_f": "tyre bench", "D_f": "tyre bench", "E_f": "tyre bench",
    "B_r": "tyre bench", "C_r": "tyre bench", "D_r": "tyre bench", "E_r": "tyre bench",
}  # fmt: skip
_POSITIVE = ("steering_lag", "steering_delay", "motor_lag", "sensor_latency_imu", "sensor_latency_vx")
"""Effects that exist only as delays, not as advances: their true values are half-normal."""


@dataclass(frozen=True)
class Tolerances:
    """Standard deviations of true values around stated ones.

    Attributes
    ----------
    parameters : sd by parameter, SI units.
    effects : sd by effect, around its null.
    """

    parameters: Mapping[str, float]
    effects: Mapping[str, float]


EXACT = Tolerances(MappingProxyType({}), MappingProxyType({}))
"""No tolerances."""


def tolerances(car: VirtualCar) -> Tolerances:
    """Usual tolerances for a vehicle of its class."""
    size, p = car.size, car.parameters
    small = car.kind == "racer"
    values = {name: share * abs(p[name]) for name, share in _RELATIVE.items()} | dict(_ABSOLUTE)
    if 0.0 < p["drive_split_front"] < 1.0:
        values["drive_split_front"] = 0.01
    effects = {
        "steering_lag": 0.002 if small else 0.003,
        "steering_delay": 0.002,
        "steering_offset": 0.0006,
        "steering_ratio": 0.004,
        "motor_lag": 0.004 if small else 0.006,
        "road_slope": 0.001,
        "road_bank": 0.001,
        "yaw_rate_bias": 0.1 * size.yaw_noise,
        "accel_bias_x": 0.12 * size.accel_noise,
        "accel_bias_y": 0.12 * size.accel_noise,
        "imu_lever_arm": 0.006 * size.length,
        "sensor_latency_imu": 0.001,
        "sensor_latency_vx": 0.002,
    }
    return Tolerances(
        {name: _short(sd) for name, sd in values.items()}, {name: _short(sd) for name, sd in effects.items()}
    )


def toleranced(car: VirtualCar, rng: np.random.Generator) -> VirtualCar:
    """A true vehicle for a stated one: parameters within tolerances, and small effects.

    Values are drawn from normal distributions truncated at 2.5 sd; delays and lags are never negative.
    """
    value = tolerances(car)

    def about(sd: float) -> float:
        return sd * float(np.clip(rng.standard_normal(), -2.5, 2.5))

    p = dict(car.parameters)
    for name, sd in value.parameters.items():
        p[name] += about(sd)
    small = {}
    for name, sd in value.effects.items():
        drawn = about(sd)
        small[name] = ALL[name].null + (abs(drawn) if name in _POSITIVE else drawn)
    return replace(car, parameters=p, small=small)


def vehicle_file_text(car: VirtualCar, tolerances: Tolerances | None = None) -> str:
    """Text of a vehicle file (TOML) with the stated numbers.

    Parameters
    ----------
    car : as stated, not the true one.
    tolerances : sds to state; none if None.
    """
    known = tolerances or EXACT
    lines = [
        f'name = "{car.name}"',
        f'about = "A vehicle that exists in simulation. Its drive channel is {car.drive_channel}."',
        f"steer_max = {car.steer_max!r}",
        "",
        "[parameters]",
    ]
    for name, value in car.parameters.items():
        sd, source = known.parameters.get(name), _SOURCES.get(name, "data sheet")
        lines.append(
            f"{name} = {float(value)!r}"
            if sd is None
            else f'{name} = {{ value = {float(value)!r}, sd = {float(sd)!r}, source = "{source}" }}'
        )
    if known.effects:
        lines += ["", "[effects]"]
        lines += [f'{name} = {{ sd = {float(sd)!r}, source = "workshop" }}' for name, sd in known.effects.items()]
    lines += ["", "[noise]", *(f"{name} = {float(sd)!r}" for name, sd in car.noise.items())]
    return "\n".join(lines) + "\n"


def _short(value: float) -> float:
    return float(f"{value:.3g}")
