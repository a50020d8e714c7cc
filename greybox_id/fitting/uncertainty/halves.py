"""Parts of a recording that mix early and late rows: what a model lacks differs between manoeuvres, not parts.

A first and a second part that differ by more than mixed ones do are of two vehicles, or of one that has changed.
"""

from __future__ import annotations

from itertools import combinations, product

import numpy as np
from scipy.special import stdtrit

from ...base.shorthands import Array

BLOCKS, BY_CHANCE = 8, 0.01
"""Parts of a recording, in order of time, which are mixed; and how seldom the first and the last blocks of one
vehicle's drive stand out from those."""
HALF = BLOCKS // 2
SPLITS = tuple(range(2, BLOCKS - 1))
"""Of how many blocks the first part may be: a vehicle need not have changed half way."""


def mixed_halves() -> list[tuple[int, ...]]:
    """Of halves that have as many of the first four blocks as of the last four, the one with the first block."""
    early, late = combinations(range(HALF), HALF // 2), combinations(range(HALF, BLOCKS), HALF // 2)
    return [first + second for first, second in product(early, late) if 0 in first]


def other_parts(count: int) -> list[tuple[int, ...]]:
    """All parts of so many blocks but the first ones."""
    return [one for one in combinations(range(BLOCKS), count) if one != tuple(range(count))]


def prediction_limit(values: Array) -> float:
    """What one more of such numbers, (n,) of a normal distribution, exceeds as seldom as `BY_CHANCE`."""
    n = len(values)
    beyond = -stdtrit(n - 1, BY_CHANCE) * np.sqrt(1.0 + 1.0 / n) * np.std(values, ddof=1)
    return float(np.mean(values) + beyond)
