"""Scores of a model on a recording: predictions, errors, and references to compare them with."""
