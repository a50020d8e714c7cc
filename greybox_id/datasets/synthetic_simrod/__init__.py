"""A seeded generator of recordings of a synthetic SimRod, with the tyre forces that no recording tells.

    for test in make(seed=0, part="train"):
        test.recording                      # what a test car records, 100 Hz: all that an estimator may read
        test.truth.F_yf                     # what wheel force transducers would read: for the score alone

Steps and sines of the steering wheel at several speeds, as on the proving ground of "Tire cornering stiffness
estimation using hybrid modeling" (Sec. 3.3). The car is the virtual vehicle with the SimRod's numbers: two tracks,
nonlinear tyres whose stiffness and friction grow less than their load, load transfer, rear drive; simulated at 1 kHz.
It shares no equations with the package's models.

`python -m greybox_id.datasets.synthetic_simrod --seed 0 --out DIR` writes the recordings, and the truth in a folder of
its own.
"""

from .car import EFFECTS, FORMS, simrod
from .drive import RATE, Test, drive, make
from .files import write
from .manoeuvres import MANOEUVRES, Manoeuvre, Part, steering
from .truth import EXCITED, TyreTruth

__all__ = [
    "EFFECTS",
    "EXCITED",
    "FORMS",
    "MANOEUVRES",
    "RATE",
    "Manoeuvre",
    "Part",
    "Test",
    "TyreTruth",
    "drive",
    "make",
    "simrod",
    "steering",
    "write",
]
