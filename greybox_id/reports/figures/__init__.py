"""Figures of a report: one function each, returning a figure; no global state of the plotting library is touched."""
