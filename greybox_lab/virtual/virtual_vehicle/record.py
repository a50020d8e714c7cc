"""Mathematical forms of the vehicle's parts: those of the models, or others in common use.

Magnitudes of effects mean the same in every form: a time constant is the delay of slow signals, a relaxation length
refers to the static wheel load, tyre curves are fitted to the magic formula.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields
from math import atan, pi, sin

import numpy as np

from greybox_id.base.errors import BadInput

from .car import VirtualCar
from .effects import OF_THE_VEHICLE, OUTSIDE, SECOND
from .layout import Car
from .scale import PARAMETERS, G
from .tyres import fitted

CHOICES: dict[str, tuple[str, ...]] = {
    "tyre": ("pacejka", "tmeasy", "brush", "dugoff", "tanh"),
    "stiffness": ("proportional", "degressive"),
    "relaxation": ("slip_angle", "force", "load_dependent"),
    "combined": ("ellipse", "lower_peak"),
    "load_sensitivity": ("linear", "power"),
    "temperature": ("work", "heat_balance"),
    "steering_lag": ("first_order", "second_order"),
    "rate_limit": ("hard", "servo"),
    "backlash": ("play", "soft_play"),
    "saturation": ("corner", "torque_curve"),
    "roll": ("sensor_only", "carries_load"),
    "wheels": ("forces", "rotating"),
    "geometry": ("axles", "each_wheel"),
    "drag": ("quadratic", "other_powers"),
    "wind": ("drag_area", "side_area"),
    "latency": ("constant", "jittering"),
}
"""Choices of forms; that of the models first."""
EFFECTS_ALREADY = ("latency", "stiffness")
"""A jittering latency, and a stiffness that grows less than its load, are effects of the vocabulary, so they are never
drawn as forms."""
FAR_OFF = {"tyre": ("dugoff",)}
"""Forms that no magic formula approximates: with the same stiffness and friction, Dugoff's curve differs by 5 % of the
peak. A file that states numbers within a percent cannot describe such a tyre; these are only chosen by name."""


@dataclass(frozen=True)
class Forms:
    """A form for each part.

    Attributes
    ----------
    tyre : lateral force over slip angle: magic formula; TMeasy (Rill, Road Vehicle Dynamics, Sec. 3.4); brush with
        parabolic pressure (Pacejka, Tire and Vehicle Dynamics, Sec. 3.2); Dugoff, Fancher & Segel (SAE 700377); tanh.
    stiffness : cornering stiffness proportional to wheel load; growing less than load (Pacejka, Sec. 4.3.1).
    relaxation : of the slip angle; of the lateral force; of the slip angle over a length that grows with wheel load.
    combined : friction ellipse on the force; on the tyre's peak, its slope unchanged (Hindiyeh & Gerdes 2014).
    load_sensitivity : friction falls linearly with wheel load; as a power of it.
    temperature : friction falls with total friction work; each axle has a heat balance with cooling.
    steering_lag : first order; second order, critically damped, with equal delay.
    rate_limit : a hard limit; a PI servo with limited rate.
    backlash : play; play with elastic stops.
    saturation : constant force, then constant power; a smooth torque curve between the two.
    roll : affects only the accelerometer; wheel loads follow the roll angle, too.
    wheels : longitudinal forces are as commanded; wheels rotate, and forces follow from their slip.
    geometry : slip at the centre of axles; at each wheel, steered halfway between parallel and Ackermann.
    drag : constant rolling resistance and drag with squared speed; growing resistance, and a lower power of drag.
    wind : the same area from the front and from the side; half as much again from the side.
    latency : constant; random around its mean.
    """

    tyre: str = "pacejka"
    stiffness: str = "proportional"
    relaxation: str = "slip_angle"
    combined: str = "ellipse"
    load_sensitivity: str = "linear"
    temperature: str = "work"
    steering_lag: str = "first_order"
    rate_limit: str = "hard"
    backlash: str = "play"
    saturation: str = "corner"
    roll: str = "sensor_only"
    wheels: str = "forces"
    geometry: str = "axles"
    drag: str = "quadratic"
    wind: str = "drag_area"
    latency: str = "constant"

    def __post_init__(self) -> None:
        for field in fields(self):
            if (form := getattr(self, field.name)) not in CHOICES[field.name]:
                raise BadInput(f'The form of {field.name} is one of {", ".join(CHOICES[field.name])}, not "{form}".')

    def numbers(self) -> dict[str, float]:
        """Index of each form among its choices."""
        return {name: float(choices.index(getattr(self, name))) for name, choices in CHOICES.items()}


NOMINAL = Forms()


def other(rng: np.random.Generator) -> Forms:
    """A different form of each part, randomly chosen if there are several."""
    near = {name: [form for form in forms[1:] if form not in FAR_OFF.get(name, ())] for name, forms in CHOICES.items()}
    return Forms(**{name: str(rng.choice(forms)) for name, forms in near.items() if name not in EFFECTS_ALREADY})


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
"""Effects that make forces depend on accelerations, so that both are solved together."""
_WHEEL_INERTIA = 0.007
"""Inertia of one wheel over mass times squared wheel radius, if the vehicle does not state it."""


def record(car: VirtualCar, magnitudes: Mapping[str, float], forms: Forms) -> Car:
    """The record of a vehicle with effects, at the magnitudes from `effects.complete`."""
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
    """Peak of the magic formula, start of sliding, and its share of the peak there; slips times B C."""
    slips = np.linspace(0.01, 60.0, 6000)
    shares = np.sin(C * np.arctan(slips - E * (slips - np.arctan(slips))))
    top = int(np.argmax(shares))
    peak_t = max(C * float(slips[top]) if shares[top] > 0.995 else C * B * pi / 4, 2.05)
    slide = float(sin(C * atan(4 * slips[top] - E * (4 * slips[top] - atan(4 * slips[top])))))
    return peak_t, 4.0 * peak_t, max(slide, 0.7)
