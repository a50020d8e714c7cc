"""A simulated vehicle, for examining diagnoses of the gap between a model and reality.

    car = random_vehicle(7)
    recording, truth = drive(car, "mixed", effects={"tyre_relaxation": 0.4})

`EFFECTS` are the effects of the vocabulary, `OUTSIDE` those outside it; all can be combined. `toleranced` draws a true
vehicle around the numbers that `vehicle_file_text` states. No code is shared with the package's models and, in other
`forms`, no functional forms either.
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
