"""Functions that keep vehicle models finite at standstill and smooth at limits, and are exact elsewhere.

Also the straight line equivalent to a transient exp(-r s), s from 0 to 1: same mean and first moment.
"""

from __future__ import annotations

from math import factorial

import casadi as cs

from .model import Symbol
from .motion_model import Validity

SLOWEST = 0.5
"""Speed, m/s, below which slip angles are regularised, see `forward_speed`."""
ROLLING = 0.05
"""Speed, m/s, at which rolling resistance has reached three quarters of its value."""
SLIPPING = (Validity("v_x", SLOWEST, ("v_y", "yaw_rate", "a_y")),)
"""Validity of models with slip angles: near standstill noise of the speed makes slip angles meaningless."""


def forward_speed(v_x: Symbol) -> Symbol:
    """Speed for slip angles, m/s: |v_x| above `SLOWEST`, never below half of it, smooth in between."""
    ratio = cs.fmax(cs.fabs(v_x), 0.0) / SLOWEST
    return cs.if_else(ratio >= 1, cs.fabs(v_x), SLOWEST * (0.5 + 0.5 * ratio**2))


def steer_slip(steer: Symbol, v_x: Symbol) -> Symbol:
    """Contribution of steering to a slip angle, rad: steer when moving forwards, negated in reverse, zero at rest."""
    return steer * v_x / forward_speed(v_x)


def sign_of_motion(v_x: Symbol) -> Symbol:
    """Direction of motion, -1 to 1, passing smoothly through zero at rest."""
    return cs.tanh(v_x / ROLLING)


WIDTH = 1e-3
"""Relative width over which `remaining` rounds the corner at zero."""
CORNER = 1e-4
"""Squared relative width, 1 %, over which `within_limit` rounds its corner."""


def remaining(lost: Symbol) -> Symbol:
    """Positive part of 1 - lost, rounded by `WIDTH`; exactly one for lost = 0."""
    left = 1 - lost
    return (left + cs.sqrt(left**2 + (WIDTH * lost) ** 2)) / 2


def within_limit(ratio: Symbol) -> Symbol:
    """Factor that limits a value to its limit, min(1, 1 / ratio), for its ratio to the limit.

    Exactly one for ratios up to zero; at the corner, ratio one, it is half the root of `CORNER` below one.
    """
    above = cs.fmax(ratio, 0)
    return 2 / (1 + above + cs.sqrt((1 - above) ** 2 + CORNER * above**2))


SERIES = 0.03
"""Ratio below which the weights are computed from their series, to avoid cancellation."""
TERMS = 8


def mean_and_slope(r: Symbol) -> tuple[Symbol, Symbol]:
    """Mean and slope of the equivalent line, for a ratio r > 0 of step to time constant."""
    mean = -cs.expm1(-r) / r
    moment = (mean - cs.exp(-r)) / r
    series = sum(6 * (-r) ** n / (factorial(n - 1) * (n + 1) * (n + 2)) for n in range(1, TERMS + 1))
    return mean, cs.if_else(r < SERIES, series, 12 * (moment - mean / 2))
