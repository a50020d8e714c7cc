"""Identify vehicle models from recordings, with honest uncertainty, on CasADi."""

__version__ = "0.1.0"
