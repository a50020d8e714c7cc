"""Equations of motion on recordings: tracing, timing, simulation, and the least-squares problem."""
