"""Tracking: EKF, UKF and smoother over any model of motion, with what drifts among its parameters."""

from .how import How
from .kernel import SigmaPoints
from .track import Track
from .verb import Tracker, track

__all__ = ["How", "SigmaPoints", "Track", "Tracker", "track"]
