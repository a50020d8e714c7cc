"""Hypotheses about recordings: a bench that simulates them, what is believed and what is not, model error, refits.

A hypothesis is a model with some effects at magnitudes of their own, beside nuisances that are believed (tolerances,
starts, forces that no equation knows). `preparing` lays all candidates over recordings at once, `bench` simulates,
`model_error` and `noise` say what residuals count, and `refit` finds each hypothesis' best on them.
"""
