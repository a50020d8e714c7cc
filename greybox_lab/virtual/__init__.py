"""Synthetic cars, reproducible by seed; no code is shared with the package's models."""
