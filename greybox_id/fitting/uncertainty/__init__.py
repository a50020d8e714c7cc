"""Uncertainty of a fit's parameters."""

from .sandwich import Uncertainty, covariance, uncertainty

__all__ = ["Uncertainty", "covariance", "uncertainty"]
