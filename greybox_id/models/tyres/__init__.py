"""Tyre models: lateral force of an axle over slip angle and load, interchangeable in one word."""

from .brush import brush
from .dugoff import dugoff
from .linear import linear
from .pacejka import pacejka
from .tyre import Tyre, axle

TYRES: dict[str, Tyre] = {tyre.name: tyre for tyre in (pacejka, linear, dugoff, brush)}
"""Tyre models by name."""

__all__ = ["TYRES", "Tyre", "axle", "brush", "dugoff", "linear", "pacejka"]
