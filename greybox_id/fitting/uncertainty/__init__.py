"""How well a fit tells its parameters."""

from .sandwich import Uncertainty, covariance, uncertainty

__all__ = ["Uncertainty", "covariance", "uncertainty"]
