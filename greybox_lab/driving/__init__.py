"""Policies that drive identified vehicles, networks learnt from how they answer, and the loop."""
