"""The verb `fit`: from recordings and a model to a `Fit`."""

from .how import How, Say, Solver
from .verb import fit

__all__ = ["How", "Say", "Solver", "fit"]
