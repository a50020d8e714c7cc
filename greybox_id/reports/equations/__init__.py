"""Typeset equations of a model, derived from the model itself."""
