"""A fit meets a car that has changed: a little of its new motion adapts the fit, or says that it need not change.

What a new recording's own seconds cannot show is not adapted: every choice is made by blocked cross-validation on them,
and the fit as it stands is always a candidate.
"""
