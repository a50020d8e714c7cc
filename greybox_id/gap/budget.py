"""The budget of a gap: which share of the excess error each effect closes, and what is left unexplained.

The value of a set of effects is how far it lowers the mean square of free-run errors; an effect's share is its Shapley
value, the mean of what it adds to every set of the others, over the excess above noise. Shares and the
unexplained rest add up to one. Source: Shapley, A value for n-person games, 1953.
"""

from __future__ import annotations

from collections.abc import Mapping
from itertools import combinations
from math import factorial

import numpy as np
from numpy.typing import NDArray

from ..base.shorthands import Array
from ..base.statistics import resampled
from ..engine.simulation import FreeRuns
from .estimation.calibration import CAL
from .estimation.free_runs import Misfit
from .estimation.noise import blocks
from .gap import Budget, Share

Set = frozenset[str]


def subsets(names: tuple[str, ...]) -> list[Set]:
    """All sets of some names, the empty one first, all of them last."""
    return [frozenset(combination) for size in range(len(names) + 1) for combination in combinations(names, size)]


def budget(
    misfits: Mapping[Set, Misfit],
    names: tuple[str, ...],
    sd: Array,
    good: NDArray[np.bool_],
    bench: FreeRuns,
    recordings: tuple[str, ...],
    held_out: bool,
) -> Budget | None:
    """Share out the excess error; None where there is none to share.

    Parameters
    ----------
    misfits : of the model with every set of effects, tolerances refitted.
    names : of the effects, in order.
    sd : (channels,) of noise.
    good : (N, channels) readings that count.
    bench : whose blocks are drawn.
    recordings : names of what the misfits are on.
    held_out : whether these chose nothing.
    """
    sets = subsets(names)
    squares = {item: np.sum(np.where(good, misfits[item].e / sd, 0.0) ** 2, axis=1) for item in sets}
    rows = np.sum(good, axis=1)
    edges = blocks(bench)
    sums = np.array([[np.sum(squares[item][a:b]) for item in sets] + [np.sum(rows[a:b])] for a, b in edges])
    # where some effects make it spin without the others, or are not of first order, that says nothing
    sums[:, 1:-2] = np.minimum(sums[:, 1:-2], np.maximum(sums[:, :1], sums[:, -2:-1]))
    charges = np.array([misfits[item].charge for item in sets])
    without = [sets.index(frozenset(names) - {name}) for name in names]
    weights = np.array([[_weight(name, item, len(names)) for item in sets] for name in names]).reshape(len(names), -1)

    def shares(total: Array) -> Array:
        E = (total[:-1] + charges) / max(total[-1], 1.0)
        excess, floor = over(E)
        E = np.minimum(E, E[0] + excess)  # where effects make it spin, how much worse they are says nothing
        E[1:-1] = np.minimum(E[1:-1], max(E[0], E[-1]))  # some of them may without the others: they explain nothing
        closed = weights @ E / excess
        beside = [(E[k] - E[-1]) / max(E[k] - floor, CAL.least_gap) for k in without]
        return np.concatenate([closed, [(E[-1] - floor) / excess], beside])

    def over(E: Array) -> tuple[float, float]:
        floor = float(min(1.0, E[0], E[-1]))  # noise has no more than is left
        return max(float(E[0]) - floor, CAL.least_gap), floor

    whole = np.sum(sums, axis=0)
    E = (whole[:-1] + charges) / max(whole[-1], 1.0)
    excess, floor = over(E)
    if excess <= CAL.least_gap:
        return None
    low, high = resampled(sums, shares, CAL.draws)
    result = [
        Share(name, float(s), float(a), float(b))
        for name, s, a, b in zip((*names, "unexplained", *names), shares(whole), low, high, strict=True)
    ]
    n = len(names)
    shows = bool(max(E[0], E[-1]) - floor >= CAL.shows)
    return Budget(tuple(result[:n]), result[n], recordings, held_out, shows, tuple(result[n + 1 :]))


def _weight(name: str, value: Set, n: int) -> float:
    """How the error with a set of effects counts in the Shapley value of one of them."""
    if name in value:
        return -factorial(len(value) - 1) * factorial(n - len(value)) / factorial(n)
    return factorial(len(value)) * factorial(n - len(value) - 1) / factorial(n)
