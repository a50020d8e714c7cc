"""Draws from the posterior of a fit's parameters, and predictions with them."""
