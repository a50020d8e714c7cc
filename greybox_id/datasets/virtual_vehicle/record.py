"""The vehicle as the simulation sees it: one record of numbers, those stated, those of its effects and derived ones."""

from __future__ import annotations

from collections.abc import Mapping
from math import atan, pi, sin

import numpy as np

from .car import VirtualCar
from .compiled import Car
from .effects import OF_THE_VEHICLE, OUTSIDE, SECOND
from .forms import CHOICES, Forms
from .scale import PARAMETERS, G
from .tyres import fitted

_DERIVED = (
    *("L", "understeer", "top_speed", "steer_max", "I_w", "load_f", "load_r", "time", "brake_max"),
    *("weight_along", "weight_across", "loads_shift"),
    *("peak_t_f", "slide_t_f", "slide_f", "peak_t_r", "slide_t_r", "slide_r"),
    *("slope_fit_f", "peak_fit_f", "slope_fit_r", "peak_fit_r"),
    *("outside", "spread"),
)
FIELDS = (*PARAMETERS, *OF_THE_VEHICLE, *SECOND, *(f"form_{name}" for name in CHOICES), *_DERIVED)
_RECORD = np.dtype([(name, np.float64) for name in FIELDS])

_THROUGH_ACCELERATION = (
    *("load_sensitivity", "longitudinal_load_transfer", "steering_compliance", "rear_compliance", "sloshing_load"),
)
"""What makes forces depend on accelerations, which then have to be found together."""
_WHEEL_INERTIA = 0.007
"""Of one wheel over mass times squared wheel radius, where the vehicle does not state it."""


def record(car: VirtualCar, magnitudes: Mapping[str, float], forms: Forms) -> Car:
    """The record of a vehicle with effects, all of them at the magnitudes that `effects.complete` gives."""
    size = car.size
    p = {name: car.parameters[name] for name in PARAMETERS}
    p["l_f"], p["l_r"] = p["l_f"] - magnitudes["cog_shift"], p["l_r"] + magnitudes["cog_shift"]
    L = p["l_f"] + p["l_r"]
    values = {
        **p,
        **{name: magnitudes[name] for name in (*OF_THE_VEHICLE, *SECOND)},
        **{f"form_{name}": number for name, number in forms.numbers().items()},
        "L": L,
        "understeer": size.understeer,
        "top_speed": size.top_speed,
        "steer_max": size.steer_max,
        "time": size.time,
        "brake_max": size.brake,
        "weight_along": G * sin(magnitudes["road_slope"]),
        "weight_across": G * sin(magnitudes["road_bank"]),
        "loads_shift": float(
            forms.stiffness == "degressive"
            or forms.geometry == "each_wheel"
            or any(magnitudes[name] != 0.0 for name in _THROUGH_ACCELERATION)
        ),
        "I_w": car.parameters.get("I_w", _WHEEL_INERTIA * p["m"] * p["wheel_radius"] ** 2),
        "load_f": 0.5 * p["m"] * G * p["l_r"] / L,
        "load_r": 0.5 * p["m"] * G * p["l_f"] / L,
        "outside": float(any(magnitudes[name] != OUTSIDE[name].null for name in OUTSIDE)),
        "spread": float(forms.geometry == "each_wheel"),
    }
    for axle in "fr":
        B, C, E = p[f"B_{axle}"], p[f"C_{axle}"], p[f"E_{axle}"]
        peak_t, slide_t, slide = _shape(B, C, E)
        slope, peak, peak_t = fitted(forms.numbers()["tyre"], B, C, E, peak_t, slide_t, slide)
        values |= {f"peak_t_{axle}": peak_t, f"slide_t_{axle}": slide_t, f"slide_{axle}": slide}
        values |= {f"slope_fit_{axle}": slope, f"peak_fit_{axle}": peak}
    made: Car = np.zeros(1, _RECORD)[0]
    for name in FIELDS:
        made[name] = values[name]
    return made


def _shape(B: float, C: float, E: float) -> tuple[float, float, float]:
    """Where the magic formula peaks, where it has slid, and its share of the peak there; slips times B C."""
    slips = np.linspace(0.01, 60.0, 6000)
    shares = np.sin(C * np.arctan(slips - E * (slips - np.arctan(slips))))
    top = int(np.argmax(shares))
    peak_t = max(C * float(slips[top]) if shares[top] > 0.995 else C * B * pi / 4, 2.05)
    slide = float(sin(C * atan(4 * slips[top] - E * (4 * slips[top] - atan(4 * slips[top])))))
    return peak_t, 4.0 * peak_t, max(slide, 0.7)
