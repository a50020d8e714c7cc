"""A vehicle that exists in simulation only, to examine what is said of the gap between a model and reality.

    car = random_vehicle(7)
    recording, truth = drive(car, "mixed", effects={"tyre_relaxation": 0.4})

`EFFECTS` are the effects of the vocabulary, `OUTSIDE` those that are not in it; any of them compose. `toleranced` draws
a true vehicle about what `vehicle_file_text` states. It shares no code with the package's models, nor, in other
`forms`, their functional forms.
"""

from .car import Tolerances, VirtualCar, random_vehicle, toleranced, tolerances, vehicle_file_text
from .drive import SteppedCar, Truth, drive, replay, steered
from .effects import EFFECTS, OUTSIDE, Entry
from .manoeuvres import MANOEUVRES
from .record import Forms

__all__ = [
    "EFFECTS",
    "MANOEUVRES",
    "OUTSIDE",
    "Entry",
    "Forms",
    "SteppedCar",
    "Tolerances",
    "Truth",
    "VirtualCar",
    "drive",
    "random_vehicle",
    "replay",
    "steered",
    "toleranced",
    "tolerances",
    "vehicle_file_text",
]
