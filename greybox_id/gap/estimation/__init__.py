"""Estimation behind a diagnosis: simulation of recordings, priors, model error, noise, and refits of hypotheses.

A hypothesis is a model with some effects at given magnitudes, beside nuisances that have priors (tolerances, starts of
runs, unknown forces). `preparing` builds the model with all candidates, `bench` simulates it over the recordings,
`model_error` and `noise` whiten the residuals, and `refit` optimises hypotheses.
"""
