"""Adapt a fit to a changed vehicle from a short new recording, or show that it need not change.

Only what the new seconds identify is adapted: blocked cross-validation on them makes every choice, and the unchanged
fit is always a candidate.
"""
