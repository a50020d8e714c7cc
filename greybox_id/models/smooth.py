"""Forms that keep vehicle models finite at standstill and smooth at limits, and exact elsewhere.

The straight line that stands for a transient exp(-r s), s from 0 to 1: that of the same mean and first moment.
"""

from __future__ import annotations

from math import factorial

import casadi as cs

from .model import Symbol
from .motion_model import Validity

SLOWEST = 0.5
"""Below this speed, m/s, slip angles are computed as if the vehicle rolled this fast."""
ROLLING = 0.05
"""Speed, m/s, at which resistance to rolling has reached three quarters of its size."""
SLIPPING = (Validity("v_x", SLOWEST, ("v_y", "yaw_rate", "a_y")),)
"""Of models with slip angles: these mean nothing of a vehicle that stands, where noise of the speed turns them."""


def forward_speed(v_x: Symbol) -> Symbol:
    """Speed for slip angles, m/s: v_x itself above `SLOWEST`, never below half of it, smooth in between."""
    ratio = cs.fmax(cs.fabs(v_x), 0.0) / SLOWEST
    return cs.if_else(ratio >= 1, cs.fabs(v_x), SLOWEST * (0.5 + 0.5 * ratio**2))


def steer_slip(steer: Symbol, v_x: Symbol) -> Symbol:
    """What steering adds to a slip angle, rad: steer itself forwards, reversed in reverse, nothing at rest."""
    return steer * v_x / forward_speed(v_x)


def sign_of_motion(v_x: Symbol) -> Symbol:
    """Direction of motion, -1 to 1, vanishing smoothly at rest."""
    return cs.tanh(v_x / ROLLING)


WIDTH = 1e-3
"""Relative width over which what is left of something reaches zero."""
CORNER = 1e-4
"""Squared relative width, 1 %, over which a limit sets in."""


def remaining(lost: Symbol) -> Symbol:
    """What is left of one, 1 - lost; zero where more is lost, to `WIDTH`. Exactly one where nothing is lost."""
    left = 1 - lost
    return (left + cs.sqrt(left**2 + (WIDTH * lost) ** 2)) / 2


def within_limit(ratio: Symbol) -> Symbol:
    """The share of something that passes a limit, its size over the limit given: the smaller of 1 and 1 / ratio.

    Exactly one at and below zero; at the corner, ratio one, it is half the root of `CORNER` below the limit.
    """
    above = cs.fmax(ratio, 0)
    return 2 / (1 + above + cs.sqrt((1 - above) ** 2 + CORNER * above**2))


SERIES = 0.03
"""Below this ratio weights follow from their series, in which nothing cancels."""
TERMS = 8


def mean_and_slope(r: Symbol) -> tuple[Symbol, Symbol]:
    """Mean and slope of the line for a ratio r > 0 of a step to a time constant."""
    mean = -cs.expm1(-r) / r
    moment = (mean - cs.exp(-r)) / r
    series = sum(6 * (-r) ** n / (factorial(n - 1) * (n + 1) * (n + 2)) for n in range(1, TERMS + 1))
    return mean, cs.if_else(r < SERIES, series, 12 * (moment - mean / 2))
