"""Halves of a recording that mix early and late rows: what a model lacks differs between manoeuvres, not halves.

A first and a second half that differ by more than mixed ones do are of two vehicles, or of one that has changed.
"""

from __future__ import annotations

from itertools import combinations, product

import numpy as np
from scipy.special import stdtrit

from ...base.shorthands import Array

BLOCKS, BY_CHANCE = 8, 0.01
"""Parts of a recording, in order of time, of which halves are mixed; and how seldom the first and the second half of
one vehicle's drive stand out from those."""


def mixed_halves() -> list[tuple[int, ...]]:
    """Of halves that have as many of the first four blocks as of the last four, the one with the first block."""
    half, quarter = BLOCKS // 2, BLOCKS // 4
    early, late = combinations(range(half), quarter), combinations(range(half, BLOCKS), quarter)
    return [first + second for first, second in product(early, late) if 0 in first]


def prediction_limit(values: Array) -> float:
    """What one more of such numbers, (n,) of a normal distribution, exceeds as seldom as `BY_CHANCE`."""
    n = len(values)
    beyond = -stdtrit(n - 1, BY_CHANCE) * np.sqrt(1.0 + 1.0 / n) * np.std(values, ddof=1)
    return float(np.mean(values) + beyond)
