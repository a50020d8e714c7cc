"""Parts of a recording: whether they differ by more than a model's error differs between manoeuvres.

What a model lacks differs between manoeuvres: blocks of one vehicle's drive prefer other parameters, by several times
what noise alone would. So parts are compared with each other beside the scatter between blocks of the same part.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import combinations, product

import numpy as np
import scipy.linalg as la
from scipy.special import fdtrc, stdtrit

from ...base.shorthands import Array
from .evidence import RIDGE, SHARES

BLOCKS, BY_CHANCE = 8, 0.01
"""Parts of a recording, in order of time; and how seldom those of one vehicle's drive are told apart."""
HALF = BLOCKS // 2
OTHERS = tuple(count for count in range(2, BLOCKS - 1) if count != HALF)
"""Of how many blocks the first part may be, if not half of them: a vehicle need not have changed half way."""


def mixed_halves() -> list[tuple[int, ...]]:
    """Of halves that have as many of the first four blocks as of the last four, the one with the first block."""
    early, late = combinations(range(HALF), HALF // 2), combinations(range(HALF, BLOCKS), HALF // 2)
    return [first + second for first, second in product(early, late) if 0 in first]


def prediction_limit(values: Array) -> float:
    """What one more of such numbers, (n,) of a normal distribution, exceeds as seldom as `BY_CHANCE`."""
    n = len(values)
    beyond = -stdtrit(n - 1, BY_CHANCE) * np.sqrt(1.0 + 1.0 / n) * np.std(values, ddof=1)
    return float(np.mean(values) + beyond)


@dataclass(frozen=True)
class Deviations:
    """How parameters of later blocks may deviate from those of the first.

    Attributes
    ----------
    curvature, gradient : by the parameters of each block but the first, in turn; all else is at its best.
    unit : (parameters,) what a share of one is in a parameter's size.
    """

    curvature: Array
    gradient: Array
    unit: Array

    @classmethod
    def of(cls, H: Array, g: Array, variances: Array, unit: Array) -> Deviations:
        """With all else eliminated.

        Parameters
        ----------
        H, g : curvature and gradient by parameters, by sizes of functions of the drive, and by parameters of blocks.
        variances : (functions,) of those sizes; none is used whose variance is zero.
        """
        count, last = len(unit), len(unit) + len(variances)
        used = np.concatenate([np.ones(count, dtype=bool), variances > 0.0])
        free = np.concatenate([np.zeros(count), 1.0 / np.where(variances > 0.0, variances, np.inf)])
        A = (H[:last, :last] + np.diag(free))[np.ix_(used, used)]
        size = np.diag(A)
        scale = np.where(size > 0.0, 1.0 / np.sqrt(np.where(size > 0.0, size, 1.0)), 0.0)
        beside = H[:last, last:][used] * scale[:, None]
        inverse = la.pinvh(A * np.outer(scale, scale) + RIDGE * np.eye(len(scale)))
        curvature = H[last:, last:] - beside.T @ inverse @ beside
        gradient = g[last:] - beside.T @ (inverse @ (g[:last][used] * scale))
        return cls(0.5 * (curvature + curvature.T), gradient, unit)

    def chance(self, first: Sequence[int]) -> float:
        """How often parts of one vehicle's drive, these blocks and the others, differ by as much: an F test.

        What the parts differ by is compared with what blocks of the same part do, each by its degrees of freedom.
        """
        between, *within = _contrasts(first)
        shares = [self._along(between, share) for share in SHARES[1:]]
        best = int(np.argmax([one.evidence for one in shares]))
        parts, blocks = shares[best], [self._along(one, SHARES[1:][best]) for one in within]
        scatter, free = sum(one.gain for one in blocks), sum(one.freedom for one in blocks)
        if not (scatter > 0.0 and free > 0.0 and parts.freedom > 0.0):
            return 1.0
        ratio = parts.gain / parts.freedom / (scatter / free)
        return float(fdtrc(_degrees([parts]), _degrees(blocks), ratio))

    def _along(self, contrast: Array, share: float) -> _Along:
        """Where each block's parameters deviate by an entry of a contrast, (BLOCKS,), of unit length."""
        weights, count = contrast[1:] - contrast[0], len(self.unit)
        by_block = self.curvature.reshape(len(weights), count, len(weights), count)
        # a later half that deviates by one is a contrast of unit length times this root
        root = share * self.unit * np.sqrt(BLOCKS / 4.0)
        inner = root[:, None] * np.einsum("i,iajb,j->ab", weights, by_block, weights) * root
        size, along = la.eigh(0.5 * (inner + inner.T))
        size = np.maximum(size, 0.0)
        pull = along.T @ (root * (weights @ self.gradient.reshape(len(weights), count)))
        return _Along(float(np.sum(pull**2 / (1.0 + size))), size)


@dataclass(frozen=True)
class _Along:
    """Parameters that deviate along a contrast of blocks.

    Attributes
    ----------
    gain : twice what they gain, in log likelihood and prior.
    size : (parameters,) curvature over that of their prior.
    """

    gain: float
    size: Array

    @property
    def evidence(self) -> float:
        """Log of how much likelier the residuals are."""
        return 0.5 * self.gain - 0.5 * float(np.sum(np.log1p(self.size)))

    @cached_property
    def shares(self) -> Array:
        """(parameters,) of each, how far data and not its prior determine it."""
        return self.size / (1.0 + self.size)

    @property
    def freedom(self) -> float:
        """Their number, each by its share: what the gain is where nothing deviates and noise is as counted."""
        return float(np.sum(self.shares))


def _degrees(terms: Iterable[_Along]) -> float:
    """Of a sum of gains, after Satterthwaite."""
    shares = np.concatenate([one.shares for one in terms])
    return float(np.sum(shares) ** 2 / np.sum(shares**2))


def _contrasts(first: Sequence[int]) -> list[Array]:
    """Orthonormal contrasts of blocks: between these and the others, then within either."""
    sides = [[k for k in range(BLOCKS) if (k in first) == chosen] for chosen in (True, False)]
    raw = [np.zeros(BLOCKS)]
    for sign, side in zip((1.0, -1.0), sides, strict=True):
        raw[0][side] = sign / len(side)
        for place in range(1, len(side)):
            one = np.zeros(BLOCKS)
            one[side[:place]], one[side[place]] = 1.0, -float(place)
            raw.append(one)
    return [one / np.linalg.norm(one) for one in raw]
