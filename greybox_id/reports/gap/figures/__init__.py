"""Panels of a picture of a gap: one function each, drawing on axes it is given."""
