"""Limits with rounded corners, exact where nothing is limited."""

from __future__ import annotations

import casadi as cs

from ...model import Symbol

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
