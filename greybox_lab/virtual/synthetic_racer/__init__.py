"""Generator of recordings of a synthetic 1:10 racing car with four-wheel drive, reproducible by seed.

The files have the columns, units, sampling and sensor faults of the RoboRacer recordings, so that they can be used in
their place; the car is fictional. It represents the real car in examples and tests, and its equations are those of no
model in the package, so a model that fits well has learnt something rather than recognised itself.

Each file contains several runs, and time restarts at each; each run has its own raceline, limits and lateral
controller. `greybox datasets make racer --out DIR` writes the files.
"""

from .drive import COLUMNS, SEED, make, run_table

__all__ = ["COLUMNS", "SEED", "make", "run_table"]
