"""The straight line that stands for a transient exp(-r s), s from 0 to 1: that of the same mean and first moment."""

from __future__ import annotations

from math import factorial

import casadi as cs

from .model import Symbol

SERIES = 0.03
"""Below this ratio weights follow from their series, in which nothing cancels."""
TERMS = 8


def mean_and_slope(r: Symbol) -> tuple[Symbol, Symbol]:
    """Mean and slope of the line for a ratio r > 0 of a step to a time constant."""
    mean = -cs.expm1(-r) / r
    moment = (mean - cs.exp(-r)) / r
    series = sum(6 * (-r) ** n / (factorial(n - 1) * (n + 1) * (n + 2)) for n in range(1, TERMS + 1))
    return mean, cs.if_else(r < SERIES, series, 12 * (moment - mean / 2))
