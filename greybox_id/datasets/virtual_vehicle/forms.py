"""In which mathematical form the vehicle has what it has: the usual one of models, or another that is in use as well.

The magnitude of an effect means the same in every form: a time constant is the delay it makes to slow signals, a
relaxation length holds at the static wheel load, tyre curves are laid on the magic formula.
"""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np

from ...errors import BadInput

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
"""What can be chosen, the form of models first."""
EFFECTS_ALREADY = ("latency", "stiffness")
"""A latency that jitters, and a stiffness that grows less than its load, are effects of the vocabulary: they are never
drawn as mere forms."""
FAR_OFF = {"tyre": ("dugoff",)}
"""Forms that no magic formula comes near: with the same stiffness and friction Dugoff's curve lies 5 % of the peak off.
A file that states its numbers within a percent is not about such a tyre; these are only chosen by name."""


@dataclass(frozen=True)
class Forms:
    """One form for each thing.

    Attributes
    ----------
    tyre : lateral force over slip angle: magic formula; TMeasy (Rill, Road Vehicle Dynamics, Sec. 3.4); brush with
        parabolic pressure (Pacejka, Tire and Vehicle Dynamics, Sec. 3.2); Dugoff, Fancher & Segel (SAE 700377); tanh.
    stiffness : cornering stiffness grows with wheel load; less and less (Pacejka, Sec. 4.3.1).
    relaxation : of the slip angle; of the lateral force; of the slip angle over a length that grows with wheel load.
    combined : friction ellipse on the force; on the tyre's peak, its slope unchanged (Hindiyeh & Gerdes 2014).
    load_sensitivity : friction falls linearly with wheel load; as a power of it.
    temperature : friction falls with all work done; each axle has a heat balance with cooling.
    steering_lag : of first order; of second order, critically damped, equally late.
    rate_limit : a hard limit; a PI servo that drives at no more than that rate.
    backlash : play; play whose flanks give.
    saturation : constant force, then constant power; a smooth torque curve between the two.
    roll : seen by the accelerometer alone; wheel loads follow the roll angle as well.
    wheels : longitudinal forces are as commanded; wheels rotate and make them by their slip.
    geometry : slip at the middle of axles; at each wheel where it stands, steered halfway from parallel to Ackermann.
    drag : rolling resistance constant and drag with squared speed; the one growing, the other with a lower power.
    wind : the same area from the front and from the side; half as much again from the side.
    latency : constant; scattered about its mean.
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
        """Each form's place among its choices."""
        return {name: float(choices.index(getattr(self, name))) for name, choices in CHOICES.items()}


NOMINAL = Forms()


def other(rng: np.random.Generator) -> Forms:
    """Another form for everything, where there are several one of them."""
    near = {name: [form for form in forms[1:] if form not in FAR_OFF.get(name, ())] for name, forms in CHOICES.items()}
    return Forms(**{name: str(rng.choice(forms)) for name, forms in near.items() if name not in EFFECTS_ALREADY})
