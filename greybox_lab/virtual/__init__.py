"""Synthetic cars, made from a seed; no code is shared with the models."""
