"""Figures of a report: one function each, returning a sheet of matplotlib Axes; no global state of it is touched."""
