"""Hypotheses about recordings: a bench that simulates them, what is known beforehand, model error, noise, refits.

A hypothesis is a model with some effects at magnitudes of their own, beside nuisances that have priors (tolerances,
starts, forces that no equation knows). `preparing` lays all candidates over recordings at once, `bench` simulates,
`model_error` and `noise` say what residuals count, and `refit` finds each hypothesis' best on them.
"""
