"""How far a model is from a recording: predictions, errors, and what to hold them against."""
