"""Differences between parts of a recording, compared with the differences between manoeuvres of one vehicle.

Model-form error differs between manoeuvres: blocks of one vehicle's drive prefer other parameters, by several times the
noise alone. Therefore the difference of two parts is compared with the scatter between blocks within each part.
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
"""Parts of a recording, in order of time; significance level for differences between them."""
HALF = BLOCKS // 2
OTHERS = tuple(count for count in range(2, BLOCKS - 1) if count != HALF)
"""Numbers of blocks in the first part other than half: a vehicle need not have changed half way."""


def mixed_halves() -> list[tuple[int, ...]]:
    """Halves with as many of the first four blocks as of the last four, represented by the half with block 0."""
    early, late = combinations(range(HALF), HALF // 2), combinations(range(HALF, BLOCKS), HALF // 2)
    return [first + second for first, second in product(early, late) if 0 in first]


def prediction_limit(values: Array) -> float:
    """Upper prediction limit for one more of such values, (n,) of a normal distribution, at level `BY_CHANCE`."""
    n = len(values)
    beyond = -stdtrit(n - 1, BY_CHANCE) * np.sqrt(1.0 + 1.0 / n) * np.std(values, ddof=1)
    return float(np.mean(values) + beyond)


@dataclass(frozen=True)
class Deviations:
    """Normal equations of deviations of later blocks' parameters from those of the first.

    Attributes
    ----------
    curvature, gradient : by the parameters of each block but the first, in turn; all other unknowns eliminated.
    unit : (parameters,) deviation that corresponds to a share of one.
    """

    curvature: Array
    gradient: Array
    unit: Array

    @classmethod
    def of(cls, H: Array, g: Array, variances: Array, unit: Array) -> Deviations:
        """Eliminate all other unknowns.

        Parameters
        ----------
        H, g : curvature and gradient by parameters, by coefficients of functions of the drive, and by parameters of
            blocks.
        variances : (functions,) prior variances of those coefficients; functions with zero variance are dropped.
        unit : as the attribute.
        """
        count, last = len(unit), len(unit) + len(variances)
        used = np.concatenate([np.ones(count, dtype=bool), variances > 0.0])
        free = np.concatenate([np.zeros(count), 1.0 / np.where(variances > 0.0, variances, np.inf)])
        A = (H[:last, :last] + np.diag(free))[np.ix_(used, used)]
        size = np.diag(A)
        scale = np.where(size > 0.0, 1.0 / np.sqrt(np.where(size > 0.0, size, 1.0)), 0.0)
        coupling = H[:last, last:][used] * scale[:, None]
        inverse = la.pinvh(A * np.outer(scale, scale) + RIDGE * np.eye(len(scale)))
        curvature = H[last:, last:] - coupling.T @ inverse @ coupling
        gradient = g[last:] - coupling.T @ (inverse @ (g[:last][used] * scale))
        return cls(0.5 * (curvature + curvature.T), gradient, unit)

    def chance(self, first: Sequence[int]) -> float:
        """Probability that parts of one vehicle's drive, these blocks and the others, differ by as much: an F test.

        The difference between the parts is compared with that between blocks within the parts, each by its degrees of
        freedom.
        """
        between, *within = _contrasts(first)
        shares = [self._along(between, share) for share in SHARES[1:]]
        best = int(np.argmax([one.evidence for one in shares]))
        parts, blocks = shares[best], [self._along(one, SHARES[1:][best]) for one in within]
        scatter_gain, free = sum(one.gain for one in blocks), sum(one.freedom for one in blocks)
        if not (scatter_gain > 0.0 and free > 0.0 and parts.freedom > 0.0):
            return 1.0
        ratio = parts.gain / parts.freedom / (scatter_gain / free)
        return float(fdtrc(_degrees([parts]), _degrees(blocks), ratio))

    def _along(self, contrast: Array, share: float) -> _Along:
        """Deviations of the blocks' parameters along a contrast, (BLOCKS,), of unit length."""
        weights, count = contrast[1:] - contrast[0], len(self.unit)
        by_block = self.curvature.reshape(len(weights), count, len(weights), count)
        # scaled so that a later half deviating by one is a contrast of unit length
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
    gain : twice the increase of log likelihood and log prior.
    size : (parameters,) curvature of the data over that of the prior.
    """

    gain: float
    size: Array

    @property
    def evidence(self) -> float:
        """Log marginal likelihood ratio of the deviations over none."""
        return 0.5 * self.gain - 0.5 * float(np.sum(np.log1p(self.size)))

    @cached_property
    def shares(self) -> Array:
        """(parameters,) share of each parameter's information that comes from the data, not the prior."""
        return self.size / (1.0 + self.size)

    @property
    def freedom(self) -> float:
        """Effective number of parameters: the expected gain if nothing deviates and the noise is as assumed."""
        return float(np.sum(self.shares))


def _degrees(terms: Iterable[_Along]) -> float:
    """Degrees of freedom of a sum of gains, after Satterthwaite."""
    shares = np.concatenate([one.shares for one in terms])
    return float(np.sum(shares) ** 2 / np.sum(shares**2))


def _contrasts(first: Sequence[int]) -> list[Array]:
    """Orthonormal contrasts of blocks: between these and the others, then within each side."""
    sides = [[k for k in range(BLOCKS) if (k in first) == chosen] for chosen in (True, False)]
    raw = [np.zeros(BLOCKS)]
    for sign, side in zip((1.0, -1.0), sides, strict=True):
        raw[0][side] = sign / len(side)
        for place in range(1, len(side)):
            one = np.zeros(BLOCKS)
            one[side[:place]], one[side[place]] = 1.0, -float(place)
            raw.append(one)
    return [one / np.linalg.norm(one) for one in raw]
