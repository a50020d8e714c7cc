"""How exactly a vehicle is known: tolerances, as its file states them, and true vehicles drawn within them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from types import MappingProxyType

import numpy as np

from .car import VirtualCar
from .effects import ALL

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
"""Of these only delays exist, no advances: true ones are half-normal."""


@dataclass(frozen=True)
class Tolerances:
    """Standard deviations about what is stated.

    Attributes
    ----------
    parameters : sd by parameter, SI units.
    effects : sd by effect, about its null.
    """

    parameters: Mapping[str, float]
    effects: Mapping[str, float]


EXACT = Tolerances(MappingProxyType({}), MappingProxyType({}))
"""All is known."""


def tolerances(car: VirtualCar) -> Tolerances:
    """Tolerances usual for a vehicle of its class."""
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
    """A true vehicle behind a stated one: its parameters lie within tolerances, and small effects are there.

    Values are drawn from normal distributions cut at 2.5 sd; delays and lags are never negative.
    """
    own = tolerances(car)

    def about(sd: float) -> float:
        return sd * float(np.clip(rng.standard_normal(), -2.5, 2.5))

    p = dict(car.parameters)
    for name, sd in own.parameters.items():
        p[name] += about(sd)
    small = {}
    for name, sd in own.effects.items():
        drawn = about(sd)
        small[name] = ALL[name].null + (abs(drawn) if name in _POSITIVE else drawn)
    return replace(car, parameters=p, small=small)


def vehicle_file_text(car: VirtualCar, tolerances: Tolerances | None = None) -> str:
    """What is stated of a vehicle, as the text of a vehicle file (TOML).

    Parameters
    ----------
    car : as stated, not the true one.
    tolerances : sds to state with it; None states none.
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
