"""Hybrid models on recordings: one step, windows of them side by side, free runs."""

from .motion import as_motion

__all__ = ["as_motion"]
