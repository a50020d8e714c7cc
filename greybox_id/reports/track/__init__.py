"""Results of tracking: figures, a file and a report."""
