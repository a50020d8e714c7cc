"""Hybrid models laid over recordings: one step, windows of them side by side, free runs."""
