"""A seeded generator of recordings of a synthetic 1:10 racing car with four-wheel drive.

The files have the columns, units, sampling and sensor faults of the RoboRacer recordings, so that everything that
reads those reads these; the car behind them is invented. It stands in for the real car in examples and
tests, and its equations are nobody's model: what fits it well has learnt something, not remembered itself.

Several runs are joined in each file and time restarts at each; each has its own raceline, limits and lateral
controller. `greybox datasets make racer --out DIR` writes the files.
"""

from .drive import COLUMNS, SEED, make, run_table

__all__ = ["COLUMNS", "SEED", "make", "run_table"]
