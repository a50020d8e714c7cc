"""Equations of motion laid over recordings: tracing, timing, simulation, and the least-squares problem."""
